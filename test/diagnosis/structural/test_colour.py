"""The noise model against its own covariance matrix and against noise drawn from it."""

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.devices.noise import ColouredNoise
from arm_brachy.diagnosis.statistics.noise_process import (
    Colour,
    Stretch,
    fit_colour,
    lags_for,
    pieces,
    residual_colour,
    variogram,
)

PERIOD = 0.01
COLOURS = (Colour(), Colour(0.3, 0.2), Colour(1.0, 0.05))


def covariance(colour, n):
    """(n, n) of n samples, written down entry by entry."""
    t = np.arange(n) * PERIOD
    return np.eye(n) * (1.0 - colour.share) + (
        colour.share * np.exp(-np.abs(t[:, None] - t) / colour.time) if colour.share else 0.0)


def draw(colour, n, k, name):
    rng = stream(7, name)
    slow = ColouredNoise((k,), colour.time, PERIOD, rng)
    return np.array([np.sqrt(colour.share) * slow.draw()
                     + np.sqrt(1.0 - colour.share) * rng.standard_normal(k) for _ in range(n)])


@pytest.mark.parametrize('colour', COLOURS)
@pytest.mark.parametrize('n', [1, 2, 17, 300])
def test_variance_of_a_mean_is_that_of_the_matrix(colour, n):
    assert colour.mean_variance(n, PERIOD) == pytest.approx(covariance(colour, n).mean())


@pytest.mark.parametrize('colour', COLOURS)
def test_whitening_gives_unit_innovations(colour):
    """With W the filter as a matrix, W C W' is the unit matrix once the start is forgotten."""
    n, late = 400, 200
    W = colour.whiten(PERIOD, np.eye(n))
    after = (W @ covariance(colour, n) @ W.T)[late:, late:]
    assert np.allclose(after, np.eye(n - late), atol=1e-8)


@pytest.mark.parametrize('colour', [Colour(0.4, 0.3), Colour(1.0, 0.1)])
def test_colour_is_found_again(colour):
    n, k = 4000, 30
    lags, stretches = lags_for(600), [Stretch(0, n)]
    gamma, pairs = variogram(draw(colour, n, k, 'again'), np.ones((n, k), dtype=bool), lags,
                             stretches)
    found, variance = fit_colour(gamma.mean(axis=1), pairs.sum(axis=1), lags, PERIOD, stretches)
    assert variance == pytest.approx(1.0, rel=0.05)
    assert found.share == pytest.approx(colour.share, abs=0.05)
    assert found.time == pytest.approx(colour.time, rel=0.25)


def test_white_noise_is_called_white():
    n, k = 300, 20
    lags = lags_for(150)
    gamma, pairs = variogram(draw(Colour(), n, k, 'white'), np.ones((n, k), dtype=bool), lags,
                             [Stretch(0, n)])
    found, variance = fit_colour(gamma.mean(axis=1), pairs.sum(axis=1), lags, PERIOD)
    assert found.share < 0.06 and variance == pytest.approx(1.0, rel=0.1)


def test_creep_in_short_stretches_is_not_noise():
    """Stretches of a second that relax by twenty sigma: as without, over a fifth of a second.

    How slow noise is beyond, a parabola that was taken out hardly tells.
    """
    colour, n, k = Colour(0.4, 0.3), 100, 30
    starts = range(0, 40 * n, n)
    creep = 20.0 * np.exp(-np.arange(n) * PERIOD / 1.5)[:, None]
    x = np.concatenate([draw(colour, n, k, f'creep {i}') + creep for i in starts])
    stretches = [p for i in starts for p in pieces(i, i + n, False)]
    lags = lags_for(60)
    gamma, pairs = variogram(x, np.ones(x.shape, dtype=bool), lags, stretches)
    found, variance = fit_colour(gamma.mean(axis=1), pairs.sum(axis=1), lags, PERIOD, stretches)
    h = lags[lags <= 20] * PERIOD
    expected = 1.0 - colour.correlation(h)
    assert np.allclose(variance * (1.0 - found.correlation(h)), expected, rtol=0.06)


def test_a_step_does_not_count_as_noise():
    n = 3000
    x = draw(Colour(), n, 1, 'step')
    x[n // 2:] += 20.0
    t, valid = np.arange(n) * PERIOD, np.ones(n, dtype=bool)
    colour, sd = residual_colour(t, x - x.mean(), valid, Colour(), 1.0)
    assert sd[0] < 1.3 and colour.share < 0.35


def test_a_series_that_was_seen_for_a_moment_has_noise_as_well():
    """Of 20 s two: no two samples are as far apart as the longest lag that is asked for."""
    n = 1000
    x = 3.0 * draw(Colour(), n, 2, 'moment')
    t, valid = np.arange(n) * PERIOD, np.arange(n) < 2.0 / PERIOD
    _, sd = residual_colour(t, np.where(valid[:, None], x, np.nan), valid, Colour(), 1.0)
    assert sd == pytest.approx([3.0, 3.0], rel=0.3)


def test_gaps_leave_the_variogram_unbiased():
    n, k = 5000, 10
    x, seen = draw(Colour(0.4, 0.3), n, k, 'gaps'), stream(7, 'holes').random((n, k)) > 0.3
    lags = lags_for(300)
    full, _ = variogram(x, np.ones((n, k), dtype=bool), lags, [Stretch(0, n)])
    holed, pairs = variogram(np.where(seen, x, np.nan), seen, lags, [Stretch(0, n)])
    assert np.allclose(holed.mean(axis=1), full.mean(axis=1), rtol=0.06)
    assert np.all(pairs < 0.6 * n)
