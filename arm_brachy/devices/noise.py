"""Gaussian sensor noise, white or first-order coloured."""

import numpy as np


class ColouredNoise:
    """Unit-variance Gaussian sequences with correlation exp(-|lag| / correlation_time).

    shape : of one draw;  correlation_time, period : s (0 = white);  rng : numpy Generator
    x[k+1] = a x[k] + sqrt(1 - a^2) w[k], a = exp(-period / correlation_time), started in its
    stationary distribution. Source: Gelb 1974, Applied Optimal Estimation,
    chapter on linear dynamic systems.
    """

    def __init__(self, shape, correlation_time, period, rng):
        self._rng = rng
        self._a = np.exp(-period / correlation_time) if correlation_time > 0.0 else 0.0
        self._state = rng.standard_normal(shape)

    def draw(self):
        """Return the next values, a new array of `shape`."""
        fresh = self._rng.standard_normal(self._state.shape)
        self._state = self._a * self._state + np.sqrt(1.0 - self._a**2) * fresh
        return self._state.copy()
