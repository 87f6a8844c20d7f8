"""Anderson acceleration (type II) of a fixed-point iteration, reproducible bit by bit.

Walker & Ni, SIAM J. Numer. Anal. 49(4), 2011; on ADMM: Zhang, Peng, Ouyang & Deng, ACM Trans.
Graph. 38(6), 2019.
"""

import numpy as np
from numba import njit, prange

CHUNK = 128            # columns of one partial sum, fixed so that sums do not depend on threads
REGULARISATION = 1e-12  # of the mean diagonal of the normal equations: their rounding


# Sums may be regrouped for the vector units: inside a fixed piece, the same way every time.
@njit(cache=True, fastmath={'reassoc'})
def _dot(weight, a, b):
    value = 0.0
    for e in range(weight.shape[0]):
        value += weight[e] * a[e] * b[e]
    return value


@njit(cache=True, parallel=True)
def _dots(changes, count, new, residual, weight, parts):
    """Weighted products of every stored change with change `new` and with the residual.

    changes : (depth, r, m);  residual : (r, m);  weight : (m,);  parts : (chunks, 2, depth)
    """
    rows, m = residual.shape
    for chunk in prange((m + CHUNK - 1) // CHUNK):
        lo, hi = chunk * CHUNK, min(m, (chunk + 1) * CHUNK)
        for j in range(count):
            a, b = 0.0, 0.0
            for i in range(rows):
                change = changes[j, i, lo:hi]
                a += _dot(weight[lo:hi], change, changes[new, i, lo:hi])
                b += _dot(weight[lo:hi], change, residual[i, lo:hi])
            parts[chunk, 0, j], parts[chunk, 1, j] = a, b


@njit(cache=True, parallel=True)
def _store(image, residual, last_image, last_residual, changes, image_changes, fresh):
    """Keep the image and the residual; write their changes unless they are the first."""
    rows, m = image.shape
    for chunk in prange((m + CHUNK - 1) // CHUNK):
        for i in range(rows):
            for e in range(chunk * CHUNK, min(m, (chunk + 1) * CHUNK)):
                if not fresh:
                    changes[i, e] = residual[i, e] - last_residual[i, e]
                    image_changes[i, e] = image[i, e] - last_image[i, e]
                last_residual[i, e], last_image[i, e] = residual[i, e], image[i, e]


@njit(cache=True, parallel=True)
def _combine(image, image_changes, gamma, out):
    """out = image - sum_j gamma_j image_changes_j."""
    rows, m = image.shape
    for chunk in prange((m + CHUNK - 1) // CHUNK):
        lo, hi = chunk * CHUNK, min(m, (chunk + 1) * CHUNK)
        for i in range(rows):
            target, source = out[i, lo:hi], image[i, lo:hi]
            for e in range(hi - lo):
                target[e] = source[e]
            for j in range(gamma.shape[0]):
                change, factor = image_changes[j, i, lo:hi], gamma[j]
                for e in range(hi - lo):
                    target[e] -= factor * change[e]


class Anderson:
    """Extrapolates s <- g(s) from the last few images g(s) and residuals g(s) - s.

    shape : (r, m) of the unknown;  depth : changes remembered, 0 = plain iteration
    weight : (m,) > 0, the norm of the least-squares fit is sum_ie weight_e r_ie^2
    Not to be shared between threads. Proposes only; whether to accept is the caller's business.
    """

    def __init__(self, shape, depth):
        self.depth = depth
        self._changes, self._image_changes = (np.zeros((depth, *shape)) for _ in range(2))
        self._last, self._last_image = np.empty(shape), np.empty(shape)
        self._parts = np.zeros(((shape[1] + CHUNK - 1) // CHUNK, 2, depth))
        self._gram = np.zeros((depth, depth))
        self.restart(np.ones(shape[1]))

    def restart(self, weight=None):
        """Forget everything; from now on measure with `weight` (m,), None = the one so far."""
        self._weight = self._weight if weight is None else weight
        self._count, self._slot, self._fresh = 0, 0, True

    def propose(self, image, residual, out):
        """Write the next s (r, m) into `out`; returns False if it is the image itself.

        image, residual : (r, m) g(s) and g(s) - s of the current s
        """
        out[:] = image
        if self.depth == 0:
            return False
        new = self._slot
        _store(image, residual, self._last_image, self._last, self._changes[new],
               self._image_changes[new], self._fresh)
        if self._fresh:
            self._fresh = False
            return False
        self._slot = (new + 1) % self.depth
        self._count = count = min(self._count + 1, self.depth)
        _dots(self._changes, count, new, residual, self._weight, self._parts)
        products = self._parts[:, :, :count].sum(axis=0)
        self._gram[new, :count] = self._gram[:count, new] = products[0]
        gram = self._gram[:count, :count] + (
            REGULARISATION * np.trace(self._gram[:count, :count]) / count * np.eye(count))
        if not np.trace(gram) > 0.0:  # nothing has changed: nothing to extrapolate
            return False
        _combine(image, self._image_changes, np.linalg.solve(gram, products[1]), out)
        return True
