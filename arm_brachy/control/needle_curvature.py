"""How strongly a needle bends, from the images of its tip, and where it will be further on.

A bevel tip bends by kappa to the side that the bevel has, so that across the axis of its hole, for
small slopes,

    p(s) = kappa D(s) + c + m(t),    D(s) = integral over u from e to s of (s - u) b(u) du

e is the depth of the skin, up to which it goes straight. b (2,) is the side of the bevel at depth
u, which the turns of the base tell, and c what the tissue has bent the shaft off its path
meanwhile. m is what comes and goes, as a breath does, and what images that follow each other are
off by together: an Ornstein-Uhlenbeck process. kappa and c are the mean of a normal distribution
given all images (Kalman filter).
Valid for slopes up to 0.3 rad, where s^2 / 2 R is 0.8 % more than an arc's deflection.
"""

import numpy as np

SPREAD = 0.85       # [1/m] of kappa about the nominal one, sd: 1.5 to 5 are published
ASIDE = 0.7e-3      # [m] of c, sd: half of what a probe of 3 N bends 18 G by
SHARED = 0.3e-3     # [m] of m, sd: what tips in images are off by (docs/results/procedures.md)
LASTS = 1.0         # [s] in which m is another: a quarter of a breath
SEEN = 0.2e-3       # [m] of a tip in an image by itself, sd: two pixels
DOUBTED = 5.0       # sds from what is foretold, beyond which a tip is not taken for the needle's
AGREED = 5          # such tips one after another, after which the next is: it was foretold wrongly


class NeedleCurvature:
    """Tell it `turned` and `seen`; ask it for `ahead`.

    hole, axis, side : (3,) [m] and unit: where the needle leaves the template, along it, and to
        which roll 0 bends it;  kappa : [1/m] nominal;  roll : [rad] at the hole
    skin : [m] depth of the skin
    Test: control/test_needle_curvature.py
    """

    def __init__(self, hole, axis, side, kappa, roll, skin=0.0):
        self._hole, self._axis = np.asarray(hole, dtype=float), np.asarray(axis, dtype=float)
        self._across = np.array([side, np.cross(axis, side)])
        self._turns = [(skin, roll)]
        self._mean = np.array([kappa, 0.0, 0.0, 0.0, 0.0])
        self._covariance = np.diag([SPREAD, ASIDE, ASIDE, SHARED, SHARED]) ** 2
        self._t, self._doubted = None, 0

    @property
    def kappa(self):
        """[1/m] as believed now."""
        return float(self._mean[0])

    @property
    def offset(self):
        """(3,) [m] across the axis: what the tissue has bent the shaft off its path by, c."""
        return self._mean[1:3] @ self._across

    def turned(self, depth, roll):
        """The base was turned to `roll` [rad] at a depth [m]."""
        self._turns.append((max(depth, self._turns[0][0]), roll))

    def seen(self, t, depth, tip):
        """The tip is at (3,) [m] in an image at t [s] while the needle is at a depth [m].

        One that is far from where it is foretold changes nothing, unless several are.
        """
        self._forget(0.0 if self._t is None else t - self._t)
        self._t = t
        H = np.column_stack([self._reach(depth), np.eye(2), np.eye(2)])
        off = self._across @ (np.asarray(tip, dtype=float) - self._hole)
        S = H @ self._covariance @ H.T + SEEN**2 * np.eye(2)
        innovation = off - H @ self._mean
        far = innovation @ np.linalg.solve(S, innovation) > DOUBTED**2
        self._doubted = self._doubted + 1 if far else 0
        if 0 < self._doubted <= AGREED:
            return
        self._doubted = 0
        gain = np.linalg.solve(S, H @ self._covariance).T
        self._mean = self._mean + gain @ innovation
        self._covariance = self._covariance - gain @ H @ self._covariance

    def _forget(self, dt):
        """Of m, over dt [s]."""
        kept = np.exp(-dt / LASTS)
        scale = np.array([1.0, 1.0, 1.0, kept, kept])
        self._mean = scale * self._mean
        self._covariance = np.outer(scale, scale) * self._covariance + np.diag(
            [0.0, 0.0, 0.0, 1.0, 1.0]) * SHARED**2 * (1.0 - kept**2)

    def ahead(self, depth, now=None, roll=None):
        """Return (3,) [m] how far from the axis of its hole the tip will be at a depth [m].

        now, roll : if its base is turned to `roll` [rad] at a depth `now` [m]; None = it is not
        """
        more = [] if now is None else [(now, roll)]
        return (self._mean[0] * self._reach(depth, more) + self._mean[1:3]) @ self._across

    def across(self, vector):
        """Parts (2,) of a vector (3,) to the side of roll 0, and of a quarter turn."""
        return self._across @ vector

    def _reach(self, depth, more=()):
        """D (2,) [m^2] with `more` turns (depth, roll) at the end."""
        turns, out = [*self._turns, *more], np.zeros(2)
        ends = [*(at for at, _ in turns[1:]), np.inf]
        for (start, roll), end in zip(turns, ends, strict=True):
            if start < depth:
                weight = 0.5 * ((depth - start) ** 2 - max(depth - end, 0.0) ** 2)
                out += weight * np.array([np.cos(roll), np.sin(roll)])
        return out
