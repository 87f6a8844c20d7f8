"""Slow noise that regressors take away: its colour, and the steps that it is not."""

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.devices.noise import ColouredNoise
from arm_brachy.diagnosis.statistics.change_points import steps
from arm_brachy.diagnosis.statistics.change_retest import steadfast
from arm_brachy.diagnosis.statistics.gls import whitened
from arm_brachy.diagnosis.statistics.noise_process import Colour
from arm_brachy.diagnosis.statistics.reml import restricted_colour

PERIOD, NUMBER = 0.025, 3000
T = PERIOD * np.arange(NUMBER)
VALID = np.ones(NUMBER, dtype=bool)
WAVES = np.stack([f(2.0 * np.pi * k * T / T[-1]) for k in range(1, 6) for f in (np.sin, np.cos)],
                 axis=1)
ONE = np.ones((NUMBER, 1))
RESTS = Colour(0.03, 0.35)    # what short rests show
SLOW = Colour(0.08, 5.0)      # what there is
ALARM = 1e-4


def draw(colour, name, seed=7):
    rng = stream(seed, name)
    slow = ColouredNoise((3,), colour.time, PERIOD, rng)
    return np.array([np.sqrt(colour.share) * slow.draw()
                     + np.sqrt(1.0 - colour.share) * rng.standard_normal(3)
                     for _ in range(NUMBER)])


def step_error(colour, sd):
    """Standard deviation of the size of a step at 40 %, beside the waves."""
    W = whitened(T, np.hstack([ONE, WAVES, T[:, None] > 0.4 * T[-1]]), colour, VALID)
    return sd * np.sqrt(np.linalg.inv(W.T @ W)[-1, -1])


@pytest.mark.parametrize('colour', [Colour(0.3, 0.2), Colour(0.08, 5.0), Colour(0.9, 2.0)])
@pytest.mark.parametrize('count', [1, 3, 400])
def test_log_determinant_is_that_of_the_matrix(colour, count):
    t = PERIOD * np.arange(count)
    C = np.eye(count) * (1.0 - colour.share) + colour.share * np.exp(
        -np.abs(t[:, None] - t) / colour.time)
    assert colour.log_determinant(count, PERIOD) == pytest.approx(np.linalg.slogdet(C)[1],
                                                                  abs=1e-5)


@pytest.mark.parametrize('colour', [SLOW, Colour(0.2, 1.0), RESTS])
def test_the_error_of_a_step_beside_waves_is_that_of_the_noise_drawn(colour):
    ratios = []
    for name in 'abcd':
        found, sd = restricted_colour(T, draw(colour, name), VALID, np.hstack([ONE, WAVES]),
                                      np.full(3, 1e-3))
        ratios.append(step_error(found, sd.mean()) / step_error(colour, 1.0))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)


def test_an_axis_that_never_changes_says_nothing():
    y = draw(SLOW, 'a')
    y[:, 2] = 0.0
    colour, sd = restricted_colour(T, y, VALID, np.hstack([ONE, WAVES]), np.full(3, 1e-3))
    both, both_sd = restricted_colour(T, y[:, :2], VALID, np.hstack([ONE, WAVES]),
                                      np.full(2, 1e-3))
    assert sd[2] == pytest.approx(1e-3)
    assert step_error(colour, sd[0]) == pytest.approx(step_error(both, both_sd[0]), rel=0.05)


def test_slow_noise_that_rests_do_not_show_makes_no_steps_that_stay():
    first = later = 0
    for name in 'abcdefgh':
        y, two = draw(SLOW, name), WAVES[:, :4]
        found = steps(T, y, VALID, RESTS, np.ones(3), two, alarm=ALARM)
        first += len(found)
        later += len(steadfast(found, T, y, VALID, np.ones(3), two, alarm=ALARM))
    assert first >= 8 and later == 0    # the trap is there, and nothing falls into it


def test_a_step_in_slow_noise_stays_where_it_is():
    y = draw(SLOW, 'a') + 3.0 * (T >= 30.0)[:, None] * [0.6, 0.0, -0.8]
    found = steps(T, y, VALID, RESTS, np.ones(3), WAVES, alarm=ALARM)
    one, = steadfast(found, T, y, VALID, np.ones(3), WAVES, alarm=ALARM)
    assert one.t == pytest.approx(30.0, abs=0.1)
    assert one.size == pytest.approx([1.8, 0.0, -2.4], abs=1.0)
