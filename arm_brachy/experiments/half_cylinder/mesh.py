"""The laboratory's mesh: Gmsh's straight tetrahedra bent to the round surfaces, 10 nodes each.

The file is config/scenes/half_cylinder/laboratory.msh, made from laboratory.geo beside it.
"""

import contextlib
import io
from dataclasses import dataclass, replace

import meshio
import numpy as np

from arm_brachy.core.paths import config_dir
from arm_brachy.experiments.half_cylinder.layout import MM, PADS, RADIUS

# Corners between which the nodes 4 to 9 lie, and of a face the nodes 3 to 5.
EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
FACE_EDGES = EDGES[:3]
RIM = 8.5 * MM                                  # of the pads in the mesh; see README.md
LUMP = (MM * np.array([-18.0, 12.0, 17.0]), 12 * MM)    # centre and radius [m]
NEAR, FAR = 12 * MM, 23 * MM    # of a pad that sits aside, the tissue's mesh goes with it


@dataclass(frozen=True)
class Mesh:
    """Tetrahedra with 10 nodes.

    nodes : (n, 3) [m];  tets : (e, 10)
    faces : name -> (f, 6), of `side`, `base`, each pad, and `skin`, the lump's
    lump : (e,) bool, those within the sphere LUMP
    """

    nodes: np.ndarray
    tets: np.ndarray
    faces: dict
    lump: np.ndarray

    def patch(self, pad):
        """Nodes that a pad of a name carries."""
        return np.unique(self.faces[pad])


def load_mesh():
    """The Mesh of the file."""
    with contextlib.redirect_stdout(io.StringIO()):     # meshio prints an empty line
        raw = meshio.read(config_dir() / 'scenes' / 'half_cylinder' / 'laboratory.msh')
    group = {name: number for name, (number, _) in raw.field_data.items()}
    tags, of_tets = (raw.get_cell_data('gmsh:physical', kind) for kind in ('triangle', 'tetra'))
    triangles = {name: raw.cells_dict['triangle'][tags == group[name]]
                 for name in ('side', 'base', 'skin', *(pad.name for pad in PADS))}
    return bent(with_middles(raw.points * MM, raw.cells_dict['tetra'], triangles,
                             of_tets == group['lump']))


def with_middles(corners, tets, triangles, lump):
    """The Mesh of straight tetrahedra (e, 4), with a node in the middle of every edge.

    corners : (n, 3) [m];  triangles : name -> (f, 3);  lump : (e,) bool
    """
    count, size = len(corners), np.int64(len(corners))
    keys = np.unique(_keys(tets, EDGES, size))

    def completed(cells, pairs):
        return np.hstack([cells, count + np.searchsorted(keys, _keys(cells, pairs, size))])

    ends = np.stack(np.divmod(keys, size), axis=1)
    return Mesh(np.concatenate([corners, corners[ends].mean(axis=1)]), completed(tets, EDGES),
                {name: completed(some, FACE_EDGES) for name, some in triangles.items()}, lump)


def _keys(cells, pairs, size):
    """One number per edge of cells (m, corners), of the less and the greater of its ends."""
    ends = np.sort(cells[:, pairs], axis=-1)
    return ends[..., 0] * size + ends[..., 1]


def bent(mesh):
    """The Mesh with the middles of edges on round surfaces moved onto them."""
    nodes = mesh.nodes.copy()
    middles = {name: np.unique(some[:, 3:]) for name, some in mesh.faces.items()}
    for pad in PADS:
        rim = np.intersect1d(middles[pad.name], middles['side'])
        nodes[rim] = _onto_rim(nodes[rim], pad)
    for name in ('side', *(pad.name for pad in PADS)):
        nodes[middles[name]] = _onto_side(nodes[middles[name]])
    off = nodes[middles['skin']] - LUMP[0]
    nodes[middles['skin']] = LUMP[0] + LUMP[1] * off / np.linalg.norm(off, axis=1)[:, None]
    return replace(mesh, nodes=nodes)


def _onto_side(points):
    """Points (n, 3) moved onto the round side, at right angles to the axis."""
    across = points[:, 1:] / np.linalg.norm(points[:, 1:], axis=1)[:, None]
    return np.hstack([points[:, :1], RADIUS * across])


def _onto_rim(points, pad):
    """Points (n, 3) near a pad's rim moved onto it, by turns onto its cylinder and the side."""
    for _ in range(20):     # the surfaces meet at right angles: two digits gained each time
        off = points - pad.centre
        depth = np.outer(off @ pad.direction, pad.direction)
        out = off - depth
        points = _onto_side(pad.centre + depth
                            + RIM * out / np.linalg.norm(out, axis=1)[:, None])
    return points


def aside(mesh, name, shift):
    """The Mesh with the pad of a name `shift` [m] aside along x, the mesh around it with it.

    Along x the side is straight, so nothing of the body changes but where the pad is.
    """
    centre = next(pad.centre for pad in PADS if pad.name == name)
    away = (np.linalg.norm(mesh.nodes - centre, axis=1) - NEAR) / (FAR - NEAR)
    part = np.clip(1.0 - away, 0.0, 1.0)
    nodes = mesh.nodes.copy()
    nodes[:, 0] += shift * part * part * (3.0 - 2.0 * part)
    return replace(mesh, nodes=nodes)
