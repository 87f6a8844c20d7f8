"""Every number against a signal whose value is known in closed form."""

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.core.random import stream
from arm_brachy.evaluation import metrics

A, TAU = 5e-3, 0.8
ALL = np.ones(3, dtype=bool)


@pytest.fixture
def first_order():
    """Step of size A along x with time constant TAU, long enough to have ended."""
    t = np.arange(0.0, 40 * TAU, 1e-3)
    p = np.zeros((len(t), 3))
    p[:, 0] = A * (1 - np.exp(-t / TAU))
    return t, p, np.zeros(3), np.array([A, 0, 0])


def test_itae_of_a_first_order_response_is_a_tau_squared(first_order):
    t, p, _, goal = first_order
    assert metrics.itae(t, metrics.deviation(p, goal, ALL)) == pytest.approx(A * TAU**2, rel=1e-5)


def test_itae_of_a_constant_error_and_its_clock():
    t = np.linspace(100.0, 110.0, 1001)
    error = np.full(len(t), -0.3e-3)
    assert metrics.itae(t, error) == pytest.approx(0.3e-3 * 50.0)
    late = metrics.itae(t, error, t_start=98.0)
    assert late == pytest.approx(0.3e-3 * (12.0**2 - 2.0**2) / 2)


def test_itae_needs_two_samples():
    assert np.isnan(metrics.itae(np.zeros(1), np.zeros(1)))


def test_itae_converges_at_second_order():
    def error_at(n):
        t = np.linspace(0.0, 10.0, n)
        exact = A * (TAU**2 - np.exp(-10 / TAU) * TAU * (10 + TAU))
        return abs(metrics.itae(t, A * np.exp(-t / TAU)) - exact)

    rate = np.log2(error_at(201) / error_at(401))
    assert rate == pytest.approx(2.0, abs=0.05)


def test_free_axes_do_not_count():
    t = np.linspace(0, 1, 11)
    p = np.tile([1e-3, 7e-3, -9e-3], (11, 1))
    error = metrics.deviation(p, np.zeros(3), (True, False, False))
    assert metrics.steady_state(t, error, 0.5).mean_abs == pytest.approx(1e-3)
    assert metrics.overshoot(p, np.zeros(3), np.zeros(3), ALL).distance == 0.0


def test_rise_and_settling_time_of_a_first_order_response(first_order):
    t, p, start, goal = first_order
    assert metrics.rise_time(t, p, start, goal, ALL) == pytest.approx(TAU * np.log(9), abs=1e-5)
    error = metrics.deviation(p, goal, ALL)
    band = 0.3e-3
    assert metrics.settling_time(t, error, band) == pytest.approx(TAU * np.log(A / band), abs=1e-5)


def test_first_order_response_never_passes_its_goal(first_order):
    t, p, start, goal = first_order
    short = metrics.overshoot(p[t <= TAU], start, goal, ALL)
    assert short.fraction == pytest.approx(-np.exp(-1), rel=1e-3)
    assert np.isnan(metrics.rise_time(t[t <= TAU], p[t <= TAU], start, goal, ALL))


@pytest.mark.parametrize('zeta', [0.2, 0.5, 0.8])
def test_overshoot_of_a_second_order_step(zeta):
    t = np.arange(0.0, 12.0, 1e-3)
    damped = np.sqrt(1 - zeta**2)
    w = 4.0
    s = 1 - np.exp(-zeta * w * t) * (np.cos(w * damped * t)
                                     + zeta / damped * np.sin(w * damped * t))
    goal = np.array([-3e-3, 4e-3, 0.0])
    result = metrics.overshoot(s[:, None] * goal, np.zeros(3), goal, ALL)
    expected = np.exp(-np.pi * zeta / damped)
    assert result.fraction == pytest.approx(expected, rel=1e-4)
    assert result.distance == pytest.approx(5e-3 * expected, rel=1e-4)


def test_settling_counts_the_last_exit():
    t = np.arange(0.0, 10.0, 0.01)
    error = np.where((t > 6.0) & (t < 7.0), 1e-3, 0.0)
    assert metrics.settling_time(t, error, 0.5e-3) == pytest.approx(7.0, abs=0.011)
    assert metrics.settling_time(t, error[::-1] * 0, 0.5e-3) == 0.0
    assert np.isnan(metrics.settling_time(t, np.full(len(t), 1e-3), 0.5e-3))


def test_steady_state_tells_offset_from_noise():
    rng = stream(1, 'steady state')
    t = np.arange(0.0, 400.0, 0.01)
    sd, offset = 0.1e-3, np.array([0.2e-3, 0, 0])
    error = offset + sd * rng.standard_normal((len(t), 3))
    error[t < 200.0] = 1.0
    steady = metrics.steady_state(t, error, 199.0)
    assert steady.offset == pytest.approx(0.2e-3, rel=0.02)
    assert steady.spread == pytest.approx(np.sqrt(3) * sd, rel=0.02)
    assert steady.mean_abs > steady.offset


def test_mean_of_pure_noise_is_the_maxwell_mean():
    rng = stream(2, 'maxwell')
    error = 1e-4 * rng.standard_normal((200_000, 3))
    steady = metrics.steady_state(np.arange(len(error)) * 0.01, error, 1e9)
    assert steady.mean_abs == pytest.approx(1e-4 * np.sqrt(8 / np.pi), rel=0.01)


@pytest.mark.parametrize('call', [lambda: metrics.steady_state(np.zeros(1), np.zeros((1, 3)), 0.0),
                                  lambda: metrics.settling_time(np.zeros(1), np.zeros(1), -1.0)])
def test_a_window_or_band_that_makes_no_sense_is_refused(call):
    with pytest.raises(InputError, match='must be > 0'):
        call()


def test_pad_travel_of_a_triangle_wave():
    t = np.linspace(0, 6, 601)
    wave = 2e-3 * np.abs((t % 2) - 1)
    travel = metrics.pad_travel(np.stack([wave, np.zeros_like(wave)], axis=1))
    assert travel == pytest.approx([6 * 2e-3, 0.0])


def test_peak_force_skips_gaps_and_says_when_there_is_nothing():
    force = np.zeros((5, 2, 3))
    force[2, 0] = [3.0, 4.0, 0.0]
    force[3, 0] = np.nan
    force[:, 1] = np.nan
    peak = metrics.peak_force(force)
    assert peak[0] == 5.0
    assert np.isnan(peak[1])


def test_stream_with_a_hole():
    stamps = np.delete(np.arange(0, 101) / 10.0, range(40, 45))
    quality = metrics.stream_quality(stamps, published=101)
    assert (quality.count, quality.lost) == (96, 5)
    assert quality.rate == pytest.approx(95 / 10.0)
    assert quality.longest_gap == pytest.approx(0.6)
    gaps = np.full(95, 0.1)
    gaps[0] = 0.6
    assert quality.jitter == pytest.approx(gaps.std())


def test_stream_too_short_to_have_a_rate():
    quality = metrics.stream_quality(np.array([3.0]))
    assert quality.count == 1
    assert quality.lost is None
    assert np.isnan([quality.rate, quality.jitter, quality.longest_gap]).all()


def test_real_time_factor():
    assert metrics.real_time_factor(30.0, 12.0) == 2.5
    assert np.isnan(metrics.real_time_factor(30.0, None))
    assert np.isnan(metrics.real_time_factor(30.0, 0.0))
