"""Trapezoidal profiles against elementary kinematics."""

import numpy as np
import pytest

from arm_brachy.devices.motion_profile import Motion, Profile, lag_behind, plan, stopping_point

SPEED, ACCELERATION = 0.02, 0.2  # m/s, m/s^2


def _trace(profile, dt, steps):
    out = [profile.motion]
    for _ in range(steps):
        profile.advance(dt)
        out.append(profile.motion)
    return np.array(out)


@pytest.mark.parametrize('distance', [0.01, -0.01, 0.002])
def test_duration_is_the_textbook_minimum(distance):
    """v/a + d/v when full speed is reached (d >= v^2/a), 2 sqrt(d/a) when it is not."""
    d = abs(distance)
    full = d >= SPEED**2 / ACCELERATION
    expected = SPEED / ACCELERATION + d / SPEED if full else 2.0 * np.sqrt(d / ACCELERATION)
    phases = plan(Motion(0.0, 0.0), distance, SPEED, ACCELERATION)
    assert sum(p.duration for p in phases) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize('dt', [0.001, 0.007, 0.02, 0.3])
def test_rest_to_rest_keeps_limits_and_never_overshoots(dt):
    profile = Profile(Motion(0.0, 0.0), 0.0123, SPEED, ACCELERATION)
    trace = _trace(profile, dt, int(1.5 / dt))
    position, velocity = trace.T
    assert profile.done
    assert position[-1] == 0.0123
    assert position.max() <= 0.0123
    assert (np.diff(position) >= 0.0).all()
    assert np.abs(velocity).max() <= SPEED * (1 + 1e-12)
    assert np.abs(np.diff(velocity)).max() <= ACCELERATION * dt * (1 + 1e-9)


def test_cutting_time_differently_changes_nothing():
    fine = _trace(Profile(Motion(0.0, 0.0), 0.01, SPEED, ACCELERATION), 0.01, 70)
    coarse = _trace(Profile(Motion(0.0, 0.0), 0.01, SPEED, ACCELERATION), 0.02, 35)
    np.testing.assert_allclose(fine[::2], coarse, rtol=0.0, atol=1e-15)


def test_any_sequence_of_targets_stays_between_the_extreme_targets():
    """Retargeting on the fly may pass the new target, never the range of all targets."""
    rng = np.random.default_rng(7)
    profile = Profile(Motion(0.0, 0.0), 0.0, SPEED, ACCELERATION)
    positions, velocities = [], []
    for target in rng.uniform(0.0, 0.03, 300):
        speed = rng.uniform(0.2, 1.0) * SPEED
        profile = Profile(profile.motion, target, speed, ACCELERATION)
        trace = _trace(profile, 0.01, int(rng.integers(1, 40)))
        positions += list(trace[:, 0])
        velocities.append(np.abs(np.diff(trace[:, 1])).max())
    assert min(positions) >= -1e-15
    assert max(positions) <= 0.03 + 1e-15
    assert max(velocities) <= ACCELERATION * 0.01 * (1 + 1e-9)


def test_too_fast_to_stop_brakes_then_returns():
    start = Motion(0.0, SPEED)
    profile = Profile(start, 0.0001, SPEED, ACCELERATION)
    trace = _trace(profile, 0.001, 300)
    assert trace[:, 0].max() == pytest.approx(stopping_point(start, ACCELERATION), abs=1e-7)
    assert profile.motion == Motion(0.0001, 0.0)


def test_slower_command_slows_down_first():
    profile = Profile(Motion(0.0, SPEED), 0.02, 0.5 * SPEED, ACCELERATION)
    trace = _trace(profile, 0.05, 80)
    assert trace[1, 1] == pytest.approx(0.5 * SPEED)
    assert profile.motion.position == 0.02


def test_lag_follows_a_ramp_late_by_its_time_constant():
    """tau y' + y = v t from rest: y = v (t - tau + tau exp(-t / tau))."""
    tau, v, t = 0.015, 0.02, 0.04
    pieces = Profile(Motion(0.0, v), 1.0, v, ACCELERATION).advance(t)
    expected = v * (t - tau + tau * np.exp(-t / tau))
    assert lag_behind(0.0, pieces, tau) == pytest.approx(expected, rel=1e-12)


def test_lag_matches_numerical_integration_of_the_whole_profile():
    tau, steps, dt = 0.03, 20000, 5e-5
    pieces = Profile(Motion(0.0, 0.0), 0.01, SPEED, ACCELERATION).advance(steps * dt)
    fine = Profile(Motion(0.0, 0.0), 0.01, SPEED, ACCELERATION)
    u = _trace(fine, dt, steps)[:, 0]
    y = 0.0
    for k in range(steps):  # trapezoidal rule, second order
        y = ((1.0 - 0.5 * dt / tau) * y + 0.5 * dt / tau * (u[k] + u[k + 1])) / (
            1.0 + 0.5 * dt / tau)
    assert lag_behind(0.0, pieces, tau) == pytest.approx(y, abs=1e-9)
