"""Nodes slid along a surface: they stay on it and under the disc, and nothing folds or is lost."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import EDGES
from arm_brachy.tissue.mesh import boundary_faces, quadratic_mesh, volumes
from arm_brachy.tissue.sliding import SmoothSurface, slide_patch

RADIUS, TOP = 0.06, np.array([0.03, 0.03, 0.03])
DOWN = np.array([0.0, 0.0, -1.0])


def cap(cells=(10, 10, 5), quadratic=False):
    """Block of 60 x 60 mm whose top is a cap of a sphere of 60 mm radius, 30 mm high."""
    mesh = box_mesh((0.06, 0.06, 0.03), cells)
    nodes = mesh.nodes.copy()
    across = np.sum((nodes[:, :2] - TOP[:2]) ** 2, axis=1)
    nodes[:, 2] -= nodes[:, 2] / TOP[2] * (RADIUS - np.sqrt(RADIUS**2 - across))
    mesh = dataclasses.replace(mesh, nodes=nodes)
    return quadratic_mesh(mesh) if quadratic else mesh


def disc(mesh, radius=0.0125):
    """Nodes of the top within `radius` of its middle."""
    top = mesh.node_sets['z1']
    return top[np.linalg.norm(mesh.nodes[top, :2] - TOP[:2], axis=1) < radius]


def slid(mesh, offset, held='z0', reach=0.0125):
    """`slide_patch` of the disc by `offset` (2,) [m] across."""
    nodes, centre = slide_patch(mesh, disc(mesh), TOP, DOWN, np.array([*offset, 0.0]),
                                mesh.node_sets[held], reach)
    return dataclasses.replace(mesh, nodes=nodes), centre


def off_sphere(points):
    """Distance (k,) [m] of points from the sphere of the cap."""
    return np.linalg.norm(points - (TOP - [0.0, 0.0, RADIUS]), axis=1) - RADIUS


@pytest.mark.parametrize('offset', [(3e-3, 0.0), (0.0, -5e-3), (2e-3, 2e-3)])
def test_the_patch_moves_by_the_offset_and_stays_on_the_surface(offset):
    mesh = cap()
    moved, centre = slid(mesh, offset)
    patch = disc(mesh)
    way = moved.nodes[patch, :2] - mesh.nodes[patch, :2]
    np.testing.assert_allclose(way, np.broadcast_to(offset, way.shape), atol=1e-12)
    np.testing.assert_allclose(centre[:2], TOP[:2] + offset, atol=1e-12)
    top = mesh.node_sets['z1']
    # the mean normal of flat faces of 6 mm is off that of the sphere by under 1 deg
    np.testing.assert_allclose(off_sphere(moved.nodes[top]), 0.0, atol=5e-5)
    assert abs(off_sphere(centre[None])[0]) < 5e-5


def test_finer_meshes_follow_the_surface_better():
    errors = [np.abs(off_sphere(slid(cap(cells), (4e-3, 0.0))[0].nodes[
        cap(cells).node_sets['z1']])).max() for cells in ((6, 6, 3), (12, 12, 6))]
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize('quadratic', [False, True], ids=['linear', 'quadratic'])
def test_nothing_is_lost_and_what_is_held_or_far_keeps_every_bit(quadratic):
    mesh = cap(quadratic=quadratic)
    moved, _ = slid(mesh, (3e-3, 1e-3))
    assert volumes(moved).min() > 0.0
    assert volumes(moved).sum() == pytest.approx(volumes(mesh).sum(), rel=1e-3)
    outer = np.unique(boundary_faces(mesh))
    away = np.linalg.norm(mesh.nodes[outer] - TOP, axis=1) > 0.0127 + 0.0125
    for still in (mesh.node_sets['z0'], outer[away]):
        np.testing.assert_array_equal(moved.nodes[still], mesh.nodes[still])
    if quadratic:
        ends = moved.nodes[mesh.tets[:, EDGES]]
        np.testing.assert_allclose(moved.nodes[mesh.midside], ends.mean(axis=2), atol=1e-15)


def test_positions_are_smooth_in_the_offset():
    """Second differences are of second order in the step, at rest too: no choice is made."""
    mesh = cap()
    for middle in (0.0, 3e-3):
        seconds = [np.abs(slid(mesh, (middle + h, 0.0))[0].nodes - 2.0
                          * slid(mesh, (middle, 0.0))[0].nodes
                          + slid(mesh, (middle - h, 0.0))[0].nodes).max() for h in (1e-3, 5e-4)]
        assert seconds[1] < 0.3 * seconds[0] and seconds[0] < 1e-4


def test_a_held_node_nearby_takes_up_the_room():
    mesh = box_mesh((0.06, 0.06, 0.03), (10, 10, 5))
    near = np.flatnonzero((mesh.nodes[:, 0] >= 0.0539) & (mesh.nodes[:, 2] == 0.03))
    mesh = dataclasses.replace(mesh, node_sets={**mesh.node_sets, 'near': near})
    moved, _ = slid(mesh, (3e-3, 0.0), held='near', reach=0.05)
    np.testing.assert_array_equal(moved.nodes[near], mesh.nodes[near])
    between = np.linalg.norm(mesh.nodes - [0.048, 0.03, 0.03], axis=1).argmin()
    # half way from the rim of the patch at 42 mm to the held nodes at 54 mm
    assert (moved.nodes - mesh.nodes)[between, 0] == pytest.approx(1.5e-3, rel=1e-9)


def test_mean_normals_are_those_of_planes_and_spheres():
    flat, round_ = box_mesh((0.06, 0.06, 0.03), (10, 10, 5)), cap()
    edge = np.array([[0.03, 0.03, 0.03], [0.057, 0.03, 0.03]])
    up = np.broadcast_to([0.0, 0.0, 1.0], (2, 3))
    np.testing.assert_allclose(SmoothSurface(flat, 0.012).normals(edge, up), up, atol=1e-12)
    at = TOP - [0, 0, RADIUS] + RADIUS * np.array([[0, 0, 1.0], [0.2, 0, np.sqrt(0.96)]])
    exact = (at - TOP + [0, 0, RADIUS]) / RADIUS
    np.testing.assert_allclose(SmoothSurface(round_, 0.012).normals(at, exact), exact, atol=0.02)


def test_what_cannot_be_is_refused():
    flat = box_mesh((0.06, 0.06, 0.03), (10, 10, 5))
    with pytest.raises(MeshError, match='the patch reaches an edge of the body'):
        slide_patch(flat, flat.node_sets['z1'], TOP, DOWN, np.array([3e-3, 0, 0]),
                    flat.node_sets['z0'], 0.02)
    with pytest.raises(MeshError, match='elements turned inside out'):
        slid(flat, (0.012, 0.0), reach=0.007)
    with pytest.raises(MeshError, match='no face of the surface lies within 1.0 mm'):
        slid(flat, (3e-3, 0.0), reach=0.001)
