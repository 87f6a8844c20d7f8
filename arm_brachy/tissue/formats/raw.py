"""What a mesh file holds: tetrahedra of four or ten nodes, node sets, and what is left out."""

from dataclasses import dataclass, field

import numpy as np

from arm_brachy.core.errors import MeshError

# Corners of the edges; formats differ in which node lies on which, and only corners are used.
EDGE_ENDS = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])
STRAIGHT = 1e-3   # of an edge: farther off its middle, a node makes a curved edge
CROOKED = 0.5     # of an edge: farther off is no edge of this tetrahedron


@dataclass
class RawMesh:
    """A mesh as in its file, checked for nothing.

    nodes : (n, 3) in the file's unit;  tets : (m, 4), (m, 10) with the middles of the edges
        behind the corners in any order, or (0, 4);  sets : name -> (k,) nodes
    solids : names of volume elements that are no tetrahedra -> their number
    aside : names of other elements (plates, shells, beams) -> (their number, their nodes (k,))
    notes : what a person should know
    """

    nodes: np.ndarray
    tets: np.ndarray
    sets: dict = field(default_factory=dict)
    solids: dict = field(default_factory=dict)
    aside: dict = field(default_factory=dict)
    notes: tuple = ()


def plain(raw, where):
    """Return (nodes (n, 3), tets (m, 4), sets, notes) of a RawMesh.

    Ten-node tetrahedra are taken by their corners, whose order stays; the solver puts nodes of
    its own on the edges. Nodes that belong to what is left out go, the others stay.
    where : file name, for the MeshError
    """
    nodes, tets, notes = np.asarray(raw.nodes, dtype=float), raw.tets, list(raw.notes)
    if nodes.ndim != 2 or nodes.shape[1] != 3:
        raise MeshError(f'{where}: nodes have shape {nodes.shape}; must be (n, 3)')
    corners = np.ascontiguousarray(tets[:, :4], dtype=np.int64)
    if not len(corners):
        held = _listed(raw) or 'no element of a volume'
        raise MeshError(f'{where}: no tetrahedra; it holds {held}; '
                        'must hold tetrahedra of 4 or 10 nodes; a surface is meshed with '
                        '`arm-brachy mesh`, hexahedra are split where the mesh is made')
    if raw.solids:
        raise MeshError(f'{where}: holds {_listed(raw)} beside {len(corners)} tetrahedra; must '
                        'hold tetrahedra only: mesh the whole body with them')
    bad = np.flatnonzero(((tets < 0) | (tets >= len(nodes))).any(axis=1))
    if len(bad):
        raise MeshError(f'{where}: element {bad[0]} names nodes {tets[bad[0]].tolist()} '
                        f'({len(bad)} such); must be 0 to {len(nodes) - 1} (counted from 0)')
    going = [raw.aside[name][1] for name in raw.aside]
    if tets.shape[1] == 10:
        _check_middles(nodes, tets, where, notes)
        going.append(tets[:, 4:].ravel())
    elsewhere = {name: kind for name, kind in raw.aside.items() if not np.isin(
        kind[1], corners).all()}
    if elsewhere:
        notes.append(f'left out beside {len(corners)} tetrahedra: '
                     + ', '.join(f'{count} {name}' for name, (count, _) in elsewhere.items()))
    gone = np.setdiff1d(np.concatenate([np.zeros(0, dtype=np.int64), *going]), corners)
    if not len(gone):
        return nodes, corners, raw.sets, tuple(notes)
    kept = np.setdiff1d(np.arange(len(nodes)), gone)
    new = np.full(len(nodes), -1)
    new[kept] = np.arange(len(kept))
    sets = {name: new[members][new[members] >= 0] for name, members in raw.sets.items()}
    return nodes[kept], new[corners], sets, tuple(notes)


def _listed(raw):
    counts = raw.solids | {name: count for name, (count, _) in raw.aside.items()}
    return ', '.join(f'{count} {name}' for name, count in counts.items())


def _check_middles(nodes, tets, where, notes):
    """Refuse what is no node of an edge; a note on curved edges."""
    ends = nodes[tets[:, :4]][:, EDGE_ENDS]
    middles = ends.mean(axis=2)
    length = np.maximum(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2),
                        np.finfo(float).tiny)
    share = np.stack([(np.linalg.norm(nodes[tets[:, k]][:, None] - middles, axis=2) / length)
                      .min(axis=1) for k in range(4, 10)], axis=1)
    if not share.max() <= CROOKED:
        element, k = np.argwhere(~(share <= CROOKED))[0]
        raise MeshError(f'{where}: node {tets[element, 4 + k]} of element {element} is '
                        f'{share[element, k]:.2g} edge lengths off the middle of an edge; must be '
                        f'within {CROOKED:g}; are the first four nodes the corners?')
    kind = f'{len(tets)} ten-node tetrahedra read by their corners'
    notes.append(kind if share.max() <= STRAIGHT else
                 f'{kind}; {np.count_nonzero(share > STRAIGHT)} of their edges are curved, by '
                 f'up to {100 * share.max():.2g} % of their length, and are made straight')
