"""What corrections teach about a tangent that has changed since it was factorised (L-BFGS)."""

import numpy as np
from numba import njit

# Pairs whose curvature is this far below their lengths are rounding, or no convex potential.
FLATTEST = 1e-12


@njit(cache=True)
def dot(a, b):
    """Inner product of vectors (n,), four sums at a time and always in the same order.

    That of BLAS depends, in the last bit, on its threads and on where the vectors lie in memory.
    """
    sums = np.zeros(4)
    whole = len(a) - len(a) % 4
    for i in range(0, whole, 4):
        sums[0] += a[i] * b[i]
        sums[1] += a[i + 1] * b[i + 1]
        sums[2] += a[i + 2] * b[i + 2]
        sums[3] += a[i + 3] * b[i + 3]
    for i in range(whole, len(a)):
        sums[0] += a[i] * b[i]
    return sums[0] + sums[1] + sums[2] + sums[3]


class Secants:
    """Inverse of a symmetric positive definite matrix, of which an older relative is factorised.

    The pairs (step, change of gradient) seen last correct the older inverse by as many BFGS
    updates, in the two-loop form. Positive definite if the older inverse is.
    Source: Nocedal & Wright 2006, Numerical Optimization, algorithm 7.4; started from a factor as
    in Matthies & Strang 1979, Int J Numer Methods Eng 14:1613.
    depth : pairs kept
    """

    def __init__(self, depth=20):
        self.depth = depth
        self._pairs = []

    def clear(self):
        """Forget all pairs: the factor is new."""
        self._pairs.clear()

    def learn(self, step, change):
        """Take in a step (n,) and the change of gradient (n,) along it; flat pairs are ignored."""
        curvature = dot(step, change)
        if curvature > FLATTEST * np.sqrt(dot(step, step) * dot(change, change)):
            self._pairs.append((step, change, 1.0 / curvature))
            del self._pairs[:-self.depth]

    def solve(self, factor, gradient):
        """Return the step (n,) that gradient (n,) calls for; factor : as `Pardiso.solve`."""
        left, shares = gradient.copy(), []
        for step, change, weight in reversed(self._pairs):
            share = weight * dot(step, left)
            left -= share * change
            shares.append(share)
        out = factor.solve(left)
        for (step, change, weight), share in zip(self._pairs, reversed(shares), strict=True):
            out += (share - weight * dot(change, out)) * step
        return out
