"""Steps at unknown times: how often noise makes one, how well a true one is found."""

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.devices.noise import ColouredNoise
from arm_brachy.diagnosis.statistics.change_points import (
    Step,
    chance,
    joined,
    step_scan,
    steps,
    threshold,
)
from arm_brachy.diagnosis.statistics.noise_process import Colour

N, PERIOD = 500, 0.01
T = np.arange(N) * PERIOD
SLOW = Colour(0.3, 0.3)


def noise(rng, colour, c):
    slow = ColouredNoise((c,), colour.time, PERIOD, rng)
    return np.array([np.sqrt(colour.share) * slow.draw() for _ in T]) + (
        np.sqrt(1.0 - colour.share) * rng.standard_normal((N, c)))


@pytest.mark.parametrize('colour, c', [(Colour(), 1), (Colour(), 3), (SLOW, 3),
                                       (Colour(1.0, 0.1), 1)])
def test_false_alarms_are_as_rare_as_stated(colour, c):
    """Of 300 records 5 % may alarm: more than 26 would happen once in a thousand times."""
    rng = stream(3, f'null {colour} {c}')
    nuisance = np.stack([T, T ** 2], axis=1)
    alarms = sum(step_scan(T, noise(rng, colour, c), rng.random(N) > 0.02, colour, np.ones(c),
                           nuisance).chance < 0.05 for _ in range(300))
    assert alarms <= 26


def test_a_long_gap_makes_no_step():
    """Hidden for a fifth of the time: the sample on its edge lends its noise to no other."""
    colour, rng, alarms = Colour(0.1, 1.5), stream(3, 'gap'), 0
    for _ in range(300):
        valid, k = np.ones(N, dtype=bool), rng.integers(50, N - 150)
        valid[k:k + 100] = False
        alarms += step_scan(T, noise(rng, colour, 3), valid, colour, np.ones(3)).chance < 0.05
    assert alarms <= 26


def test_the_bound_is_not_idle():
    """White noise, one series: 5 % of alarms by the bound are at least 2 % in truth."""
    rng = stream(3, 'bound')
    alarms = sum(step_scan(T, noise(rng, Colour(), 1), np.ones(N, dtype=bool), Colour(),
                           np.ones(1)).chance < 0.05 for _ in range(500))
    assert alarms >= 10


def test_threshold_is_the_inverse_of_chance():
    neighbours = np.full(400, 0.99)
    for c in (1, 3):
        assert chance(threshold(1e-3, c, neighbours), c, neighbours) == pytest.approx(1e-3)


def test_without_neighbours_it_is_the_chi_square_tail():
    assert chance(10.8276, 1, np.zeros(0)) == pytest.approx(1e-3, rel=1e-3)


@pytest.mark.parametrize('colour', [Colour(), SLOW])
def test_onset_lies_in_its_interval_nine_times_in_ten(colour):
    rng = stream(3, f'onset {colour}')
    hits = 0
    for _ in range(150):
        k, y = rng.integers(60, N - 60), noise(rng, colour, 1)
        y[k:] += 1.5
        step = step_scan(T, y, np.ones(N, dtype=bool), colour, np.ones(1))
        hits += step.low <= T[k - 1] and T[k] <= step.high
    assert hits >= 123   # 90 % of 150 less three standard deviations


def test_size_and_its_error():
    rng, off = stream(3, 'size'), []
    for _ in range(100):
        y = noise(rng, SLOW, 3)
        y[200:] += [2.0, -1.0, 0.0]
        step = step_scan(T, y, np.ones(N, dtype=bool), SLOW, np.ones(3))
        off.append((step.size - [2.0, -1.0, 0.0]) / step.sd)
    assert 0.85 < np.std(off) < 1.15 and abs(np.mean(off)) < 0.2


def test_a_gap_during_a_motion_is_no_step():
    """A marker that moves in proportion to a known push is hidden for half of the ramp."""
    rng = stream(3, 'gap')
    push = np.clip((T - 1.0) / 1.0, 0.0, 1.0)
    y, valid = noise(rng, SLOW, 1) + 50.0 * push[:, None], ~((T > 1.3) & (T < 1.8))
    y[~valid] = np.nan
    step = step_scan(T, y, valid, SLOW, np.ones(1), push[:, None])
    assert step.chance > 1e-3


def test_two_steps_are_both_found_with_their_sizes():
    rng = stream(3, 'two')
    y = noise(rng, Colour(), 1)
    y[150:] += 3.0
    y[350:] -= 4.0
    first, second = steps(T, y, np.ones(N, dtype=bool), Colour(), np.ones(1), alarm=1e-4)
    assert first.t == pytest.approx(T[150], abs=0.02)
    assert second.t == pytest.approx(T[350], abs=0.02)
    assert first.size[0] == pytest.approx(3.0, abs=0.4)
    assert second.size[0] == pytest.approx(-4.0, abs=0.4)


def test_a_ramp_is_not_a_step():
    rng = stream(3, 'ramp')
    y = noise(rng, Colour(), 1) + 8.0 * (T / T[-1])[:, None]
    assert steps(T, y, np.ones(N, dtype=bool), Colour(), np.ones(1), alarm=1e-4) == ()
    y[N // 2:] += 6.0
    one, = steps(T, y, np.ones(N, dtype=bool), Colour(), np.ones(1), T[:, None], alarm=1e-4)
    assert one.t == pytest.approx(T[N // 2], abs=0.02)


def test_too_short_a_series_has_no_step():
    few = np.zeros(N, dtype=bool)
    few[:9] = True
    assert step_scan(T, np.zeros((N, 1)), few, Colour(), np.ones(1)) is None


def test_what_took_a_few_samples_is_one_step():
    def part(t, size):
        return Step(t, t, t, np.array([size, 0.0]), np.full(2, 1e-5), 50.0, 1e-9)

    whole, later = joined((part(9.0, 1e-4), part(9.02, 7e-4), part(9.04, 2e-4), part(9.5, 3e-4)))
    assert whole.t == 9.02 and whole.size == pytest.approx([1e-3, 0.0])
    assert later.size[0] == 3e-4
