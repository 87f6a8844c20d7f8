"""Noise with a memory longer than any rest, found between rests; what is none is not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from arm_brachy.core.random import stream as draws
from arm_brachy.diagnosis.signals import rest_noise
from arm_brachy.diagnosis.signals.rest_noise import over_rests
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL, TISSUE, Stream
from arm_brachy.diagnosis.statistics.noise_process import Colour

PERIOD, SD, SHARE, TIME = 0.01, 0.03, 0.36, 1.2
RESTS = tuple((1.5 * i, 1.5 * i + 0.4) for i in range(40))     # 1.1 s of pushes between them
FEW = tuple((8.0 * i, 8.0 * i + 2.5) for i in range(12))


def noise_of(colour, n, rng):
    a = np.exp(-PERIOD / colour.time)
    kicks = rng.standard_normal((n, 12))
    kicks[1:] *= np.sqrt(1.0 - a**2)
    slow = lfilter([1.0], [1.0, -a], kicks, axis=0)
    return SD * (np.sqrt(colour.share) * slow
                 + np.sqrt(1.0 - colour.share) * rng.standard_normal((n, 12)))


def recorded(rests, noise):
    """Four pads' forces, pushed but in the rests."""
    t = PERIOD * np.arange(len(noise))
    pushed = np.all([(t < a) | (t >= b) for a, b in rests], axis=0)
    values = (noise + pushed[:, None]).reshape(-1, 4, 3)
    return Stream(FORCE, t, tuple('abcd'), values, np.ones(values.shape[:2], dtype=bool),
                  tuple('abcd'), np.zeros((4, 3)))


@pytest.fixture
def noise():
    return noise_of(Colour(SHARE, TIME), 6000, draws(3, 'rests'))


def test_memory_longer_than_a_rest(noise):
    colour, variance = over_rests(recorded(RESTS, noise), RESTS)
    assert colour.share == pytest.approx(SHARE, abs=0.08)
    assert colour.time == pytest.approx(TIME, rel=0.4)
    assert variance * (1.0 - colour.share) == pytest.approx(1.0, abs=0.05)  # the shortest is white


@pytest.mark.parametrize('seed', range(4))
def test_a_little_noise_that_remembers_for_seconds(seed):
    """Twelve rests of 2.5 s hardly show a memory of 5 s; their means are three times as apart."""
    faint = noise_of(Colour(0.12, 5.0), 9200, draws(seed, 'rests'))
    colour, _ = over_rests(recorded(FEW, faint), FEW)
    assert colour.share == pytest.approx(0.12, abs=0.04)
    assert 3.0 < colour.time < 9.0


def test_the_cost_is_that_of_the_joint_density_of_what_no_constant_changes():
    """Of two series of unequal variance with gaps, by contrasts of their samples."""
    rng, t = draws(5, 'rests'), PERIOD * np.array([0, 1, 2, 5, 60, 61, 64])
    y, valid = rng.standard_normal((7, 2)) * [1.0, 3.0], np.ones((7, 2), dtype=bool)
    valid[2, 0] = False

    def density(share, time, c, constants):
        seen = valid[:, c]
        apart = np.abs(t[seen][:, None] - t[seen])
        same = constants[seen][:, None] == constants[seen]
        C = np.where(same, share * np.exp(-apart / time), 0.0) + (1.0 - share) * np.eye(seen.sum())
        X = (constants[seen][:, None] == np.unique(constants[seen])).astype(float)
        null = np.linalg.svd(X.T)[2][X.shape[1]:]
        z, free = null @ y[seen, c], len(null)
        variance = z @ np.linalg.solve(null @ C @ null.T, z) / free
        return -multivariate_normal.logpdf(z, cov=variance * null @ C @ null.T)

    for constants in (np.zeros(7, dtype=int), np.array([0, 0, 0, 0, 1, 1, 1])):
        found, other = (rest_noise._costs(t, y, valid, constants, *colour)
                        for colour in ((0.4, 0.03), (0.7, 0.2)))
        for c in range(2):
            assert found[c] - other[c] == pytest.approx(
                density(0.4, 0.03, c, constants) - density(0.7, 0.2, c, constants), abs=1e-9)


@pytest.mark.parametrize('colour', [Colour(), Colour(0.2, 1.0), Colour(0.4, 8.0)])
def test_squared_correlations_of_what_has_nothing_in_common(colour):
    """Means over rests of noise: the slower it is the fewer of them are independent."""
    n = 9200
    stream = recorded(FEW, np.zeros((n, 12)))
    spans = [slice(*np.searchsorted(stream.t, span)) for span in FEW]
    rng, squares = draws(2, 'rests'), []
    for _ in range(60):
        y = noise_of(colour, n, rng) if colour.share else rng.standard_normal((n, 12))
        means = np.array([y[one].mean(axis=0) for one in spans])
        unit = means - means.mean(axis=0)
        unit = unit / np.linalg.norm(unit, axis=0)
        squares.append(((unit.T @ unit)**2)[np.triu_indices(12, 1)].mean())
    count = rest_noise._independent(colour, stream, spans)
    assert count * np.mean(squares) == pytest.approx(1.0, abs=0.12)
    assert count == pytest.approx(11.0) if not colour.share else count < 11.0


def test_one_pad_under_which_the_tissue_recovers_is_no_noise(noise):
    noise[:, :3] += 0.2 * np.sin(0.5 * PERIOD * np.arange(len(noise)))[:, None]
    assert over_rests(recorded(RESTS, noise), RESTS)[0].share == pytest.approx(SHARE, abs=0.08)


def test_a_drift_of_all_channels_is_no_noise(noise):
    noise += 0.02 * PERIOD * np.arange(len(noise))[:, None]
    assert over_rests(recorded(RESTS, noise), RESTS) is None


def test_a_past_that_channels_share_is_no_noise(noise):
    """Pushes leave something that is forgotten in 3 s, more of it under one pad than another."""
    rng, n = draws(6, 'rests'), len(noise)
    kicks = np.where(np.arange(n) % 150 == 40, rng.standard_normal(n), 0.0)
    past = lfilter([1.0], [1.0, -np.exp(-PERIOD / 3.0)], kicks)
    white = SD * rng.standard_normal((n, 12))
    assert over_rests(recorded(RESTS, white + SD * past[:, None] * rng.uniform(0.5, 2.0, 12)),
                      RESTS) is None


def test_what_differs_between_rests_has_to_hold_within_them(noise):
    """Every rest has an offset of its own, in every channel another, and white noise."""
    rng, n = draws(7, 'rests'), len(noise)
    offset = rng.standard_normal((n // 150 + 1, 12)).repeat(150, axis=0)[:n]
    apart = recorded(RESTS, SD * rng.standard_normal((n, 12)) + 2.0 * SD * offset)
    assert over_rests(apart, RESTS) is None


def test_white_noise_stays_white(noise):
    white = draws(4, 'white').standard_normal(noise.shape)
    found = over_rests(recorded(RESTS, white), RESTS)
    assert found is None or found[0].share < 0.05


def along_one_axis(noise):
    """Three load cells of one axis each."""
    whole = recorded(FEW, noise)
    return replace(whole, names=tuple('abc'), values=whole.values[:, :3, :1], bodies=tuple('abc'),
                   valid=whole.valid[:, :3], rest=np.zeros((3, 1)))


@pytest.mark.parametrize('seed', range(4))
def test_of_few_cells_a_faint_memory_is_noise(seed):
    """No three cells tell noise of 8 s from what the tissue remembers; it may be either."""
    faint = noise_of(Colour(0.06, 8.0), 9200, draws(seed, 'cells'))
    colour, _ = over_rests(along_one_axis(faint), FEW)
    assert 0.02 < colour.share < 0.15
    assert 3.0 < colour.time <= rest_noise.LONGEST_SLOW


def test_of_few_cells_a_fifth_that_lasts_for_seconds_is_noise():
    """Estimates scatter: of twelve recordings all but one."""
    found = [over_rests(along_one_axis(noise_of(Colour(0.2, 5.0), 9200, draws(seed, 'fifth'))),
                        FEW) for seed in range(12)]
    assert sum(one is not None for one in found) >= 11
    shares = [one[0].share for one in found if one is not None]
    assert np.median(shares) == pytest.approx(0.2, abs=0.06)


def test_of_few_cells_a_drift_and_a_past_that_are_loud_are_no_noise():
    rng = draws(8, 'cells')
    white, t = SD * rng.standard_normal((9200, 12)), PERIOD * np.arange(9200)[:, None]
    drift = np.where(np.arange(12) == 0, 0.01, 0.0) * t
    found = over_rests(along_one_axis(white + drift), FEW)
    assert found is None or found[0].share < 0.05
    since = np.mod(t, 8.0)      # a push has ended when a rest begins
    assert over_rests(along_one_axis(white + 3.0 * SD * np.exp(-since / 4.0)), FEW) is None


def test_of_hours_of_rest_every_rest_counts_with_its_beginning():
    t = PERIOD * np.arange(300_000)
    rests = ((0.0, 500.0), (1000.0, 1002.0), (1500.0, 2500.0))
    kept = rest_noise._kept(t, rests)
    assert rest_noise.MOST_SAMPLES <= len(kept) <= rest_noise.MOST_SAMPLES + len(rests)
    for start, end in rests:
        inside = t[kept][(t[kept] >= start) & (t[kept] < end)]
        assert inside[0] == pytest.approx(start) and np.allclose(np.diff(inside), PERIOD)


def wandering(seed, loud=1.0):
    """Two tools of an EM tracker whose zero drifts by a third of the noise, loud times."""
    rng = draws(seed, 'wandering')
    n = 6500
    white = SD * rng.standard_normal((n, 6))
    drift = SD * loud * rng.standard_normal(6) * np.linspace(-0.6, 0.6, n)[:, None]
    values = (white + drift).reshape(n, 2, 3)
    t = PERIOD * np.arange(n)
    return Stream(EM, t, ('a', 'b'), values, np.ones((n, 2), dtype=bool), (TISSUE,) * 2,
                  np.zeros((2, 3)))


def watching(seed, moved):
    """Five markers on the same body, which drifts by `moved` [m] at most."""
    rng = draws(seed, 'watching')
    t = PERIOD * np.arange(6500)
    values = 0.3 * SD * rng.standard_normal((len(t), 5, 3)) + moved * np.linspace(
        0.0, 1.0, len(t))[:, None, None]
    return Stream(OPTICAL, t, tuple('abcde'), values, np.ones((len(t), 5), dtype=bool),
                  (TISSUE,) * 5, np.zeros((5, 3)))


EIGHT = tuple((8.0 * i, 8.0 * i + 2.5) for i in range(8))


@pytest.mark.parametrize('seed', range(4))
def test_a_faint_drift_is_the_trackers_where_another_sees_the_body_come_back(seed):
    em = wandering(seed)
    assert over_rests(em, EIGHT) is None
    colour, _ = over_rests(em, EIGHT, watching(seed, 0.0))
    assert colour.time > rest_noise.LONGEST_SLOW and 0.02 < colour.share <= rest_noise.FAINT


@pytest.mark.parametrize('seed', range(4))
def test_a_drift_that_both_see_or_that_is_loud_is_no_noise(seed):
    assert over_rests(wandering(seed), EIGHT, watching(seed, 0.7 * SD)) is None
    assert over_rests(wandering(seed, 10.0), EIGHT, watching(seed, 0.0)) is None


def test_markers_that_are_louder_than_the_drift_are_no_less_a_witness():
    """What they differ by from rest to rest is their own noise."""
    noisy = watching(0, 0.0)
    noisy = replace(noisy, values=20.0 * noisy.values)
    assert over_rests(wandering(0), EIGHT, noisy) is not None


def test_a_witness_that_saw_too_little_of_the_rests_is_none():
    """A frame in two seconds: half of most rests has no sample."""
    slow = watching(0, 0.0)
    slow = replace(slow, t=slow.t[::220], values=slow.values[::220], valid=slow.valid[::220])
    assert over_rests(wandering(0), EIGHT, slow) is None
