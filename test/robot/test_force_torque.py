"""The tool is weighed right, its weight goes with the pose, and the zero is followed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import InputError
from arm_brachy.robot.force_torque import (
    BiasTracker,
    ForceTorqueParams,
    ForceTorqueSensor,
    calibrate,
)
from arm_brachy.robot.rigid_body import STANDARD_GRAVITY, Payload

PROBE = Payload(0.45, np.array([0.002, 0.01, 0.06]), np.diag([8e-4, 7e-4, 3e-4]))
QUIET = replace(ForceTorqueParams(), force_noise=0.0, moment_noise=0.0, drift=0.0)
NOTHING = np.zeros(6)


def tilts(n, angle=0.6):
    turn = Rotation.from_rotvec([[angle * np.cos(k), angle * np.sin(k), 0.3 * k]
                                 for k in 2 * np.pi * np.arange(n) / n])
    return turn.as_matrix() @ np.diag([1.0, -1.0, -1.0])


def sensor(params=QUIET, seed=0):
    return ForceTorqueSensor(params, PROBE, np.random.default_rng(seed))


def test_without_noise_mass_centre_and_zero_are_exact():
    made, R = sensor(), tilts(3)
    load = calibrate([made.read(r, STANDARD_GRAVITY, NOTHING) for r in R], R, STANDARD_GRAVITY)
    assert np.isclose(load.mass, PROBE.mass)
    assert np.allclose(load.centre, PROBE.centre, atol=1e-9)
    for r in tilts(5, 1.2):
        assert np.allclose(load.contact(made.read(r, STANDARD_GRAVITY, NOTHING), r,
                                        STANDARD_GRAVITY), 0.0, atol=1e-9)


def test_a_contact_comes_out_as_it_was_put_in():
    made, R = sensor(), tilts(4)
    load = calibrate([made.read(r, STANDARD_GRAVITY, NOTHING) for r in R], R, STANDARD_GRAVITY)
    touch = np.array([0.5, -1.0, -4.0, 0.02, 0.01, 0.0])
    r = tilts(7, 0.9)[3]
    assert np.allclose(load.contact(made.read(r, STANDARD_GRAVITY, touch), r, STANDARD_GRAVITY),
                       touch, atol=1e-9)


def test_noise_scatters_the_mass_as_least_squares_predict():
    """Of g's direction only what differs between tilts tells mass from bias."""
    noise = replace(QUIET, force_noise=0.1)
    R = tilts(12, 1.2)
    found = []
    for seed in range(200):
        made = sensor(noise, seed)
        readings = [made.read(r, STANDARD_GRAVITY, NOTHING) for r in R]
        found.append(calibrate(readings, R, STANDARD_GRAVITY).mass)
    down = np.einsum('nji,j->ni', R, STANDARD_GRAVITY)
    spread = np.sqrt(np.sum((down - down.mean(axis=0))**2))
    assert np.isclose(np.std(found), 0.1 / spread, rtol=0.2)
    assert abs(np.mean(found) - PROBE.mass) < 4 * 0.1 / spread / np.sqrt(200)


@pytest.mark.parametrize('R', [tilts(2), np.repeat(tilts(1), 5, axis=0), tilts(5, 1e-4)])
def test_too_few_or_too_similar_orientations_are_refused(R):
    made = sensor()
    readings = [made.read(r, STANDARD_GRAVITY, NOTHING) for r in R]
    with pytest.raises(InputError, match='orientations'):
        calibrate(readings, R, STANDARD_GRAVITY)


def test_a_shifted_zero_is_followed_in_the_air_with_the_time_constant():
    made, R, shift = sensor(), tilts(6), np.array([0.3, -0.2, 0.5, 0.01, 0.0, -0.02])
    load = calibrate([made.read(r, STANDARD_GRAVITY, NOTHING) for r in R], R, STANDARD_GRAVITY)
    tracker = BiasTracker(load, time_constant=2.0)
    for _ in range(4000):
        tracker.step(made.read(R[0], STANDARD_GRAVITY, shift), R[0], STANDARD_GRAVITY)
    assert np.allclose(tracker.load.bias - load.bias, (1.0 - np.exp(-2.0)) * shift, rtol=1e-3)


def test_the_zero_walks_as_far_in_a_minute_as_is_said():
    walking = replace(QUIET, drift=0.1, force_bias=0.0)
    ends = []
    for seed in range(60):
        made = ForceTorqueSensor(walking, PROBE, np.random.default_rng(seed), period=1.0)
        for _ in range(60):
            reading = made.read(np.eye(3), np.zeros(3), NOTHING)
        ends.append(reading[:3])
    assert np.isclose(np.std(ends), 0.1, rtol=0.15)
