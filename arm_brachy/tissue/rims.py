"""Rims of disc-shaped pads as edges of a mesh.

The rim of a bonded rigid disc is where a solution is worst: the traction grows like the inverse
root of the distance to it, and a mesh without nodes on the rim holds another disc, of the outline
that its nodes happen to have. `mesh_with_discs` makes a mesh with nodes on the rims;
`refinement.grade` makes it finer and keeps them.
"""

import contextlib
import tempfile
from dataclasses import replace

import igl
import numpy as np
import pytetwild
import trimesh
from scipy.spatial import cKDTree

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.element import signed_volumes
from arm_brachy.tissue.mesh import FACE_EDGES, boundary_faces
from arm_brachy.tissue.meshing import mean_ratio
from arm_brachy.tissue.surface import read_surface

# Elements flatter than this (mean ratio) are refused: their error constant exceeds ten times a
# regular tetrahedron's, and a push soon inverts them.
FLATTEST = 0.1
ON_RIM = 1e-6        # of the radius: a node this close to a disc's cylinder is on it
PLUG_SIDES = 48      # of the prism that stands for a disc's cylinder while meshing
ATTEMPTS = 4         # of the mesher; one in ten has been seen to fail
RIM_POINTS = 96      # of the polyline that distances to a rim are taken from


class FlatElement(MeshError):
    """An element is too flat, or turned inside out."""


def rim(mesh, patch):
    """Return points (96, 3) [m] of a disc's rim: its circle moved along its axis to the surface.

    mesh : TetMesh;  patch : core.scene.PadPatch
    Raises MeshError if the circle's axis-parallel lines miss the body.
    """
    centre, direction, across = _frame(patch)
    angle = np.linspace(0.0, 2.0 * np.pi, RIM_POINTS, endpoint=False)
    circle = centre + patch.radius * (np.outer(np.cos(angle), across[0])
                                      + np.outer(np.sin(angle), across[1]))
    return _along_axis(circle, direction, mesh.nodes, boundary_faces(mesh), patch.name)


def _frame(patch):
    """Centre, unit direction and two unit vectors across it of a disc."""
    direction = np.array(patch.direction, dtype=float)
    direction /= np.linalg.norm(direction)
    first = np.eye(3)[np.abs(direction).argmin()]
    first -= (first @ direction) * direction
    first /= np.linalg.norm(first)
    return (np.array(patch.centre, dtype=float), direction,
            np.array([first, np.cross(direction, first)]))


def _along_axis(points, direction, vertices, faces, name):
    """Move points (k, 3) along +-direction to the nearest crossing with a triangulation."""
    moved = points.copy()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    facing = np.flatnonzero(normal @ direction < 0.0)  # the near side, as seen by the disc
    a, b, c, normal = a[facing], b[facing], c[facing], normal[facing]
    slope = normal @ direction
    for i, point in enumerate(points):
        t = np.einsum('fi,fi->f', normal, a - point) / slope
        hit = point + t[:, None] * direction
        parts = [np.einsum('fi,fi->f', normal, np.cross(v - u, hit - u))
                 for u, v in ((a, b), (b, c), (c, a))]
        inside = np.min(parts, axis=0) >= -1e-9 * np.einsum('fi,fi->f', normal, normal)
        if not inside.any():
            raise MeshError(f'pad {name}: part of its rim is beside the body; move it onto the '
                            'surface or make it smaller')
        moved[i] += t[inside][np.abs(t[inside]).argmin()] * direction
    return moved


def _radii(points, patch):
    """Distance (k,) of points from the axis of a disc, their offsets across it (k, 3)."""
    centre, direction, _ = _frame(patch)
    offset = points - centre
    across = offset - np.outer(offset @ direction, direction)
    return np.linalg.norm(across, axis=1), across


def at_radius(points, patch):
    """Return points (k, 3) moved straight away from a disc's axis, or to it, onto its cylinder.

    patch : core.scene.PadPatch
    """
    radius, across = _radii(points, patch)
    return points + across * (patch.radius / radius - 1.0)[:, None]


def outline(mesh, patch):
    """Return the surface edges (e, 2) on a disc's cylinder, between faces inside and outside it.

    mesh : TetMesh;  patch : core.scene.PadPatch. Edges of an opposite disc of the same axis and
    radius are among them; a mesh without nodes on the rim has none.
    """
    faces = boundary_faces(mesh)
    radius, _ = _radii(mesh.nodes, patch)
    inside = (radius[faces] <= (1.0 + ON_RIM) * patch.radius).all(axis=1)
    edges = np.sort(faces[:, FACE_EDGES], axis=2)
    mine = np.unique(edges[inside].reshape(-1, 2), axis=0)
    others = np.unique(edges[~inside].reshape(-1, 2), axis=0)
    code = np.array([len(mesh.nodes), 1])  # an edge as one number
    shared = mine[np.isin(mine @ code, others @ code)]
    return shared[(np.abs(radius[shared] / patch.radius - 1.0) <= ON_RIM).all(axis=1)]


def mesh_with_discs(source, patches, *, edge_length, envelope, depth, unit='mm'):
    """Fill a closed surface with tetrahedra whose surface has the discs' rims among its edges.

    source, unit : see `surface.read_surface`;  patches : core.scene.PadPatch
    edge_length : wished for inside [m]; near the rims elements come out smaller, of `depth`
    envelope : how far the mesh may leave surface and rims [m]; how many nodes a rim gets follows
        from it: 360 deg / acos(1 - envelope / radius), roughly
    depth : [m] how far the cylinder of a disc is followed into the body
    Returns TetMesh in metres, rim nodes exactly on the cylinder and on the surface.
    The mesher gets the body and, standing in it, a prism for each disc; what it makes outside the
    body is dropped. It is not deterministic (see `meshing`): keep the mesh, do not remake it. For
    the same reason it is asked again, ATTEMPTS times in all, if rim nodes crush an element.
    Raises MeshError for a bad surface, or if an element is still flatter than FLATTEST.
    """
    for _ in range(ATTEMPTS - 1):
        with contextlib.suppress(FlatElement):
            return _with_discs(source, patches, edge_length, envelope, depth, unit)
    return _with_discs(source, patches, edge_length, envelope, depth, unit)


def _with_discs(source, patches, edge_length, envelope, depth, unit):
    """One attempt of `mesh_with_discs`."""
    surface, _ = read_surface(source, unit=unit)
    parts = [surface, *(_plug(patch, depth) for patch in patches)]
    together = trimesh.util.concatenate(parts)
    diagonal = np.linalg.norm(together.extents)
    try:
        # The mesher leaves a file of its own in the working directory, so it gets one to itself.
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            nodes, tets = pytetwild.tetrahedralize(
                np.ascontiguousarray(together.vertices),
                np.ascontiguousarray(together.faces, np.int32),
                edge_length_abs=float(edge_length), epsilon=float(envelope / diagonal),
                num_threads=1, quiet=True)
    except RuntimeError as error:
        raise MeshError(f'the mesher gave up: {error}; try another edge length') from None
    mesh = _inside(surface, np.asarray(nodes, float), np.asarray(tets, np.int64))
    for patch in patches:
        mesh = fit_rim(mesh, patch, reach=1.5 * envelope)
    return not_flat(mesh)


def fit_rim(mesh, patch, *, reach):
    """Move surface nodes within `reach` [m] of a disc's rim onto it; returns the TetMesh.

    mesh : TetMesh of linear elements;  patch : core.scene.PadPatch
    """
    refuse_quadratic(mesh)
    outer = np.unique(boundary_faces(mesh))
    points = mesh.nodes[outer]
    near = (cKDTree(rim(mesh, patch)).query(points)[0] < 3.0 * reach) & (
        np.abs(_radii(points, patch)[0] - patch.radius) < reach)
    nodes = mesh.nodes.copy()
    nodes[outer[near]] = at_radius(points[near], patch)
    return replace(mesh, nodes=nodes)


def _plug(patch, depth):
    """The prism around a disc's axis, from `depth` outside the surface to `depth` inside."""
    centre, direction, across = _frame(patch)
    prism = trimesh.creation.cylinder(patch.radius, 2.0 * depth, sections=PLUG_SIDES)
    place = np.eye(4)
    place[:3, :3] = np.column_stack([*across, direction])
    place[:3, 3] = centre
    return prism.apply_transform(place)


def _inside(surface, nodes, tets):
    """The elements with their centre inside a closed surface, positive, without unused nodes."""
    winding = igl.fast_winding_number(np.ascontiguousarray(surface.vertices),
                                      np.ascontiguousarray(surface.faces, np.int64),
                                      nodes[tets].mean(axis=1))
    tets = tets[winding > 0.5]
    inverted = signed_volumes(nodes, tets) < 0.0
    tets[inverted] = tets[inverted][:, [0, 2, 1, 3]]
    used, tets = np.unique(tets, return_inverse=True)
    return TetMesh(nodes[used], tets.reshape(-1, 4))


def not_flat(mesh):
    """Return a TetMesh; raise MeshError if an element is flatter (mean ratio) than FLATTEST."""
    worst = mean_ratio(mesh)
    if worst.min() < FLATTEST:
        raise FlatElement(f'element {worst.argmin()} has mean ratio {worst.min():.3f}; must be at '
                          f'least {FLATTEST:g}; start from another mesh or another size')
    return mesh


def refuse_quadratic(mesh):
    """Raise MeshError if a TetMesh has midside nodes."""
    if mesh.midside is not None:
        raise MeshError('the mesh has midside nodes; must be linear here; refine or fit first, '
                        'then quadratic_mesh')
