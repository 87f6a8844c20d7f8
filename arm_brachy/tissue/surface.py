"""Closed triangulated surfaces: reading them, and refusing what has no inside or no sense."""

import igl
import numpy as np
import trimesh
from igl import predicates

from arm_brachy.core.errors import MeshError
from arm_brachy.core.quantity import UNITS
from arm_brachy.tissue.formats.surface_file import read_surface_file

# A body of this system fits in a hand or on a table; anything else is a mistaken unit.
SMALLEST_EXTENT = 2e-3  # m
LARGEST_EXTENT = 2.0    # m
# Corners closer than this fraction of the diagonal are one corner: an STL repeats each of them.
MERGE_FRACTION = 1e-7
# Enclosed volume over cubed diagonal below which a surface is flat.
FLAT = 1e-6


def read_surface(source, *, unit='mm'):
    """Read and check a closed triangulated surface.

    source : path of an STL, OBJ, PLY or OFF file, or a trimesh.Trimesh;  unit : 'm' or 'mm'
    Returns (trimesh.Trimesh in metres with outward normals, tuple of repairs made).
    Raises MeshError for a file that cannot be read and for a surface that is empty, not finite, of
    an implausible size, open, non-manifold, in several pieces, self-intersecting or flat.
    Only orientation, repeated corners and faces without area are repaired.
    """
    if unit not in ('m', 'mm'):
        raise MeshError(f'unit = {unit!r}; must be m or mm')
    where = str(source) if not isinstance(source, trimesh.Trimesh) else 'surface'
    vertices, faces, notes = _load(source, where)
    vertices = vertices * UNITS[unit][0]
    _check_size(vertices, unit, where)
    vertices, faces, repairs = _merge_corners(vertices, faces, where)
    _check_edges(vertices, faces, where)
    _check_pieces(vertices, faces, where)
    faces = _orient(vertices, faces, repairs, where)
    surface = trimesh.Trimesh(vertices, faces, process=False)
    _check_self_intersections(surface, where)
    return surface, (*notes, *repairs)


def _load(source, where):
    if isinstance(source, trimesh.Trimesh):
        vertices, faces, notes = np.array(source.vertices, float), source.faces, ()
    else:
        vertices, faces, notes = read_surface_file(source)
    faces = np.asarray(faces, dtype=np.int64)
    if len(faces) == 0:
        raise MeshError(f'{where}: 0 triangles; must be a closed triangulated surface')
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise MeshError(f'{where}: corners have shape {vertices.shape}; must be (n, 3)')
    if not np.isfinite(vertices).all():
        raise MeshError(f'{where}: a corner is not finite; every coordinate must be a number')
    if not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise MeshError(f'{where}: a face names corners {faces.min()} to {faces.max()}; must be 0 '
                        f'to {len(vertices) - 1}; export it again')
    return vertices, faces, notes


def _check_size(vertices, unit, where):
    extent = np.ptp(vertices, axis=0).max()
    if not SMALLEST_EXTENT <= extent <= LARGEST_EXTENT:
        raise MeshError(f'{where}: largest extent is {extent:.3g} m read in {unit}; must be '
                        f'{SMALLEST_EXTENT:g} to {LARGEST_EXTENT:g} m; check the unit (m or mm)')


def _merge_corners(vertices, faces, where):
    """Join repeated corners, drop faces that thereby lose their area and corners left unused."""
    grid = MERGE_FRACTION * np.linalg.norm(np.ptp(vertices, axis=0))
    keys = np.round((vertices - vertices.min(axis=0)) / grid).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    faces = inverse.reshape(-1)[faces]
    flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    used, faces = np.unique(faces[~flat], return_inverse=True)
    if len(used) < 4:
        raise MeshError(f'{where}: no triangle has an area; must be a closed surface')
    repairs = [f'{flat.sum()} faces without area dropped'] if flat.any() else []
    return vertices[first[used]], faces.reshape(-1, 3), repairs


def _check_edges(vertices, faces, where):
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    for bad, name, advice in (
            (edges[count == 1], 'open: {} boundary edges', 'close the surface'),
            (edges[count > 2], 'non-manifold: {} edges with more than two faces',
             'remove inner or doubled faces')):
        if len(bad):
            raise MeshError(f'{where}: {name.format(len(bad))}, first near '
                            f'{_millimetres(vertices[bad[0]].mean(axis=0))}; {advice}')
    pinched = np.flatnonzero(~np.asarray(igl.is_vertex_manifold(faces)))
    if len(pinched):
        raise MeshError(f'{where}: non-manifold: {len(pinched)} corners where sheets only touch, '
                        f'first at {_millimetres(vertices[pinched[0]])}; separate them')


def _check_pieces(vertices, faces, where):
    pieces, piece = igl.facet_components(faces)
    if pieces > 1:
        second = vertices[faces[piece == 1].ravel()].mean(axis=0)
        raise MeshError(f'{where}: {pieces} separate pieces (one near '
                        f'{_millimetres(second)}); must be one closed surface without cavities')


def _orient(vertices, faces, repairs, where):
    """Return the faces turned outward; what was done is appended to `repairs`."""
    turned, _ = igl.bfs_orient(faces)
    directed = turned[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    if len(np.unique(directed, axis=0)) < len(directed):
        raise MeshError(f'{where}: not orientable; the surface must have an inside')
    a, b, c = (vertices[turned[:, k]] - vertices.mean(axis=0) for k in range(3))
    volume = np.einsum('ij,ij->', a, np.cross(b, c)) / 6.0
    if abs(volume) <= FLAT * np.linalg.norm(np.ptp(vertices, axis=0)) ** 3:
        raise MeshError(f'{where}: encloses {abs(volume):.3g} m^3; must enclose a volume')
    if volume < 0.0:
        turned = turned[:, ::-1]
    kept = (turned == faces).all(axis=1) | (np.roll(turned, 1, axis=1) == faces).all(axis=1) | (
        np.roll(turned, 2, axis=1) == faces).all(axis=1)
    if not kept.all():
        repairs.append(f'{(~kept).sum()} of {len(faces)} faces turned outward')
    return np.ascontiguousarray(turned)


def _check_self_intersections(surface, where):
    found, pairs, _ = predicates.find_self_intersections(
        np.ascontiguousarray(surface.vertices), np.ascontiguousarray(surface.faces, np.int64))
    if found:
        spot = surface.triangles_center[pairs[0, 0]]
        raise MeshError(f'{where}: self-intersecting: {len(pairs)} pairs of faces cross, first '
                        f'near {_millimetres(spot)}; repair the surface')


def _millimetres(point):
    return '({:.2f}, {:.2f}, {:.2f}) mm'.format(*(1e3 * np.asarray(point)))
