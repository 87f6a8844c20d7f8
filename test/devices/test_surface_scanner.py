"""The scanner's cloud lies on the skin, within its noise, and leaves out what is not seen."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from arm_brachy.devices.surface_scanner import PadShadow, Plate, ScannerParams, SurfaceScanner
from arm_brachy.robot.surface_scan import ScannedSurface

RADIUS = 0.06
BALL = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
NODES, FACES = np.array(BALL.vertices), np.array(BALL.faces)
CLEAN = ScannerParams(noise=0.0, lost=0.0, patches=0.0)


def scanner(params=CLEAN, seed=0, pads=(), plate=None):
    return SurfaceScanner(params, NODES, FACES, pads, plate, np.random.default_rng(seed))


def test_points_lie_on_the_skin_where_both_eyes_see_it():
    cloud = scanner().scan(NODES)
    assert np.allclose(np.linalg.norm(cloud, axis=1), RADIUS, atol=2e-4)   # flat faces
    for eye in (CLEAN.camera, CLEAN.projector):
        sight = np.array(eye) - cloud
        angle = np.arccos(np.einsum('ni,ni->n', cloud, sight) / RADIUS
                          / np.linalg.norm(sight, axis=1))
        assert np.rad2deg(angle.max()) < 75.0 + 3.0     # normals of faces
    assert np.rad2deg(angle.max()) > 65.0


def test_the_density_is_that_of_the_skin_that_is_seen():
    cloud = scanner().scan(NODES)
    cap = cloud[cloud[:, 2] > 0.04]
    area = 2.0 * np.pi * RADIUS * (RADIUS - 0.04)
    assert np.isclose(len(cap), CLEAN.density * area, rtol=0.05)


def test_noise_lies_along_the_line_of_sight_and_grows_with_the_slant():
    noisy = replace(CLEAN, noise=3e-4)
    off = np.linalg.norm(scanner(noisy).scan(NODES), axis=1) - RADIUS
    cloud = scanner(noisy).scan(NODES)
    steep = cloud[:, 2] < 0.025
    assert np.isclose(off[cloud[:, 2] > 0.058].std(), 3e-4, rtol=0.1)
    assert np.isclose(off[steep].std(), 3e-4, rtol=0.4)
    flat = cloud[cloud[:, 2] > 0.05] / RADIUS
    assert abs(np.linalg.norm(flat, axis=1).mean() - 1.0) < 2e-3


def test_a_shape_that_has_changed_is_scanned_as_it_is():
    squeezed = NODES * [1.1, 1.1, 0.8]
    cloud = scanner().scan(squeezed)
    assert np.allclose(np.linalg.norm(cloud / [1.1, 1.1, 0.8], axis=1), RADIUS, atol=2e-4)


def test_a_pad_hides_what_lies_under_it_and_moves_with_its_nodes():
    nodes = np.flatnonzero(NODES[:, 2] > 0.058)
    pad = PadShadow(np.array([0.0, 0.0, RADIUS]), np.array([0.0, 0.0, -1.0]), 0.01, nodes)
    hidden = scanner(pads=[pad]).scan(NODES)
    assert np.linalg.norm(hidden[hidden[:, 2] > 0.0][:, :2], axis=1).min() > 8e-3
    pushed = NODES - [0.0, 0.0, 0.02]
    gone = scanner(pads=[pad]).scan(pushed)
    assert np.linalg.norm(gone[:, :2], axis=1).min() > 8e-3


def test_the_template_throws_a_shadow_away_from_the_eyes():
    plate = Plate(np.eye(3), np.array([0.03, 0.0, 0.2]), np.array([0.02, 0.02]))
    free, shaded = scanner().scan(NODES), scanner(plate=plate).scan(NODES)
    assert len(shaded) < 0.9 * len(free)
    sight = np.array(CLEAN.camera) - shaded
    at = shaded + sight * ((0.2 - shaded[:, 2]) / sight[:, 2])[:, None]
    assert not np.any(np.all(np.abs(at[:, :2] - [0.03, 0.0]) < 0.0199, axis=1))


def test_points_are_lost_by_chance_and_in_patches():
    free = len(scanner().scan(NODES))
    fewer = len(scanner(replace(CLEAN, lost=0.3)).scan(NODES))
    assert np.isclose(fewer / free, 0.7, atol=0.05)
    holes = scanner(replace(CLEAN, patches=5.0), seed=3).scan(NODES)
    gone = free - len(holes)
    assert 0.3 < gone / (5 * CLEAN.density * np.pi * CLEAN.patch_radius**2) < 2.0


def test_same_seed_same_cloud_and_the_next_scan_differs():
    one, two = scanner(ScannerParams(), 5), scanner(ScannerParams(), 5)
    first = one.scan(NODES)
    assert np.array_equal(first, two.scan(NODES))
    assert not np.array_equal(first[:100], one.scan(NODES)[:100])


@pytest.mark.parametrize('seed', [0, 1])
def test_the_fitted_surface_is_within_a_third_of_a_millimetre(seed):
    cloud = scanner(ScannerParams(), seed).scan(NODES)
    surface = ScannedSurface.fit(cloud, np.zeros(3))
    for direction in ([0.0, 0.0, 1.0], [0.5, 0.2, 1.0], [-0.3, 0.6, 1.0]):
        at = surface.intersection(np.zeros(3), np.array(direction))
        assert abs(np.linalg.norm(at) - RADIUS) < 0.33e-3
