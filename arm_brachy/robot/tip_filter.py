"""Position and velocity of the needle's tip from samples: a g-h filter, critically damped.

    x <- x + dt v;  r = sample - x;  x <- x + g r;  v <- v + h r / dt,  g = 1 - m^2, h = (1 - m)^2
without lag for uniform motion. Source: Brookner 1998, Tracking and Kalman Filtering Made Easy,
sec. 1.2 (fading memory of first order).
"""

import numpy as np

_LONGEST = 0.25      # s between samples, beyond which the filter starts anew
_SHORTEST = 2e-3     # s, below which a second one says nothing of the velocity


class TipFilter:
    """The tip as it can be told ahead; samples in, predictions out. World frame, SI."""

    def __init__(self, memory):
        """memory : m, 0 = the last two samples alone, towards 1 = many."""
        self._g, self._h = 1.0 - memory**2, (1.0 - memory)**2
        self.t, self.along = None, None
        self._p, self._v = np.zeros(3), np.zeros(3)

    def hear(self, t, R, p):
        """Take a sample: pose R (3, 3), z along the needle, and position p (3,) at time t [s]."""
        if self.t is not None and 0.0 <= t - self.t < _SHORTEST:
            return
        if self.t is None or not 0.0 < t - self.t <= _LONGEST:
            if self.t is None or t > self.t:
                self._p, self._v = np.array(p, dtype=float), np.zeros(3)
        else:
            dt = t - self.t
            left = p - (self._p + dt * self._v)
            self._v = self._v + self._h / dt * left
            self._p = p - (1.0 - self._g) * left
        if self.t is None or t > self.t:
            self.t, self.along = t, np.array(R)[:, 2]

    def at(self, t):
        """Return (p (3,) [m], v (3,) [m/s]) told ahead to t [s], first order."""
        return self._p + (t - self.t) * self._v, self._v
