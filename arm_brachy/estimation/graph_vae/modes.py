"""The linear baseline: proper orthogonal decomposition of the training states.

Test: estimation/graph_vae/test_training.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import svds

LEAST = 1e-6            # singular value over the largest: below it is rounding


@dataclass(frozen=True)
class Modes:
    """u = mean + z @ (spread[:, None] * shapes), z of unit variance over the training states.

    mean : (n, 3) [m];  shapes : (k, n, 3) orthonormal;  spread : (k,) [m]
    """

    mean: np.ndarray
    shapes: np.ndarray
    spread: np.ndarray

    def encode(self, u):
        """Coordinates (s, k) of displacements (s, n, 3) [m]: the best in least squares."""
        return (u - self.mean).reshape(len(u), -1) @ self._flat.T / self.spread

    def decode(self, z):
        """Displacements (s, n, 3) [m] of coordinates (s, k)."""
        return (z * self.spread @ self._flat).reshape(len(z), *self.mean.shape) + self.mean

    @property
    def _flat(self):
        return self.shapes.reshape(len(self.shapes), -1)


def modes_of(u, count):
    """Return the `count` Modes of displacements (s, n, 3) [m], or as many as they span."""
    mean = u.mean(axis=0, dtype=np.float64)
    flat = (u - mean).reshape(len(u), -1)
    count = min(count, min(flat.shape) - 1)
    # a first vector of ones would be the mean, which is gone
    _, values, shapes = svds(flat, count, v0=np.linspace(1.0, 2.0, min(flat.shape)))
    order = np.argsort(values)[::-1]
    order = order[values[order] > LEAST * values.max()]
    return Modes(mean, shapes[order].reshape(-1, *mean.shape), values[order] / np.sqrt(len(u)))


def error(u, other):
    """(s,) mean over nodes of the distance [m] between two fields (s, n, 3)."""
    return np.linalg.norm(np.asarray(u) - other, axis=2).mean(axis=1)
