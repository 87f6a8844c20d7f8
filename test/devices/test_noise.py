"""Noise has the variance and the correlation it claims."""

import numpy as np
import pytest

from arm_brachy.devices.noise import ColouredNoise


@pytest.mark.parametrize('correlation_time', [0.0, 0.1])
def test_variance_and_correlation(correlation_time):
    """Against the closed form at four standard errors (Bartlett, for an AR(1) sequence)."""
    n, k, period = 4000, 20, 0.025
    noise = ColouredNoise((k,), correlation_time, period, np.random.default_rng(3))
    x = np.array([noise.draw() for _ in range(n)])
    a = np.exp(-period / correlation_time) if correlation_time else 0.0
    error = np.sqrt(2.0 / (n * k) * (1 + a**2) / (1 - a**2))
    assert abs(np.mean(x**2) - 1.0) < 4.0 * error
    assert abs(np.mean(x[1:] * x[:-1]) - a) < 4.0 * error
    assert abs(np.mean(x)) < 4.0 * np.sqrt((1 + a) / (1 - a) / (n * k))


def test_draws_are_not_views_of_the_state():
    noise = ColouredNoise((3,), 1.0, 0.1, np.random.default_rng(0))
    twin = ColouredNoise((3,), 1.0, 0.1, np.random.default_rng(0))
    noise.draw()[:] = 1e9
    twin.draw()
    np.testing.assert_array_equal(noise.draw(), twin.draw())
