"""Least squares in coloured noise against the textbook formula with the full covariance."""

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.devices.noise import ColouredNoise
from arm_brachy.diagnosis.statistics.gls import regress
from arm_brachy.diagnosis.statistics.noise_process import Colour

N, PERIOD = 600, 0.01
T = np.arange(N) * PERIOD
COLUMNS = {'1': np.ones(N), 'ramp': T, 'wave': np.sin(2.0 * T)}
TRUE = np.array([1.0, -2.0, 3.0])
ALL = np.ones(N, dtype=bool)


def signal():
    return np.stack(list(COLUMNS.values()), axis=1) @ TRUE


def test_equals_generalised_least_squares():
    colour = Colour(0.5, 0.2)
    y = signal() + stream(1, 'gls').standard_normal(N)
    C = 0.5 * np.eye(N) + 0.5 * np.exp(-np.abs(T[:, None] - T) / 0.2)
    X = np.stack(list(COLUMNS.values()), axis=1)
    exact = np.linalg.solve(X.T @ np.linalg.solve(C, X), X.T @ np.linalg.solve(C, y))
    fit = regress(T, y[:, None], COLUMNS, ALL, colour, np.ones(1))
    spread = np.sqrt(np.diag(np.linalg.inv(X.T @ np.linalg.solve(C, X))))
    assert np.all(np.abs(fit.value[:, 0] - exact) < 0.05 * spread)
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(spread, rel=0.05)


@pytest.mark.parametrize('colour', [Colour(), Colour(0.6, 0.3)])
def test_standard_errors_are_honest(colour):
    rng, z = stream(1, f'honest {colour}'), []
    for _ in range(150):
        slow = ColouredNoise((1,), colour.time, PERIOD, rng)
        noise = np.sqrt(colour.share) * np.array([slow.draw() for _ in T])
        noise += np.sqrt(1.0 - colour.share) * rng.standard_normal((N, 1))
        valid = rng.random(N) > 0.1
        fit = regress(T, signal()[:, None] + noise, COLUMNS, valid, colour, np.ones(1))
        z.append((fit.value[:, 0] - TRUE) / fit.sd[:, 0])
    assert 0.75 < np.sqrt(np.mean(np.square(z))) < 1.1


def test_a_model_that_is_wrong_for_long_widens_the_errors():
    """A slow bump that no column has: errors grow beyond those of the noise."""
    rng = stream(1, 'wrong')
    t = np.arange(6000) * PERIOD
    columns = {'1': np.ones(len(t)), 'wave': np.sin(0.7 * t)}
    bump = 3.0 * np.sin(1.1 * t + 0.3)
    valid = np.ones(len(t), dtype=bool)
    noise = rng.standard_normal((len(t), 1))
    plain = regress(t, noise, columns, valid, Colour(), np.ones(1))
    wrong = regress(t, noise + bump[:, None], columns, valid, Colour(), np.ones(1))
    assert wrong.of('wave')[1] > 3.0 * plain.of('wave')[1]


def test_columns_that_cannot_be_told_apart_have_infinite_errors():
    columns = {**COLUMNS, 'again': 2.0 * T}
    fit = regress(T, signal()[:, None], columns, ALL, Colour(), np.ones(1))
    assert np.isinf(fit.of('ramp')[1]) and np.isinf(fit.of('again')[1])
    assert np.isfinite(fit.of('wave')[1])
    assert np.nanmax(np.abs(fit.residual)) < 1e-9


def test_rows_that_do_not_count_are_nan_in_the_residual():
    valid = ALL.copy()
    valid[100:200] = False
    y = np.where(valid, signal(), np.nan)[:, None]
    fit = regress(T, y, COLUMNS, valid, Colour(0.5, 0.2), np.ones(1))
    assert fit.value[:, 0] == pytest.approx(TRUE)
    assert np.array_equal(np.isnan(fit.residual[:, 0]), ~valid)
