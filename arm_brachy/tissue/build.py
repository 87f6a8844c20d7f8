"""From a scene to a SoftBody: which nodes are held, which lie under a pad, what hangs where."""

import dataclasses

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from arm_brachy.core.errors import ConfigError, MeshError
from arm_brachy.tissue.body import Pad, PadFace, SoftBody
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import (
    boundary_faces,
    embed,
    load_mesh,
    quadratic_mesh,
    with_midside,
)

# A disc does not bond to a face steeper than 75 deg to its own (the flanks of a narrow body).
FACING = np.cos(np.deg2rad(75.0))
# Meshers put nodes on the rim; they belong to the disc whatever their rounding.
RIM = 1.001
LARGEST_GAP = 5e-3  # m, between disc and surface at rest: half a disc, more is another place
SMALLEST_PAD = 3  # nodes; fewer cannot carry the moments of a disc


def build_body(scene, mesh=None):
    """Return the SoftBody a core.scene.Scene describes.

    scene : Scene, its mesh path absolute
    mesh : TetMesh to use, elements and all, instead of the scene's file and element
    Raises MeshError if a region is empty, a pad covers fewer than 3 nodes, two pads or a pad and
    the fixed region share nodes, or a load lies off the body.
    """
    mesh = load_scene_mesh(scene) if mesh is None else mesh
    fixed = region_nodes(mesh, scene.fixed, f'scene {scene.name}: fixed')
    pads = tuple(build_pad(mesh, patch) for patch in scene.pads)
    _refuse_overlap(fixed, pads)
    m = len(mesh.tets)
    mu, kappa = moduli(scene.material.E, scene.material.nu)
    return SoftBody(mesh=mesh, mu=np.full(m, mu), kappa=np.full(m, kappa),
                    density=np.full(m, scene.material.density), fixed=fixed, pads=pads,
                    gravity=np.array(scene.gravity, dtype=float),
                    nodal_mass=load_masses(mesh, scene.loads),
                    damping=(scene.rayleigh_alpha, scene.rayleigh_beta))


def load_scene_mesh(scene):
    """Return the TetMesh of a core.scene.Scene's file, quadratic if it says so.

    Raises MeshError.
    """
    mesh = load_mesh(scene.mesh.file, scene.mesh.unit)
    return quadratic_mesh(mesh) if scene.element == 'quadratic' else mesh


def with_moduli(body, E, nu):
    """Return the SoftBody with another homogeneous material: E [Pa], nu [-]."""
    mu, kappa = moduli(E, nu)
    return dataclasses.replace(body, mu=np.full_like(body.mu, mu),
                               kappa=np.full_like(body.kappa, kappa))


def region_nodes(mesh, region, where):
    """Return the sorted nodes (k,) of a core.scene.Region.

    mesh : TetMesh;  where : what the region is for, for the message
    Raises MeshError if it is empty or names an unknown set.
    """
    if region.kind == 'set':
        return _named_set(mesh, region.set, where)
    # A node a rounding error off the bounding plane belongs to the region.
    slack = 1e-9 * np.ptp(mesh.nodes, axis=0).max()
    if region.kind == 'half_space':
        inside = (mesh.nodes - region.point) @ _unit(region.normal, where) >= -slack
    else:
        inside = np.all((mesh.nodes >= np.array(region.low) - slack)
                        & (mesh.nodes <= np.array(region.high) + slack), axis=1)
    if not inside.any():
        low, high = (1e3 * np.array([mesh.nodes.min(0), mesh.nodes.max(0)])).round(1).tolist()
        raise MeshError(f'{where}: the {region.kind} region holds no node; the mesh spans '
                        f'{low} to {high} mm; move the region')
    return np.flatnonzero(inside)


def _named_set(mesh, name, where):
    if name not in mesh.node_sets:
        known = ', '.join(sorted(mesh.node_sets)) or 'none'
        raise MeshError(f'{where}: no node set {name!r} in the mesh; it has: {known}')
    return np.unique(mesh.node_sets[name])


def _unit(vector, where):
    length = np.linalg.norm(vector)
    if not length > 0.0:
        raise MeshError(f'{where}: direction {list(vector)} has no length; give a nonzero vector')
    return np.asarray(vector, dtype=float) / length


def build_pad(mesh, patch):
    """Return the Pad of a core.scene.PadPatch on a TetMesh.

    mesh : TetMesh;  patch : PadPatch; its named set if it has one, else the surface nodes within
        `radius` of the disc's axis that face it and join the one nearest to its centre
    Raises MeshError if that leaves fewer than 3 nodes, or the disc is off the surface, ConfigError
    if a touching pad's edge is rounder than the pad.
    """
    where = f'pad {patch.name}'
    direction, centre = _unit(patch.direction, where), np.array(patch.centre, dtype=float)
    nodes = (_named_set(mesh, patch.set, where) if patch.set
             else with_midside(mesh, _under_disc(mesh, centre, direction, patch.radius)))
    if len(nodes) < SMALLEST_PAD:
        raise MeshError(f'{where}: {len(nodes)} surface nodes within {1e3 * patch.radius:g} mm of '
                        f'its axis; must be at least {SMALLEST_PAD}; move the pad onto the '
                        'surface, enlarge it or refine the mesh')
    gap = np.abs((mesh.nodes[nodes] - centre) @ direction).min()
    if gap > LARGEST_GAP:
        raise MeshError(f'{where}: its centre is {1e3 * gap:.1f} mm from the surface along its '
                        f'direction; allowed {1e3 * LARGEST_GAP:g} mm; move the pad onto the '
                        'surface')
    return Pad(patch.name, nodes, direction, centre, patch.stroke, _face(patch),
               None if patch.set else patch.radius)


def _face(patch):
    """PadFace of a pad that touches, None for a bonded one."""
    if patch.contact == 'bonded':
        return None
    if patch.edge_radius > patch.radius:
        raise ConfigError(f'pad {patch.name}: edge_radius_mm = {1e3 * patch.edge_radius:g}; must '
                          f'be at most its radius_mm = {1e3 * patch.radius:g}')
    return PadFace(patch.radius, patch.edge_radius, patch.friction)


def _under_disc(mesh, centre, direction, radius):
    faces = boundary_faces(mesh)
    corners = mesh.nodes[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(mesh.nodes)
    np.add.at(normals, faces.ravel(), np.repeat(areas, 3, axis=0))
    offset = mesh.nodes - centre
    distance = np.linalg.norm(offset - np.outer(offset @ direction, direction), axis=1)
    facing = normals @ direction < -FACING * np.linalg.norm(normals, axis=1)
    covered = facing & (distance <= RIM * radius)
    if not covered.any():
        return np.zeros(0, dtype=np.int64)
    candidates = np.flatnonzero(covered)
    nearest = candidates[np.linalg.norm(offset[candidates], axis=1).argmin()]
    patch = _connected(len(mesh.nodes), faces, covered)
    return candidates[patch[candidates] == patch[nearest]]


def _connected(n, faces, allowed):
    """Label (n,) of the connected parts of the surface that consist of allowed nodes."""
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges = edges[allowed[edges].all(axis=1)]
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def _refuse_overlap(fixed, pads):
    taken = {int(node): 'the fixed region' for node in fixed}
    for pad in pads:
        shared = [int(node) for node in pad.nodes if int(node) in taken]
        if shared:
            raise MeshError(f'pad {pad.name} shares node {shared[0]} with {taken[shared[0]]} '
                            f'({len(shared)} such); pads must lie apart; move or shrink one')
        taken |= {int(node): f'pad {pad.name}' for node in pad.nodes}


def placement_mesh(mesh, body):
    """Return the TetMesh in which what a scene places in the tissue is to be embedded.

    mesh : of the scene;  body : SoftBody prepared by terms. A term that changes the shape takes
    material points along with the nodes; one that slides nodes through the material does not.
    """
    if body.scene_nodes is None:
        return mesh
    return dataclasses.replace(mesh, nodes=body.scene_nodes)


def load_masses(mesh, loads):
    """Return nodal masses (n,) [kg] of core.scene.PointLoad objects, or None if there are none.

    mesh : TetMesh;  loads : each is shared among the four nodes around its position
    """
    if not loads:
        return None
    points = np.array([load.position for load in loads])
    riders = embed(mesh, points, names=[f'load {load.name}' for load in loads], onto_surface=True)
    return riders.matrix(len(mesh.nodes)).T @ np.array([load.mass for load in loads])


def marker_points(scene, body='tissue'):
    """Return (names, positions (k, 3) [m]) of a Scene's markers glued to `body`, at rest.

    scene : Scene;  body : 'tissue', 'base' or a pad's name
    """
    return _named_points([m for m in scene.markers if m.body == body])


def target_points(scene):
    """Return (names, positions (k, 3) [m]) of a Scene's internal targets, at rest."""
    return _named_points(scene.targets)


def _named_points(items):
    positions = np.array([item.position for item in items], dtype=float).reshape(-1, 3)
    return tuple(item.name for item in items), positions
