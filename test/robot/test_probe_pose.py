"""The probe's strategies put the tip into the image plane; the scan gives the skin back."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import InputError
from arm_brachy.robot.probe_arm_params import ProbeArmParams
from arm_brachy.robot.probe_planner import TranslationalPlanner
from arm_brachy.robot.probe_pose import (
    orientation_goal,
    out_of_plane,
    translational_goal,
    turned_onto,
)
from arm_brachy.robot.surface_scan import ScannedSurface, ScanParams

AXES = np.array([0.065, 0.060, 0.055])      # m, half an ellipsoid
INSIDE = np.array([0.0, 0.0, 0.01])
NOISE = 0.5e-3
HOLE = np.array([0.4, 0.3, 0.866]) / np.linalg.norm([0.4, 0.3, 0.866])


def cloud(rng, *, noise=NOISE, outliers=0.01, hole=0.012):
    """Points on the skin of a half ellipsoid as a scanner has them; nothing within `hole` [m]."""
    u = rng.normal(size=(40_000, 3))
    u[:, 2] = np.abs(u[:, 2])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    points = AXES * u
    points = points[np.linalg.norm(points - AXES * HOLE, axis=1) > hole]
    points += noise * rng.normal(size=points.shape)
    stray = rng.uniform(size=len(points)) < outliers
    points[stray] += rng.uniform(-0.03, 0.03, size=(stray.sum(), 3))
    return points


@pytest.fixture(scope='module')
def skin():
    return ScannedSurface.fit(cloud(np.random.default_rng(2)), INSIDE)


def directions():
    return [np.array([np.sin(t) * np.cos(f), np.sin(t) * np.sin(f), np.cos(t)])
            for t in np.radians([5, 30, 55, 70]) for f in np.radians([10, 130, 250])]


def true_exit(start, u):
    """Where a ray leaves the ellipsoid, and its outward normal there."""
    a, b, c = (u / AXES) @ (u / AXES), (start / AXES) @ (u / AXES), (start / AXES) @ (start / AXES)
    p = start + (-b + np.sqrt(b * b - a * (c - 1.0))) / a * u
    n = p / AXES**2
    return p, n / np.linalg.norm(n)


def test_the_skin_comes_back_from_a_noisy_cloud_with_outliers(skin):
    for u in directions():
        found = skin.intersection(INSIDE, u)
        true, normal = true_exit(INSIDE, u)
        assert np.linalg.norm(found - true) < 0.6 * NOISE
        assert np.degrees(np.arccos(skin.normal(found) @ normal)) < 2.5


def test_a_hole_in_the_cloud_is_bridged(skin):
    u = AXES * HOLE - INSIDE
    found = skin.intersection(INSIDE, u)
    assert np.linalg.norm(found - AXES * HOLE) < 1.0e-3


def test_without_noise_only_the_flattening_of_patches_is_left():
    rng = np.random.default_rng(3)
    exact = ScannedSurface.fit(cloud(rng, noise=0.0, outliers=0.0, hole=0.0), INSIDE)
    errors = [np.linalg.norm(exact.intersection(INSIDE, u) - true_exit(INSIDE, u)[0])
              for u in directions()]
    # The mean of a disc of radius r on a curved skin lies r^2 / 4R below it; as much again for
    # what the spline does between patches.
    area, sharpest = 2.0 * np.pi * AXES[0] * AXES[1], AXES.min() ** 2 / AXES.max()
    squared = ScanParams().neighbours / 40_000 * area / np.pi
    assert max(errors) < 2.0 * squared / (4.0 * sharpest)


def test_a_line_that_meets_no_skin_and_an_empty_cloud_are_refused(skin):
    with pytest.raises(InputError, match='does not meet the skin'):
        skin.intersection(np.array([0.5, 0.5, 0.5]), np.array([1.0, 0.0, 0.0]))
    with pytest.raises(InputError, match='0 points; must be'):
        ScannedSurface.fit(np.full((10, 3), np.nan), INSIDE, ScanParams())


def test_turning_handles_parallel_and_antiparallel_axes():
    rng = np.random.default_rng(0)
    for _ in range(20):
        z, goal = rng.normal(size=(2, 3))
        z, goal = z / np.linalg.norm(z), goal / np.linalg.norm(goal)
        R = turned_onto(z, goal)
        assert np.allclose(R @ z, goal) and np.allclose(R @ R.T, np.eye(3))
        assert np.isclose(Rotation.from_matrix(R).magnitude(), np.arccos(z @ goal))
        assert np.allclose(turned_onto(z, z), np.eye(3))
        back = turned_onto(z, -z)
        assert np.allclose(back @ z, -z) and np.isclose(np.linalg.det(back), 1.0)


def test_the_orientation_strategy_keeps_the_contact_and_points_at_the_tip():
    rng = np.random.default_rng(1)
    R = Rotation.from_euler('xyz', [170, 5, 30], degrees=True).as_matrix()
    contact = np.array([0.01, 0.02, 0.05])
    for tip in contact + rng.uniform(-0.03, 0.03, size=(10, 3)) - [0, 0, 0.05]:
        goal = orientation_goal(R, contact, tip)
        assert np.allclose(goal.p, contact)
        assert abs(out_of_plane(goal.R, goal.p, tip)) < 1e-12
        assert np.isclose(goal.R[:, 2] @ (tip - contact), np.linalg.norm(tip - contact))
    with pytest.raises(InputError, match='withdraw the needle'):
        orientation_goal(R, contact, contact + 1e-4)


def test_the_translational_strategy_stands_on_the_skin_over_the_tip_across_the_needle(skin):
    needle = np.array([0.0, 1.0, 0.1]) / np.linalg.norm([0.0, 1.0, 0.1])
    contact = np.array([0.0, 0.0, AXES[2]])
    for depth in np.linspace(-0.03, 0.03, 7):
        tip = np.array([0.004, 0.0, 0.025]) + depth * needle
        goal = translational_goal(skin, contact, tip, needle)
        assert abs(skin.level(goal.p)[0]) < 1e-5
        assert np.allclose(goal.R @ goal.R.T, np.eye(3)) and np.linalg.det(goal.R) > 0.0
        assert np.allclose(goal.R[:, 1], needle)
        offset = tip - goal.p
        assert np.allclose(offset, goal.R[:, 2] * np.linalg.norm(offset), atol=1e-9)
    with pytest.raises(InputError, match='axis of the needle'):
        translational_goal(skin, np.array([0.004, 0.0, 0.025]) + 0.02 * needle,
                           np.array([0.004, 0.0, 0.025]), needle)


def test_the_face_goes_aside_while_the_probe_turns_so_that_its_plane_stays_on_the_tip(skin):
    """A point of a plane with normal y: y . (v - v_face) + (w x y) . (p - p_face) = 0."""
    needle, tip, dt = np.array([0.0, 1.0, 0.0]), np.array([0.004, 0.0, 0.025]), 0.05
    turning, v = np.array([0.1, 0.0, 0.0]), 5e-3 * needle
    planner = TranslationalPlanner(ProbeArmParams(), skin, tip, needle, np.array([0.0, 0.0, -1.0]))
    R = planner.over(tip, needle).R
    for k in range(8):      # the first ones look for where the probe can stand
        now = Rotation.from_rotvec(k * dt * turning).as_matrix() @ R
        plan = planner.plan(tip, needle, v, SimpleNamespace(R=now, in_contact=True), dt)
    y = now[:, 1]
    left = y @ (v - plan.v) + np.cross(turning, y) @ (tip - plan.p)
    assert abs(np.cross(turning, y) @ (tip - plan.p)) > 2e-3    # m/s that it would be off by
    assert abs(left) < 5e-5
