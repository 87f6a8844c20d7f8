"""The person who watches the image with the template's holes over it, and steers the needle.

Stands for a clinician, so that scenarios with and without overlay can be compared in simulation.
At each look the deviation e of the tip in the image from its planned path is read against the
grid, with its trend e' per length over the looks since the last turn. If the deviation expected
at the end, e + e' times what is left of the path, can be seen, the base of the needle is turned
so that the bevel steers against it; else it is turned back to the plan's side. Without the overlay
nothing says where the hole is in the image: no correction.
"""

from collections import deque

import numpy as np

_FEWEST = 3        # looks since the last turn that make a trend
_TURN = 0.1        # rad, below which a turn is not worth while


class OverlayReader:
    """Looks every so often; `look` returns how the base shall be turned.

    params : SteeringParams
    """

    def __init__(self, params):
        """Has not looked yet."""
        self._params = params
        self._tip, self._next, self._roll = None, -np.inf, None
        self._looks = deque()

    def see(self, t, p):
        """The tip is at p (3,) [m] in the image of time t [s]."""
        self._tip = t, np.array(p, dtype=float)

    def tip(self, t):
        """(3,) [m] where the images show the tip, None if that is older than a look."""
        return None if self._tip is None or self._tip[0] < t - self._params.look else self._tip[1]

    def look(self, t, on_path, plan, needle):
        """Return the roll [rad] that the base shall have, None = leave it.

        on_path : callable, point (3,) -> (level point of the path (3,), rest of the path [m])
        plan : NeedlePlan;  needle : NeedleCourse
        """
        tip = self.tip(t)
        if t < self._next or tip is None:
            return None
        self._next = t + self._params.look
        path, rest = on_path(tip)
        off, axis = tip - path, needle.axis
        self._looks.append((rest, off - axis * (axis @ off)))
        if len(self._looks) < _FEWEST:
            return None
        expected = self._expected(rest)
        if np.linalg.norm(expected) <= self._params.seen:
            return self._turned(plan.roll, plan.roll)
        x, y = needle.side, np.cross(axis, needle.side)
        return self._turned(float(np.arctan2(-expected @ y, -expected @ x)), plan.roll)

    def _expected(self, rest):
        """Deviation (3,) [m] at the end of the path, by the trend of the looks."""
        left, off = (np.array(column) for column in zip(*self._looks, strict=True))
        if np.ptp(left) < 1e-6:     # the needle stands still: no trend
            return off[-1]
        slope = np.polyfit(left, off, 1)[0]
        return off[-1] - slope * rest

    def _turned(self, roll, planned):
        now = planned if self._roll is None else self._roll
        if abs((roll - now + np.pi) % (2.0 * np.pi) - np.pi) < _TURN:
            return None
        self._roll = roll
        self._looks.clear()
        return roll
