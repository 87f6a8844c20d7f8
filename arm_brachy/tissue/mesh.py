"""Tetrahedral meshes: reading, surface, quality, and points that ride on them."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array

from arm_brachy.core.errors import MeshError
from arm_brachy.core.guard import file_bytes, guarded
from arm_brachy.core.quantity import UNITS
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.element import (
    EDGES,
    FACES,
    edge_matrices,
    shape_slopes,
    shape_values,
    signed_volumes,
)
from arm_brachy.tissue.formats import abaqus, gmsh, nastran
from arm_brachy.tissue.formats.abaqus import read_abaqus
from arm_brachy.tissue.formats.gmsh import is_gmsh, read_gmsh
from arm_brachy.tissue.formats.nastran import read_nastran
from arm_brachy.tissue.formats.other import read_other
from arm_brachy.tissue.formats.raw import RawMesh, plain
from arm_brachy.tissue.mesh_check import check_mesh
from arm_brachy.tissue.triangle import closest_points

# The centre of a 4 mm facial marker (thesis ch. 4) is 2 mm off the skin; the rest allows for its
# foot and for the difference between the skin and the flat faces of a coarse mesh.
STANDOFF = 8e-3  # m
# Barycentric coordinates this far below zero are rounding, not outside.
INSIDE = -1e-9
FACE_EDGES = np.array([[0, 1], [1, 2], [2, 0]])


def load_mesh(path, unit='m'):
    """Read a tetrahedral mesh; nodes and elements keep the file's order.

    path : Gmsh 2.2 or 4.1 (.msh), Abaqus (.inp), Nastran (.bdf), any other format meshio reads,
        or .npz with `nodes` (n, 3), `tets` (m, 4) and node sets: 1-D integer arrays of distinct
        node indices (others, such as tag tables, are left out)
    unit : 'm' or 'mm', the file's length unit
    Returns TetMesh in metres, with notes on what was left out. Named point sets and gmsh physical
    groups (`name`, or `surface_<tag>`, `volume_<tag>`) become node sets. Ten-node tetrahedra are
    read by their corners (`formats.raw`).
    Raises MeshError naming file, element and remedy; see `mesh_check.check_mesh`.
    """
    return check_mesh(read_mesh(path, unit), str(path))


def read_mesh(path, unit='m'):
    """`load_mesh` without looking at what was read. Raises MeshError if it cannot be read."""
    path = Path(path)
    if not path.is_file():
        raise MeshError(f'{path}: no such file; give the path of a tetrahedral mesh')
    nodes, tets, sets, notes = plain(_raw(path), str(path))
    scaled = np.ascontiguousarray(nodes, dtype=float) * UNITS[unit][0]
    return TetMesh(scaled, np.ascontiguousarray(tets, dtype=np.int64), sets, notes=notes)


def _raw(path):
    """The formats.raw.RawMesh of a file."""
    kind = path.suffix.lower()
    if kind == '.npz':
        with guarded(path, MeshError, 'a readable .npz file', 'save it again by numpy.savez'):
            return _read_npz(path)
    if kind == '.inp':
        with guarded(path, MeshError, 'a readable Abaqus input file', abaqus.ADVICE):
            return read_abaqus(path)
    if kind in ('.bdf', '.nas', '.fem', '.dat'):
        with guarded(path, MeshError, 'a readable Nastran file', nastran.ADVICE):
            return read_nastran(file_bytes(path, MeshError), str(path))
    if kind == '.msh' and is_gmsh(data := file_bytes(path, MeshError)):
        with guarded(path, MeshError, 'a readable Gmsh file', gmsh.ADVICE):
            return read_gmsh(data, str(path))
    return read_other(path)


def _read_npz(path):
    with np.load(path) as file:
        data = {name: file[name] for name in file.files}
    missing = [name for name in ('nodes', 'tets') if name not in data]
    if missing:
        raise MeshError(f'{path}: no array {missing[0]!r}; must hold nodes (n, 3) and tets '
                        f'(m, 4); it holds {", ".join(data)}')
    nodes, tets = data.pop('nodes'), data.pop('tets')
    if nodes.dtype.kind not in 'iuf' or tets.dtype.kind not in 'iu' or tets.ndim != 2:
        raise MeshError(f'{path}: nodes of type {nodes.dtype} and tets of type {tets.dtype} and '
                        f'shape {tets.shape}; must be numbers (n, 3) and whole numbers (m, 4)')
    sets = {name: np.sort(a).astype(np.int64) for name, a in data.items()
            if a.ndim == 1 and a.dtype.kind in 'iu' and len(np.unique(a)) == len(a)}
    return RawMesh(nodes, tets, sets)


def volumes(mesh):
    """Return the element volumes (m,) [m^3] of a TetMesh."""
    return signed_volumes(mesh.nodes, mesh.tets)


def boundary_faces(mesh):
    """Return the boundary triangles (f, 3) of a TetMesh, normals outward, ordered by element."""
    return _boundary(mesh.tets)[0]


def _boundary(tets):
    """Boundary triangles (f, 3) and the element each belongs to (f,)."""
    faces = tets[:, FACES].reshape(-1, 3)
    code = np.sort(faces, axis=1) @ (tets.max() + 1) ** np.arange(3)    # a face as one number
    _, first, count = np.unique(code, return_index=True, return_counts=True)
    keep = np.sort(first[count == 1])
    return faces[keep], keep // len(FACES)


def quadratic_mesh(mesh):
    """Return the TetMesh with a node in the middle of every edge, elements quadratic.

    mesh : TetMesh; returned as it is if it has midside nodes already. Corners keep their numbers.
    A node set gains the middles of surface edges between two of its nodes, so that what was held
    along linear elements is held now.
    """
    if mesh.midside is not None:
        return mesh
    n, pairs = len(mesh.nodes), np.sort(mesh.tets[:, EDGES], axis=2)
    edges, which = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    full = TetMesh(np.vstack([mesh.nodes, mesh.nodes[edges].mean(axis=1)]), mesh.tets, {},
                   n + which.reshape(-1, len(EDGES)), mesh.notes)
    sets = {name: with_midside(full, nodes) for name, nodes in mesh.node_sets.items()}
    return replace(full, node_sets=sets)


def with_midside(mesh, nodes):
    """Return `nodes` (k,) and the middles of the surface edges that join two of them, sorted.

    mesh : TetMesh. Unchanged where the mesh has no midside nodes.
    """
    nodes = np.unique(nodes)
    if mesh.midside is None:
        return nodes
    edges, middles = surface_edges(mesh)
    return np.union1d(nodes, middles[np.isin(edges, nodes).all(axis=1)])


def surface_edges(mesh):
    """Return the edges (e, 2) of the boundary of a quadratic TetMesh and their middles (e,)."""
    faces = boundary_faces(mesh)
    edges = np.sort(faces[:, FACE_EDGES], axis=2).reshape(-1, 2)
    edges, first = np.unique(edges, axis=0, return_index=True)
    return edges, face_middles(mesh, faces).ravel()[first]


def face_middles(mesh, faces):
    """Return the middles (f, 3) of the edges 01, 12, 20 of faces (f, 3) of a quadratic TetMesh."""
    code = np.array([len(mesh.nodes), 1])  # an edge as one number
    known, first = np.unique(np.sort(mesh.tets[:, EDGES], axis=2) @ code, return_index=True)
    at = np.searchsorted(known, np.sort(faces[:, FACE_EDGES], axis=2) @ code)
    return mesh.midside.ravel()[first[at]]


def surface_triangles(mesh):
    """Return triangles (t, 3) of nodes on the boundary, outward; four a face of quadratic ones."""
    faces = boundary_faces(mesh)
    if mesh.midside is None:
        return faces
    (a, b, c), (ab, bc, ca) = faces.T, face_middles(mesh, faces).T
    return np.vstack([np.column_stack(t) for t in
                      ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


@dataclass(frozen=True)
class MeshQuality:
    """Figures a person judges a mesh by. SI; angles in radians.

    radius_ratio : 3 inscribed radius / circumscribed radius, 1 for a regular tetrahedron
    """

    n_nodes: int
    n_tets: int
    volume: float
    min_radius_ratio: float
    median_radius_ratio: float
    min_dihedral: float
    min_edge: float
    median_edge: float
    max_edge: float


def quality(mesh):
    """Return the MeshQuality of a TetMesh."""
    corners = mesh.nodes[mesh.tets]
    lengths = np.linalg.norm(corners[:, EDGES[:, 0]] - corners[:, EDGES[:, 1]], axis=-1)
    ratio = _radius_ratios(corners, volumes(mesh))
    all_edges = np.sort(mesh.tets[:, EDGES].reshape(-1, 2), axis=1)
    _, once = np.unique(all_edges, axis=0, return_index=True)
    each = lengths.ravel()[once]
    return MeshQuality(len(mesh.nodes), len(mesh.tets), float(volumes(mesh).sum()),
                       float(ratio.min()), float(np.median(ratio)), _min_dihedral(corners),
                       float(each.min()), float(np.median(each)), float(each.max()))


def _area_vectors(corners):
    """(m, 4, 3) outward area vectors of the four faces [m^2]."""
    a, b, c = (corners[:, FACES[:, i]] for i in range(3))
    return 0.5 * np.cross(b - a, c - a)


def _radius_ratios(corners, volume):
    inscribed = 3.0 * volume / np.linalg.norm(_area_vectors(corners), axis=-1).sum(axis=1)
    edges = corners[:, 1:] - corners[:, :1]
    # circumcentre c relative to node 0: 2 e . c = |e|^2 for the three edges e
    centre = np.linalg.solve(2.0 * edges, np.sum(edges ** 2, axis=-1)[..., None])[..., 0]
    return 3.0 * inscribed / np.linalg.norm(centre, axis=-1)


def _min_dihedral(corners):
    normals = _area_vectors(corners)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    cosines = -np.einsum('mei,mei->me', normals[:, EDGES[:, 0]], normals[:, EDGES[:, 1]])
    return float(np.arccos(np.clip(cosines, -1.0, 1.0)).min())


@dataclass(frozen=True)
class Embedding:
    """Points that ride on elements.

    elements : (k,) element index;  nodes : (k, a) its nodes
    weights : (k, a) of the nodes, rows sum to 1; some are negative for points standing off, and
        for quadratic elements
    gradients : (k, a, 3) [1/m] shape gradients dN/dX where the point is attached
    """

    elements: np.ndarray
    nodes: np.ndarray
    weights: np.ndarray
    gradients: np.ndarray

    def matrix(self, n):
        """Return the sparse (k, n) matrix W with W @ x = interpolated points, x (n, 3)."""
        rows = np.repeat(np.arange(len(self.nodes)), self.nodes.shape[1])
        return csr_array((self.weights.ravel(), (rows, self.nodes.ravel())),
                         shape=(len(self.nodes), n))


def embed(mesh, points, *, standoff=STANDOFF, names=None, onto_surface=False):
    """Attach points to the elements that hold them.

    mesh : TetMesh;  points : (k, 3) [m] at rest
    standoff : [m] points outside the body up to this far ride on the nearest surface point, moving
        and turning with it, as a glued marker does
    names : k names for messages;  onto_surface : points attach to the surface point itself and to
        corners only, so that no weight is negative (loads)
    Returns Embedding. Raises MeshError naming the first point farther off than `standoff`.
    """
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    inverse = np.linalg.inv(edge_matrices(mesh.nodes, mesh.tets))
    origin = mesh.nodes[mesh.tets[:, 0]]
    elements = np.zeros(len(points), dtype=np.int64)
    where = points.copy()
    outside = []
    for i, point in enumerate(points):
        weights = _barycentric(inverse, point - origin)
        elements[i] = weights.min(axis=1).argmax()
        if weights[elements[i]].min() < INSIDE:
            outside.append(i)
    if outside:
        nearest, owner = _nearest_on_surface(mesh, points[outside])
        _refuse_far(points[outside], nearest, outside, names, standoff)
        elements[outside], where[outside] = owner, nearest
    weights = _barycentric(inverse[elements], where - origin[elements])
    if onto_surface:
        return _on_corners(mesh, elements, weights, inverse)
    nodes = mesh.connectivity[elements]
    gradients = np.einsum('kal,klj->kaj', shape_slopes(weights, nodes.shape[1]), inverse[elements])
    off = np.einsum('kaj,kj->ka', gradients, points - where)
    return Embedding(elements, nodes, shape_values(weights, nodes.shape[1]) + off, gradients)


def surface_distance(mesh, points):
    """Return how far points (k, 3) [m] are from the surface of a TetMesh: (k,) [m], inside < 0."""
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    nearest, _ = _nearest_on_surface(mesh, points)
    inverse, origin = np.linalg.inv(edge_matrices(mesh.nodes, mesh.tets)), mesh.nodes[
        mesh.tets[:, 0]]
    inside = np.array([_barycentric(inverse, point - origin).min(axis=1).max() >= INSIDE
                       for point in points], dtype=bool)
    return np.where(inside, -1.0, 1.0) * np.linalg.norm(points - nearest, axis=1)


def _on_corners(mesh, elements, weights, inverse):
    weights = np.clip(weights, 0.0, None)
    weights /= weights.sum(axis=1, keepdims=True)
    gradients = shape_slopes(weights, 4) @ inverse[elements]
    return Embedding(elements, mesh.tets[elements], weights, gradients)


def _barycentric(inverse, offset):
    rest = np.einsum('mij,mj->mi', inverse, offset)
    return np.column_stack([1.0 - rest.sum(axis=1), rest])


def _nearest_on_surface(mesh, points):
    """Closest boundary points (k, 3) and the elements (k,) they lie on."""
    faces, owners = _boundary(mesh.tets)
    nearest, owner = np.zeros_like(points), np.zeros(len(points), dtype=np.int64)
    for i, point in enumerate(points):
        candidates = closest_points(mesh.nodes[faces], point)
        best = np.linalg.norm(candidates - point, axis=1).argmin()
        nearest[i], owner[i] = candidates[best], owners[best]
    return nearest, owner


def _refuse_far(points, nearest, index, names, standoff):
    gap = np.linalg.norm(points - nearest, axis=1)
    bad = np.flatnonzero(gap > standoff * (1.0 + 1e-6))  # a mesh is flat up to rounding only
    if len(bad):
        i = index[bad[0]]
        name = names[i] if names is not None else f'point {i}'
        at = ', '.join(f'{1e3 * v:.1f}' for v in points[bad[0]])
        raise MeshError(f'{name} at ({at}) mm is {1e3 * gap[bad[0]]:.1f} mm outside the body; '
                        f'must be within {1e3 * standoff:g} mm; check position and mesh unit')


def interpolate(embedding, x):
    """Return the positions (k, 3) [m] of embedded points, given node positions x (n, 3) [m]."""
    return np.einsum('ka,kai->ki', embedding.weights, x[embedding.nodes])


def rotations(embedding, x):
    """Return the rotations R (k, 3, 3) of the material at embedded points (F = R U, polar).

    x : (n, 3) [m] node positions now. A sensor fixed in the tissue turns by R.
    Valid for elements that are not inverted.
    """
    F = np.einsum('kai,kaj->kij', x[embedding.nodes], embedding.gradients)
    left, _, right = np.linalg.svd(F)
    return left @ right
