"""Numbers of a scene on a block whose sizes are known."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.scene import Marker, Material, MeshFile, PadPatch, Region, Scene, Target
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import surface_distance
from arm_brachy.tissue.scene_check import body_row, pad_rows, point_rows

SIZE = (0.06, 0.04, 0.03)
SCENE = Scene(
    'block', MeshFile('none.msh'), Region('set', set='x0'), material=Material(),
    pads=(PadPatch('top', (0.03, 0.02, 0.031), (0.0, 0.0, -1.0), radius=0.01),),
    markers=(Marker('above', (0.01, 0.02, 0.0325)), Marker('plate', (0.0, 0.0, 0.1), 'base')),
    targets=(Target('inside', (0.03, 0.02, 0.022)),))


@pytest.fixture(scope='module')
def body():
    return build_body(SCENE, box_mesh(SIZE, (24, 16, 6)))


def test_size_and_base_are_those_of_the_block(body):
    row = body_row(body)
    assert row['size_mm'] == '60.0 40.0 30.0' and row['base_normal'] == '1.000 0.000 0.000'
    assert row['volume_cm3'] == pytest.approx(72.0, rel=1e-9)
    assert row['base_cm2'] == pytest.approx(12.0, rel=1e-9)
    assert row['elements'] == 6 * 24 * 16 * 6 and 0.3 < row['worst_mean_ratio'] < 1.0


def test_a_base_of_two_opposite_clamps_has_no_direction(body):
    both = replace(body, fixed=np.union1d(body.mesh.node_sets['x0'], body.mesh.node_sets['x1']))
    row = body_row(both)
    assert row['base_normal'] == 'none' and row['base_cm2'] == pytest.approx(24.0, rel=1e-9)


def test_a_pad_covers_the_faces_within_its_disc(body):
    """Faces of 2.5 mm whose corners are all within 10 mm: counted by hand on the grid."""
    row, = pad_rows(SCENE, body)
    grid = np.arange(-10.0, 10.1, 2.5)
    inside = np.hypot(*np.meshgrid(grid, grid)) <= 10.0 + 1e-9
    squares = sum(inside[i:i + 2, j:j + 2].all() for i in range(8) for j in range(8))
    halves = sum(inside[i:i + 2, j:j + 2].sum() == 3 for i in range(8) for j in range(8))
    assert 6.25 * squares <= row['area_mm2'] <= 6.25 * (squares + 0.5 * halves) + 1e-9
    assert row['covers_percent'] == pytest.approx(row['area_mm2'] / np.pi, rel=1e-9)
    assert row['rim'] == 'cut' and row['off_surface_mm'] == pytest.approx(1.0, abs=1e-6)


def test_points_are_told_by_their_way_to_the_surface(body):
    marker, target = point_rows(SCENE, body)
    assert (marker['point'], target['kind']) == ('above', 'target')
    assert marker['off_surface_mm'] == pytest.approx(2.5, abs=1e-9)
    assert target['off_surface_mm'] == pytest.approx(-8.0, abs=1e-9)
    assert point_rows(replace(SCENE, markers=(), targets=()), body) == []


def test_surface_distance_is_to_the_nearest_face_edge_or_corner(body):
    points = [(0.03, 0.02, 0.015), (-0.003, 0.02, 0.034), (0.063, 0.044, 0.03), (0.0, 0.0, 0.0)]
    found = surface_distance(body.mesh, points)
    assert found == pytest.approx([-0.015, 0.005, 0.005, 0.0], abs=1e-12)


def test_a_set_that_holds_nodes_inside_the_body_is_told():
    """A group of a volume instead of its surface: all nodes of the half above z = 15 mm."""
    mesh = box_mesh(SIZE, (24, 16, 6))
    upper = np.flatnonzero((mesh.nodes[:, 2] > 0.0151) & (mesh.nodes[:, 0] > 0.003))
    scene = replace(SCENE, pads=(replace(SCENE.pads[0], set='upper'),))
    row, = pad_rows(scene, build_body(scene, replace(mesh, node_sets={
        **mesh.node_sets, 'upper': upper})))
    x = mesh.nodes[upper]
    within = np.all((x > 1e-9) & (x < np.array(SIZE) - 1e-9), axis=1)
    assert row['inside'] == within.sum() > 0 and row['off_set_mm'] == pytest.approx(1.0)
    top = replace(SCENE, fixed=Region('set', set='z0'),
                  pads=(replace(SCENE.pads[0], set='z1'),))
    assert pad_rows(top, build_body(top, mesh))[0]['inside'] == 0
