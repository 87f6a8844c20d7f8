"""Lag and dead time against the analytic responses, at two step sizes."""

import numpy as np
import pytest

from arm_brachy.devices.terms.actuator_lag import ActuatorLag, first_order

NO_LOAD = np.zeros(1)


def _follow(term, u_of_t, dt, n):
    memory = term.memory(np.array([u_of_t(0.0)]))
    out = []
    for k in range(1, n + 1):
        y, memory = term.step(memory, np.array([u_of_t(k * dt)]), NO_LOAD, k * dt, dt)
        out.append(float(y[0]))
    return dt * np.arange(1, n + 1), np.array(out)


def _ramp_response(t, v, tau, delay):
    s = np.maximum(t - delay, 0.0)
    return v * (s - tau + tau * np.exp(-s / tau))


@pytest.mark.parametrize('dt', [0.02, 0.007])
@pytest.mark.parametrize('delay', [0.0, 0.02, 0.033, 0.15])
def test_ramp_response_is_exact_at_any_step(dt, delay):
    tau, v = 0.025, 0.02
    t, y = _follow(ActuatorLag(time_constant=tau, delay=delay), lambda s: v * s, dt, 60)
    np.testing.assert_allclose(y, _ramp_response(t, v, tau, delay), rtol=0.0, atol=1e-16)


def test_step_response_converges_at_first_order():
    """A step is seen as a ramp over one tick: the error halves with the tick."""
    tau, size = 0.05, 0.01
    errors = []
    for dt in (0.02, 0.01):
        t, y = _follow(ActuatorLag(time_constant=tau), lambda s: size * (s > 0.0), dt,
                       round(0.4 / dt))
        analytic = size * (1.0 - np.exp(-t / tau))
        errors.append(np.abs(y - analytic)[-1])
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.25)
    assert errors[1] < size * 0.01 / tau


def test_steady_ramp_trails_by_speed_times_total_delay():
    """The error of following, v (tau + D): what a lag is known by."""
    tau, delay, v = 0.02, 0.03, 0.01
    t, y = _follow(ActuatorLag(time_constant=tau, delay=delay), lambda s: v * s, 0.02, 100)
    assert v * t[-1] - y[-1] == pytest.approx(v * (tau + delay), rel=1e-9)


def test_unity_gain_at_rest():
    _, y = _follow(ActuatorLag(time_constant=0.02, delay=0.05), lambda s: min(s, 0.5) * 0.02,
                   0.02, 100)
    assert y[-1] == pytest.approx(0.01, abs=1e-12)


def test_pure_delay_shifts_and_none_is_transparent():
    def path(s):
        return 0.01 * np.sin(3.0 * s)
    t, y = _follow(ActuatorLag(time_constant=0.0, delay=0.06), path, 0.02, 50)
    np.testing.assert_allclose(y, path(np.maximum(t - 0.06, 0.0)), atol=1e-15)
    t, y = _follow(ActuatorLag(time_constant=0.0), path, 0.02, 50)
    np.testing.assert_allclose(y, path(t), atol=1e-18)


def test_sine_meets_gain_and_phase_of_a_first_order_system():
    """Frequency response 1 / (1 + i w tau) exp(-i w D), after the transient."""
    tau, delay, w, dt = 0.03, 0.02, 12.0, 0.002
    t, y = _follow(ActuatorLag(time_constant=tau, delay=delay), lambda s: np.sin(w * s), dt, 2000)
    response = np.exp(-1j * w * delay) / (1.0 + 1j * w * tau)
    late = t > 1.0
    expected = np.imag(response * np.exp(1j * w * t[late]))
    np.testing.assert_allclose(y[late], expected, atol=(w * dt)**2 / 8.0 * 1.01)


def test_memory_stays_short_and_is_not_shared():
    term = ActuatorLag(time_constant=0.02, delay=0.05)
    memory = term.memory(np.zeros(2))
    for k in range(1, 500):
        y, memory = term.step(memory, np.full(2, 0.001 * k), np.zeros(2), 0.02 * k, 0.02)
        kept = memory.output.copy()
        y[:] = -1.0
        np.testing.assert_array_equal(memory.output, kept)
    assert len(memory.times) <= 5


def test_first_order_without_time():
    np.testing.assert_array_equal(first_order(np.array([2.0]), np.zeros(1), np.ones(1), 0.0, 0.1),
                                  [2.0])
