"""Closed surface to tetrahedra, how good they are, and the file they go to.

The mesher is fTetWild (Hu et al., ACM Trans. Graph. 39(4), 2020; MPL-2.0) through `pytetwild`: it
takes any closed surface and keeps it within an envelope. It draws from the operating system's
entropy, so two calls give two meshes of equal quality and slightly different counts (upstream
issue fTetWild#72): a mesh file, once written, is an input to be kept, not a product to be remade.
"""

import contextlib
import tempfile
from dataclasses import dataclass

import igl
import numpy as np
import pytetwild
import trimesh

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.element import EDGES, signed_volumes
from arm_brachy.tissue.mesh import boundary_faces
from arm_brachy.tissue.surface import read_surface

# Beyond this neither solver nor file is of use on a workstation.
MOST_TETS = 500_000
# Regular tetrahedron: volume over cubed edge length, to foresee how many are needed.
REGULAR_VOLUME = 1.0 / (6.0 * np.sqrt(2.0))
# The two corners that each of EDGES does not touch.
OPPOSITE = EDGES[::-1]
# Two coarse meshes of one edge length differ in their counts by up to this (fine ones by 1 %).
SCATTER = 0.2

@dataclass(frozen=True)
class MeshReport:
    """What came of a meshing, and how good the elements are. SI.

    edge_length : the length asked for [m];  volume : of the tetrahedra [m^3]
    volume_error : (mesh - surface) / surface volume
    surface_distance : largest distance between given surface and mesh boundary, both ways [m]
    min_quality, mean_quality : mean ratio 12 (3V)^(2/3) / sum l^2 (1 = regular, 0 = flat)
    min_dihedral, max_dihedral : [rad]
    shortest_edge, longest_edge : [m]
    repairs : what was put right in the surface before meshing
    """

    n_nodes: int
    n_tets: int
    edge_length: float
    volume: float
    volume_error: float
    surface_distance: float
    min_quality: float
    mean_quality: float
    min_dihedral: float
    max_dihedral: float
    shortest_edge: float
    longest_edge: float
    repairs: tuple = ()

    def rows(self):
        """The figures as a mapping for tables and JSON, units in the key names."""
        return {
            'nodes': self.n_nodes,
            'tetrahedra': self.n_tets,
            'edge_length_mm': round(self.edge_length * 1e3, 4),
            'volume_ml': round(self.volume * 1e6, 3),
            'volume_error_percent': round(self.volume_error * 100, 3),
            'surface_distance_mm': round(self.surface_distance * 1e3, 4),
            'min_quality': round(self.min_quality, 4),
            'mean_quality': round(self.mean_quality, 4),
            'min_dihedral_deg': round(float(np.degrees(self.min_dihedral)), 2),
            'max_dihedral_deg': round(float(np.degrees(self.max_dihedral)), 2),
            'shortest_edge_mm': round(self.shortest_edge * 1e3, 4),
            'longest_edge_mm': round(self.longest_edge * 1e3, 4),
            'repairs': '; '.join(self.repairs) or 'none',
        }


def mesh_surface(source, *, edge_length, unit='mm', envelope=0.03):
    """Fill a closed surface with tetrahedra.

    source, unit : see `read_surface`;  edge_length : wished for inside [m]
    envelope : how far the mesh boundary may leave the surface, as a fraction of edge_length; a
        tight one brings small elements wherever the surface is strongly curved
    Returns (TetMesh in metres and positively oriented, MeshReport). Counts vary by about 1 % and
    corner positions by the envelope from call to call (see the module's docstring).
    Raises MeshError for a bad surface or edge length, or if the mesher gives up. The process's
    working directory changes during the call: not for use beside other threads.
    """
    surface, repairs = read_surface(source, unit=unit)
    check_edge_length(surface, edge_length)
    return _mesh(surface, edge_length, envelope, repairs)


def mesh_with_count(source, *, tets=None, nodes=None, unit='mm', envelope=0.03, tolerance=0.005,
                    tries=20):
    """Fill a closed surface with about so many tetrahedra or nodes.

    tets, nodes : the count wished for (give one);  tolerance : relative, on that count
    tries : meshes made at most
    Returns (TetMesh, MeshReport) of the first mesh within the tolerance. Raises MeshError if none
    of the tries is. Count and edge length follow N ~ l^-3 only roughly, hence the search; where
    few elements lie across a body they do not at all (0.4 to 3 times as many), and it scans.
    """
    if (tets is None) == (nodes is None):
        raise MeshError(f'tets = {tets}, nodes = {nodes}; exactly one of them must be given')
    wanted = tets if tets is not None else nodes
    surface, repairs = read_surface(source, unit=unit)
    edge_length = _first_guess(surface, tets if tets is not None else 4.5 * nodes)
    allowed = _edge_length_range(surface)
    tried = {}
    for _ in range(tries):
        edge_length = float(np.clip(edge_length, *allowed))
        mesh, report = _mesh(surface, edge_length, envelope, repairs)
        tried[edge_length] = report.n_tets if tets is not None else report.n_nodes
        if abs(tried[edge_length] - wanted) <= tolerance * wanted:
            return mesh, report
        edge_length = _next_length(tried, edge_length, wanted, allowed)
    nearest = min(tried.values(), key=lambda n: abs(n - wanted))
    raise MeshError(f'{tries} meshes, the nearest with {nearest:.0f} instead of {wanted}; must be '
                    f'within {tolerance:.2%}; raise tolerance, tries or envelope')


def report_of(surface, mesh, edge_length, repairs=()):
    """Return the MeshReport of a TetMesh that was made of a trimesh.Trimesh [m].

    edge_length : asked for [m];  repairs : to the surface, see `read_surface`
    """
    quality, angles = mean_ratio(mesh), dihedral_angles(mesh)
    corners = mesh.nodes[mesh.tets]
    edges = np.linalg.norm(corners[:, EDGES[:, 1]] - corners[:, EDGES[:, 0]], axis=2)
    volume = float(signed_volumes(mesh.nodes, mesh.tets).sum())
    return MeshReport(
        n_nodes=len(mesh.nodes), n_tets=len(mesh.tets), edge_length=float(edge_length),
        volume=volume, volume_error=float(volume / surface.volume - 1.0),
        surface_distance=_distance(surface, mesh),
        min_quality=float(quality.min()), mean_quality=float(quality.mean()),
        min_dihedral=float(angles.min()), max_dihedral=float(angles.max()),
        shortest_edge=float(edges.min()), longest_edge=float(edges.max()), repairs=repairs)


def mean_ratio(mesh):
    """Mean-ratio quality (m,) of the elements: 1 = regular, 0 = flat, negative = inverted.

    mesh : TetMesh.  Source: Liu and Joe, BIT 34, 1994, eq. 2.
    """
    corners, volume = mesh.nodes[mesh.tets], signed_volumes(mesh.nodes, mesh.tets)
    edges = corners[:, EDGES[:, 1]] - corners[:, EDGES[:, 0]]
    squares = np.einsum('mij,mij->m', edges, edges)
    return np.sign(volume) * 12.0 * np.cbrt(3.0 * np.abs(volume)) ** 2 / squares


def dihedral_angles(mesh):
    """Dihedral angles at the six edges of every element, (m, 6) [rad].

    mesh : TetMesh with no flat element.
    """
    corners = mesh.nodes[mesh.tets]
    start, axis = corners[:, EDGES[:, 0]], corners[:, EDGES[:, 1]] - corners[:, EDGES[:, 0]]
    axis = axis / np.linalg.norm(axis, axis=2, keepdims=True)
    sides = [corners[:, OPPOSITE[:, k]] - start for k in (0, 1)]
    across = [s - np.einsum('mei,mei->me', s, axis)[..., None] * axis for s in sides]
    normals = np.linalg.norm(np.cross(*across), axis=2)
    return np.arctan2(normals, np.einsum('mei,mei->me', *across))


def _edge_length_range(surface):
    """Shortest (MOST_TETS elements) and longest (one across the thinnest extent) edge [m]."""
    return np.cbrt(surface.volume / (REGULAR_VOLUME * MOST_TETS)), surface.extents.min()


def check_edge_length(surface, edge_length):
    """Raise MeshError for an edge length [m] with which no sensible mesh of a surface is made."""
    shortest, longest = _edge_length_range(surface)
    if not shortest <= edge_length <= longest:  # NaN fails too
        raise MeshError(f'edge_length = {edge_length * 1e3:.4g} mm; must be {shortest * 1e3:.3g} '
                        f'to {longest * 1e3:.3g} mm (at most {MOST_TETS} tetrahedra, at least one '
                        'across the thinnest extent)')


def _first_guess(surface, n_tets):
    return float(np.cbrt(surface.volume / (REGULAR_VOLUME * n_tets)))


def _next_length(tried, last, wanted, allowed):
    """Edge length to try after `last` [m]: by N ~ l^-3, or where that led to a wrong count before.

    tried : {edge length: count};  allowed : shortest and longest [m]
    A length within 1 % of one whose count was off by more than SCATTER is not tried again,
    but the middle of the widest gap between lengths tried, two thirds to three halves of them.
    """
    wish = np.clip(last * np.cbrt(tried[last] / wanted), *allowed)
    wrong = [length for length, n in tried.items() if abs(n - wanted) > SCATTER * wanted]
    if all(abs(wish - length) > 0.01 * length for length in wrong):
        return wish
    ends = np.clip([min(tried) / 1.5, max(tried) * 1.5], *allowed)
    lengths = np.unique(np.concatenate([list(tried), ends]))
    widest = np.argmax(np.diff(np.log(lengths)))
    return np.sqrt(lengths[widest] * lengths[widest + 1])


def _mesh(surface, edge_length, envelope, repairs):
    mesh = positive(*tetrahedralize(surface, edge_length, envelope * edge_length))
    return mesh, report_of(surface, mesh, edge_length, repairs)


def tetrahedralize(surface, edge_length, envelope):
    """Return (nodes (n, 3) [m], tets (m, 4)) of one call of the mesher, corners in its order.

    surface : trimesh.Trimesh [m];  edge_length, envelope : [m]. Raises MeshError if it gives up.
    """
    try:
        # The mesher leaves a file of its own in the working directory, so it gets one to itself.
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            nodes, tets = pytetwild.tetrahedralize(
                np.ascontiguousarray(surface.vertices),
                np.ascontiguousarray(surface.faces, np.int32),
                edge_length_abs=float(edge_length),
                epsilon=float(envelope / np.linalg.norm(surface.extents)), num_threads=1,
                quiet=True)
    except RuntimeError as error:
        raise MeshError(f'the mesher gave up: {error}; try another edge length') from None
    if len(tets) == 0:
        raise MeshError('the mesher returned no element; try another edge length')
    return np.asarray(nodes, float), np.asarray(tets, np.int64)


def positive(nodes, tets):
    """Return the TetMesh with corners so that volumes are positive, without unused nodes."""
    inverted = signed_volumes(nodes, tets) < 0.0
    tets[inverted] = tets[inverted][:, [0, 2, 1, 3]]
    used, tets = np.unique(tets, return_inverse=True)
    return TetMesh(nodes[used], tets.reshape(-1, 4))


def _distance(surface, mesh):
    """Largest distance between two triangulations, at corners and face centres, both ways [m]."""
    outer = trimesh.Trimesh(mesh.nodes, boundary_faces(mesh), process=False)
    ways = [(outer, surface), (surface, outer)]
    return float(np.sqrt(max(_farthest_squared(a, b) for a, b in ways)))


def _farthest_squared(points_of, other):
    corners = points_of.vertices[np.unique(points_of.faces)]
    points = np.vstack([corners, points_of.triangles_center])
    squared = igl.point_mesh_squared_distance(points, np.ascontiguousarray(other.vertices),
                                              np.ascontiguousarray(other.faces, np.int64))[0]
    return np.max(squared)
