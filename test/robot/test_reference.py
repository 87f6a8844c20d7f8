"""The reference keeps its limits, arrives, and turns the short way."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.robot.panda_parameters import CARTESIAN_LIMITS
from arm_brachy.robot.reference import Reference, ReferenceParams, rotation, rotation_vector

DT = 1e-3
PARAMS = ReferenceParams()


@pytest.mark.parametrize('angle', [0.0, 1e-9, 1e-4, 1.0, 3.0, np.pi - 1e-4])
def test_rotation_vectors_agree_with_scipy(angle):
    rng = np.random.default_rng(1)
    for _ in range(20):
        axis = rng.normal(size=3)
        vector = angle * axis / np.linalg.norm(axis)
        assert np.allclose(rotation(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12)
        assert np.allclose(rotation_vector(rotation(vector)), vector, atol=1e-8)


@pytest.mark.parametrize('axis', [[1, 0, 0], [0, -1, 0], [0, 0, 1], [1, 2, -2]])
def test_half_a_turn_has_a_rotation_vector(axis):
    R = Rotation.from_rotvec(np.pi * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    found = rotation_vector(R)
    assert np.isclose(np.linalg.norm(found), np.pi)
    assert np.allclose(rotation(found), R, atol=1e-12)


def led(goal_R, goal_p, seconds):
    """Positions, velocities and angular velocities of a reference started at the origin."""
    reference = Reference(PARAMS, np.eye(3), np.zeros(3))
    track = []
    for _ in range(round(seconds / DT)):
        reference.step(goal_R, goal_p, DT)
        track.append(np.concatenate([reference.p, reference.v, reference.w]))
    return reference, np.array(track)


@pytest.mark.parametrize('distance', [0.001, 0.02, 0.4])
def test_a_step_is_reached_without_overshoot_within_every_limit(distance):
    goal = distance * np.array([1.0, -2.0, 2.0]) / 3.0
    reference, track = led(np.eye(3), goal, 1.5 + distance / PARAMS.speed)
    assert np.allclose(reference.p, goal, atol=1e-3 * distance)
    along = track[:, :3] @ goal / distance
    assert along.max() <= distance * (1 + 1e-6)
    speed = np.linalg.norm(track[:, 3:6], axis=1)
    acceleration = np.linalg.norm(np.diff(track[:, 3:6], axis=0), axis=1) / DT
    jerk = np.linalg.norm(np.diff(track[:, 3:6], n=2, axis=0), axis=1) / DT**2
    assert speed.max() <= PARAMS.speed * 1.001
    assert acceleration.max() <= PARAMS.acceleration * 1.001
    assert jerk.max() <= CARTESIAN_LIMITS.jerk


def test_it_turns_the_short_way_and_stops_at_the_goal():
    goal = Rotation.from_rotvec([0.0, 0.0, 3.0])
    reference, track = led(goal.as_matrix(), np.zeros(3), 6.0)
    assert np.allclose(reference.R, goal.as_matrix(), atol=1e-4)
    assert np.all(track[:, 8] >= -1e-9)
    assert np.linalg.norm(track[:, 6:], axis=1).max() <= PARAMS.turning * 1.001


def test_a_goal_that_moves_is_followed_with_the_lag_of_the_first_rate():
    reference, speed = Reference(PARAMS, np.eye(3), np.zeros(3)), 0.02
    for k in range(4000):
        reference.step(np.eye(3), np.array([speed * k * DT, 0.0, 0.0]), DT)
    lag = speed * 3999 * DT - reference.p[0]
    assert np.isclose(lag, speed / PARAMS.rate, rtol=0.02)
