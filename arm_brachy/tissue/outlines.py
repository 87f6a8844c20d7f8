"""Meshes whose surface edges follow the rims of pads all the way round.

A mesher within an envelope leaves gaps in an outline: edges that cross the rim, so that the pad
holds less than its disc (a tenth of the area was seen, and 5 % of the stiffness). Here every such
edge gets an end on the rim: the nearer of its nodes moves there, or it is split where it crosses.
Test: test_refinement.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.mesh import FACE_EDGES, boundary_faces
from arm_brachy.tissue.meshing import mean_ratio
from arm_brachy.tissue.refinement import moved, nearest_on
from arm_brachy.tissue.rims import ON_RIM, at_radius, onto, radii, refuse_quadratic

SOUND = 0.35        # mean ratio that no element about a node that moves may fall below
SHARP = np.radians(45.0)    # between faces: edges that are part of the shape
MOST_EDGES = 400    # that one disc can have across its rim


def follow_rims(mesh, patches, surface):
    """Return the TetMesh with closed outlines and its surface nodes on the surface.

    mesh : TetMesh of linear elements;  patches : core.scene.PadPatch
    surface : trimesh.Trimesh [m] that it was made of, outward normals
    Nodes on rims lie on cylinder and surface; those on sharp edges go to the nearest sharp edge of
    the surface, others to its nearest point, unless that would make an element flatter than SOUND.
    Raises MeshError if an outline does not close.
    """
    refuse_quadratic(mesh)
    fixed = np.zeros(0, dtype=np.int64)
    for patch in patches:
        mesh = _closed(mesh, patch, surface, fixed)
        fixed = np.union1d(fixed, _on_rim(mesh, patch))
    outer = np.setdiff1d(np.unique(boundary_faces(mesh)), fixed)
    nodes, sharp = mesh.nodes.copy(), np.intersect1d(outer, sharp_edges(mesh))
    nodes[outer] = nearest_on(surface, nodes[outer])
    nodes[sharp] = _nearest_edge(surface, mesh.nodes[sharp])
    for patch in patches:   # the mesher left those that it made there within its envelope
        mine = _on_rim(mesh, patch)
        nodes[mine] = onto(surface, mesh.nodes[mine], patch)
    return moved(mesh, nodes, SOUND)


def sharp_edges(mesh):
    """Return the surface edges (e, 2) at which faces meet at more than SHARP."""
    faces = boundary_faces(mesh)
    corners = mesh.nodes[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    edges = np.sort(faces[:, FACE_EDGES].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    sides = np.repeat(np.arange(len(faces)), 3)[order].reshape(-1, 2)
    turn = np.sum(normal[sides[:, 0]] * normal[sides[:, 1]], axis=1)
    return edges[order][::2][turn < np.cos(SHARP)]


def _nearest_edge(surface, points):
    """The points (k, 3) on sharp edges of a trimesh.Trimesh nearest to points (k, 3)."""
    edges = surface.face_adjacency_edges[surface.face_adjacency_angles > SHARP]
    if not len(edges):
        return points
    a, b = surface.vertices[edges[:, 0]], surface.vertices[edges[:, 1]]
    along = b - a
    share = np.einsum('kei,ei->ke', points[:, None] - a, along) / np.sum(along**2, axis=1)
    there = a + np.clip(share, 0.0, 1.0)[..., None] * along
    nearest = np.linalg.norm(there - points[:, None], axis=2).argmin(axis=1)
    return there[np.arange(len(points)), nearest]


def crossing(mesh, patch, off_rim=ON_RIM):
    """Return the surface edges (e, 2) on a disc's side of the body that cross its cylinder.

    off_rim : of the radius, that both ends are farther than from the cylinder
    """
    ends = np.unique(np.sort(_faces(mesh, patch)[:, FACE_EDGES].reshape(-1, 2), axis=1), axis=0)
    off = radii(mesh.nodes, patch)[0][ends] / patch.radius - 1.0
    return ends[(off.prod(axis=1) < 0.0) & (np.abs(off) > off_rim).all(axis=1)]


def _faces(mesh, patch):
    """The faces that look at a disc, not far from it."""
    faces = boundary_faces(mesh)
    a, b, c = (mesh.nodes[faces[:, k]] for k in range(3))
    facing = np.cross(b - a, c - a) @ np.array(patch.direction) < 0.0
    near = np.linalg.norm((a + b + c) / 3.0 - patch.centre, axis=1) < 2.0 * patch.radius
    return faces[facing & near]


def _on_rim(mesh, patch):
    nodes = np.unique(_faces(mesh, patch))
    off = radii(mesh.nodes[nodes], patch)[0] / patch.radius - 1.0
    return nodes[np.abs(off) <= ON_RIM]


def _closed(mesh, patch, surface, fixed):
    """The mesh without edges across one rim; fixed : nodes that stay where they are."""
    for _ in range(MOST_EDGES):
        edges = crossing(mesh, patch)
        if not len(edges):
            return mesh
        off = np.abs(radii(mesh.nodes, patch)[0] - patch.radius)[edges]
        e, end = np.unravel_index(off.argmin(), off.shape)
        mesh = _snapped(mesh, edges[e, end], patch, surface, fixed) or _split(
            mesh, edges[e], patch, surface)
    raise MeshError(f'pad {patch.name}: {len(edges)} edges still cross its rim after {MOST_EDGES} '
                    'were ended on it; mesh the body anew')


def _snapped(mesh, node, patch, surface, fixed):
    """The mesh with a node on the rim, None if it is fixed or an element would suffer."""
    if node in fixed:
        return None
    nodes = mesh.nodes.copy()
    nodes[node] = onto(surface, at_radius(nodes[[node]], patch), patch)[0]
    new, mine = replace(mesh, nodes=nodes), (mesh.tets == node).any(axis=1)
    part = TetMesh(nodes, new.tets[mine])
    return new if mean_ratio(part).min() >= SOUND else None


def _split(mesh, edge, patch, surface):
    """The mesh with a node more where an edge crosses the rim."""
    a, b = mesh.nodes[edge]
    across = radii(np.array([a, b]), patch)[1]
    step = across[1] - across[0]
    p, q = across[0] @ step, across[0] @ across[0] - patch.radius**2
    root = np.sqrt(p * p - (step @ step) * q)
    share = max((-p + root, -p - root), key=lambda s: 0.0 < s < step @ step) / (step @ step)
    point = onto(surface, at_radius((a + share * (b - a))[None], patch), patch)
    both = np.isin(mesh.tets, edge).sum(axis=1) == 2
    first, second = mesh.tets[both].copy(), mesh.tets[both].copy()
    first[first == edge[0]] = len(mesh.nodes)
    second[second == edge[1]] = len(mesh.nodes)
    return TetMesh(np.vstack([mesh.nodes, point]),
                   np.vstack([mesh.tets[~both], first, second]))
