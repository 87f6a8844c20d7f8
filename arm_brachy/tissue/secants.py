"""What corrections teach about a tangent that has changed since it was factorised (L-BFGS)."""

import numpy as np

# Pairs whose curvature is this far below their lengths are rounding, or no convex potential.
FLATTEST = 1e-12


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
        curvature = step @ change
        if curvature > FLATTEST * np.sqrt((step @ step) * (change @ change)):
            self._pairs.append((step, change, 1.0 / curvature))
            del self._pairs[:-self.depth]

    def solve(self, factor, gradient):
        """Return the step (n,) that gradient (n,) calls for; factor : as `Pardiso.solve`."""
        left, shares = gradient.copy(), []
        for step, change, weight in reversed(self._pairs):
            share = weight * (step @ left)
            left -= share * change
            shares.append(share)
        out = factor.solve(left)
        for (step, change, weight), share in zip(self._pairs, reversed(shares), strict=True):
            out += (share - weight * (change @ out)) * step
        return out
