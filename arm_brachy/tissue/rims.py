"""Rims of disc-shaped pads as edges of a mesh.

The rim of a bonded rigid disc is where a solution is worst: the traction grows like the inverse
root of the distance to it, and a mesh without nodes on the rim holds another disc, of the outline
that its nodes happen to have. `disc_meshing` makes a mesh with nodes on the rims, `outlines`
closes their polygons, `refinement.grade` makes it finer and keeps them.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.mesh import FACE_EDGES, boundary_faces
from arm_brachy.tissue.meshing import mean_ratio

# Elements flatter than this (mean ratio) are refused: their error constant exceeds ten times a
# regular tetrahedron's, and a push soon inverts them.
FLATTEST = 0.1
# Of the radius: a node this close to a disc's cylinder is on it; pads of scenes are rounded.
ON_RIM = 1e-4
RIM_POINTS = 96      # of the polyline that distances to a rim are taken from


class FlatElement(MeshError):
    """An element is too flat, or turned inside out."""


def rim(mesh, patch):
    """Return points (96, 3) [m] of a disc's rim: its circle moved along its axis to the surface.

    mesh : TetMesh;  patch : core.scene.PadPatch
    Raises MeshError if the circle's axis-parallel lines miss the body.
    """
    centre, direction, across = frame(patch)
    angle = np.linspace(0.0, 2.0 * np.pi, RIM_POINTS, endpoint=False)
    circle = centre + patch.radius * (np.outer(np.cos(angle), across[0])
                                      + np.outer(np.sin(angle), across[1]))
    return _along_axis(circle, direction, mesh.nodes, boundary_faces(mesh), patch.name)


def frame(patch):
    """Return the centre, unit direction and two unit vectors across it of a disc."""
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


def radii(points, patch):
    """Return distances (k,) of points from the axis of a disc, offsets across it (k, 3)."""
    centre, direction, _ = frame(patch)
    offset = points - centre
    across = offset - np.outer(offset @ direction, direction)
    return np.linalg.norm(across, axis=1), across


def onto(surface, points, patch):
    """Return points (k, 3) moved along a disc's axis onto a trimesh.Trimesh, its near side."""
    return _along_axis(points, frame(patch)[1], surface.vertices, surface.faces, patch.name)


def at_radius(points, patch):
    """Return points (k, 3) moved straight away from a disc's axis, or to it, onto its cylinder.

    patch : core.scene.PadPatch
    """
    radius, across = radii(points, patch)
    return points + across * (patch.radius / radius - 1.0)[:, None]


def outline(mesh, patch):
    """Return the surface edges (e, 2) on a disc's cylinder, between faces inside and outside it.

    mesh : TetMesh;  patch : core.scene.PadPatch. Edges of an opposite disc of the same axis and
    radius are among them; a mesh without nodes on the rim has none.
    """
    faces = boundary_faces(mesh)
    radius, _ = radii(mesh.nodes, patch)
    inside = (radius[faces] <= (1.0 + ON_RIM) * patch.radius).all(axis=1)
    edges = np.sort(faces[:, FACE_EDGES], axis=2)
    mine = np.unique(edges[inside].reshape(-1, 2), axis=0)
    others = np.unique(edges[~inside].reshape(-1, 2), axis=0)
    code = np.array([len(mesh.nodes), 1])  # an edge as one number
    shared = mine[np.isin(mine @ code, others @ code)]
    return shared[(np.abs(radius[shared] / patch.radius - 1.0) <= ON_RIM).all(axis=1)]


def fit_rim(mesh, patch, *, reach):
    """Move surface nodes within `reach` [m] of a disc's rim onto it; returns the TetMesh.

    mesh : TetMesh of linear elements;  patch : core.scene.PadPatch
    """
    refuse_quadratic(mesh)
    outer = np.unique(boundary_faces(mesh))
    points = mesh.nodes[outer]
    near = (cKDTree(rim(mesh, patch)).query(points)[0] < 3.0 * reach) & (
        np.abs(radii(points, patch)[0] - patch.radius) < reach)
    nodes = mesh.nodes.copy()
    nodes[outer[near]] = at_radius(points[near], patch)
    return replace(mesh, nodes=nodes)


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
