"""Smaller elements where they are needed: longest-edge bisection, sizes by distance from rims."""

from dataclasses import replace

import igl
import numpy as np
from scipy.spatial import cKDTree

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.element import EDGES
from arm_brachy.tissue.mesh import FACE_EDGES, boundary_faces
from arm_brachy.tissue.meshing import mean_ratio
from arm_brachy.tissue.rims import at_radius, not_flat, outline, refuse_quadratic, rim

MOST_ROUNDS = 40     # each halves the longest edges there are; 40 of them is a lost cause
STAY = 0.25          # mean ratio below which a new node stays where it was, off rim or surface


# ---- bisection

def refine(mesh, marked):
    """Bisect the marked elements at their longest edges, and whatever else that asks for.

    mesh : TetMesh of linear elements;  marked : (m,) bool or element indices
    Returns (TetMesh, parents (k, 2)): old nodes keep their numbers, the k new ones follow, each in
    the middle of the edge between its parents (which may be new themselves). A node set gains the
    middles of edges between two of its nodes; a set of surface nodes those of surface edges only.
    Longest-edge bisection (Rivara 1984, Int J Numer Methods Eng 20:745): elements grow flatter
    only for the first few generations, in practice (test); no bound is proved in three dimensions.
    Ties go to the edge of lower node numbers, so equal meshes give equal meshes.
    """
    refuse_quadratic(mesh)
    nodes, tets = mesh.nodes, mesh.tets
    todo = np.zeros(len(tets), dtype=bool)
    todo[marked] = True
    split, middle, parents = np.zeros(0, np.int64), np.zeros(0, np.int64), [np.zeros((0, 2), int)]
    while todo.any():
        mine, rows = np.flatnonzero(todo), np.arange(todo.sum())
        corners = tets[mine]
        longest = _longest(nodes, corners)
        codes = _codes(corners)[rows, longest]
        new = np.setdiff1d(codes, split)
        ends = np.stack(np.divmod(new, _BASE), axis=1)
        split, middle = _merged(split, new, middle, len(nodes) + np.arange(len(new)))
        nodes = np.vstack([nodes, nodes[ends].mean(axis=1)])
        parents.append(ends)
        at = middle[np.searchsorted(split, codes)]
        halves = corners.copy(), corners.copy()
        for half, end in zip(halves, (1, 0), strict=True):
            half[rows, EDGES[longest, end]] = at
        tets = tets.copy()
        tets[mine] = halves[0]
        tets = np.vstack([tets, halves[1]])
        todo = np.isin(_codes(tets), split).any(axis=1)
    parents = np.concatenate(parents)
    return TetMesh(nodes, tets, _grown_sets(mesh, parents)), parents


_BASE = 1 << 31  # an edge as one number: lower node times this plus the higher


def _codes(tets):
    low, high = np.moveaxis(np.sort(tets[:, EDGES], axis=2), 2, 0)
    return low * _BASE + high


def _longest(nodes, tets):
    """Local edge (m,) that is longest, to a relative 1e-9; then that of the lowest nodes."""
    lengths = _lengths(nodes, tets)
    tied = lengths >= (1.0 - 1e-9) * lengths.max(axis=1, keepdims=True)
    return np.where(tied, _codes(tets), np.iinfo(np.int64).max).argmin(axis=1)


def _lengths(nodes, tets):
    return np.linalg.norm(nodes[tets[:, EDGES[:, 0]]] - nodes[tets[:, EDGES[:, 1]]], axis=2)


def _merged(keys, new_keys, values, new_values):
    keys, values = np.concatenate([keys, new_keys]), np.concatenate([values, new_values])
    order = np.argsort(keys)
    return keys[order], values[order]


def _grown_sets(mesh, parents):
    """Node sets with the new nodes that belong to them, parents first."""
    n, on_surface = len(mesh.nodes), _Edges(boundary_faces(mesh)[:, FACE_EDGES].reshape(-1, 2))
    outer = [on_surface.take(first + n, ends) for first, ends in enumerate(parents)]
    grown = {}
    for name, nodes in mesh.node_sets.items():
        member = np.zeros(n + len(parents), dtype=bool)
        member[nodes] = True
        surface_only = np.isin(nodes, boundary_faces(mesh)).all()
        for first, ends in enumerate(parents):
            member[n + first] = member[ends].all() and (outer[first] or not surface_only)
        grown[name] = np.flatnonzero(member)
    return grown


class _Edges:
    """A set of edges that knows its halves when one of its edges is split."""

    def __init__(self, pairs):
        self._known = {(int(a), int(b)) for a, b in np.sort(pairs, axis=1)}

    def take(self, middle, ends):
        """True if the edge between `ends` is known; its two halves are known from then on."""
        a, b = sorted(map(int, ends))
        if (a, b) not in self._known:
            return False
        self._known |= {(a, int(middle)), (b, int(middle))}
        return True


# ---- grading

def grade(mesh, size, *, patches=(), surface=None):
    """Bisect elements until none has an edge longer than wished where it is.

    mesh : TetMesh of linear elements, node numbers kept (see `refine`)
    size : points (k, 3) [m] -> longest edge wished (k,) [m], asked at element centres
    patches : core.scene.PadPatch whose rims are edges of the mesh; nodes that halve such an edge
        go onto the rim, so that the outline comes nearer to the circle
    surface : trimesh.Trimesh [m]; new surface nodes go to its nearest point. None: they stay
    A node stays between its parents if the move would make an element flatter than STAY.
    Returns TetMesh. Raises MeshError if an element comes out flatter than FLATTEST, or 40 rounds
    do not suffice (`size` too small).
    """
    for _ in range(MOST_ROUNDS):
        longest = _lengths(mesh.nodes, mesh.tets).max(axis=1)
        large = longest > size(mesh.nodes[mesh.tets].mean(axis=1))
        if not large.any():
            return not_flat(mesh)
        outlines = [_Edges(outline(mesh, patch)) for patch in patches]
        first = len(mesh.nodes)
        mesh, parents = refine(mesh, large)
        nodes = _onto_surface(mesh, first, surface)
        for patch, edges in zip(patches, outlines, strict=True):
            on = [first + k for k, ends in enumerate(parents) if edges.take(first + k, ends)]
            nodes[on] = at_radius(nodes[on], patch)
        mesh = moved(mesh, nodes)
    raise MeshError(f'after {MOST_ROUNDS} rounds of bisection {large.sum()} elements are still '
                    'larger than wished; raise the wished size')


def near_rims(mesh, patches, edge_length, *, growth=1.0, largest=np.inf):
    """Return the size function for `grade` of elements that grow with the distance from the rims.

    mesh : TetMesh;  patches : PadPatch;  edge_length : longest edge at the rims [m]
    growth : metres of size per metre of distance beyond that;  largest : anywhere [m]
    """
    tree = cKDTree(np.vstack([rim(mesh, patch) for patch in patches]))

    def size(points):
        away = np.maximum(tree.query(points)[0] - edge_length, 0.0)
        return np.minimum(edge_length + growth * away, largest)
    return size


def moved(mesh, nodes, least=STAY):
    """Return the mesh with nodes at `nodes` (n, 3) but for those that would flatten an element.

    least : mean ratio below which its nodes stay, unless it was below and gets no flatter
    """
    target, before = nodes.copy(), mean_ratio(mesh)
    while True:
        new = replace(mesh, nodes=target)
        mine = (target != mesh.nodes).any(axis=1)
        bad = (mean_ratio(new) < np.minimum(least, before)) & mine[mesh.tets].any(axis=1)
        if not bad.any():
            return new
        back = np.unique(mesh.tets[bad])
        target[back] = mesh.nodes[back]


def _onto_surface(mesh, first, surface):
    """Nodes, the surface ones from number `first` on moved to the nearest point of `surface`."""
    nodes = mesh.nodes.copy()
    if surface is not None:
        outer = np.unique(boundary_faces(mesh))
        outer = outer[outer >= first]
        nodes[outer] = nearest_on(surface, nodes[outer])
    return nodes


def nearest_on(surface, points):
    """Return the points (k, 3) of a trimesh.Trimesh nearest to points (k, 3)."""
    if not len(points):
        return points
    return igl.point_mesh_squared_distance(
        np.ascontiguousarray(points), np.ascontiguousarray(surface.vertices),
        np.ascontiguousarray(surface.faces, np.int64))[2]
