"""Noise with a memory, clocks that are off, gaps: as much as is said, and no more."""

import numpy as np
import pytest

from arm_brachy.experiments.csv_files import EM, ENCODERS, FORCES, OPTICAL
from arm_brachy.experiments.half_cylinder import sensors
from arm_brachy.experiments.half_cylinder.sensors import DEVICES

SLOW = (FORCES, OPTICAL, EM)


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize('device', SLOW)
def test_noise_has_its_colour(device):
    """The covariance at a lag is slow^2 exp(-lag / memory), without lag the white besides.

    300 channels of 100 s: of 5 s of memory each has some 10 independent stretches, which tell the
    slow variance to sqrt(2 / 3000), three per cent.
    """
    of = DEVICES[device]
    values = sensors.noise(of, (int(100 * of.rate), 300), rng())
    assert values.var() == pytest.approx(of.white ** 2 + of.slow ** 2, rel=0.03)
    for lag in (0.5, of.memory):
        k = round(lag * of.rate)
        told = np.mean(values[k:] * values[:-k])
        assert told == pytest.approx(of.slow ** 2 * np.exp(-k / of.rate / of.memory), rel=0.12)
    assert 0.08 < of.slow ** 2 / (of.white ** 2 + of.slow ** 2) < 0.15
    assert 4.0 <= of.memory <= 6.0


def test_slow_noise_begins_as_large_as_it_stays():
    of = DEVICES[OPTICAL]
    first = sensors.noise(of, (2, 20000), rng())[0]
    assert first.std() == pytest.approx(np.hypot(of.white, of.slow), rel=0.02)


@pytest.mark.parametrize('device', DEVICES)
def test_instants_are_even_but_for_jitter(device):
    of = DEVICES[device]
    t = sensors.instants(of, 97.0, rng())
    steps = np.diff(t)
    assert steps.mean() == pytest.approx(1.0 / of.rate, rel=1e-3)
    # two independent instants: sqrt(2) of the jitter
    assert steps.std() == pytest.approx(np.sqrt(2.0) * of.jitter, rel=0.1, abs=1e-12)
    assert t[0] > of.clock and t[-1] < 97.0


def test_clocks_are_off_by_what_they_may():
    clocks = [sensors.clock(DEVICES[EM], rng(seed)) for seed in range(300)]
    late = np.array([one.late for one in clocks])
    assert np.abs(late).max() <= 20e-3
    assert late.std() == pytest.approx(40e-3 / np.sqrt(12), rel=0.1)
    assert np.std([one.rate for one in clocks]) == pytest.approx(1e-5, rel=0.1)
    assert clocks[0].stamps(np.array([50.0])) == pytest.approx(
        50.0 + clocks[0].late + 50.0 * clocks[0].rate)
    assert sensors.clock(DEVICES[ENCODERS], rng()) == sensors.Clock(0.0, 0.0)


@pytest.mark.parametrize('device, share', [(FORCES, 1.0), (EM, 1.0), (OPTICAL, 0.4)])
def test_gaps_are_in_a_row_and_where_they_may_be(device, share):
    of, lost = DEVICES[device], []
    for seed in range(40):
        values = np.zeros((2000, 5, 3))
        sensors.lose(values, of, rng(seed))
        gone = np.isnan(values).any(axis=2)
        assert not gone[:100].any() and not gone[-100:].any()
        for channel in gone.T:
            lost.append(channel.sum())
            if channel.any():
                assert of.gap[0] <= channel.sum() <= of.gap[1]
                assert np.ptp(np.flatnonzero(channel)) == channel.sum() - 1
    assert np.mean(np.array(lost) > 0) == pytest.approx(share, abs=0.1)


def test_a_frame_is_turned_and_shifted():
    points = rng(3).normal(0.0, 0.05, (1, 30, 3))
    seen = sensors.in_frame(points, rng(1))
    gaps = [np.linalg.norm(some[0, :, None] - some[0], axis=-1) for some in (points, seen)]
    np.testing.assert_allclose(gaps[1], gaps[0], atol=3e-6)     # half the turn squared
    assert np.abs(seen - points).max() > 1e-4
