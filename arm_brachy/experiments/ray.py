"""States of a laboratory's body along one direction of pad travel, and between them.

Test: experiments/gel_block/test_bodies.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

PLAIN = 'plain'     # the body of a laboratory with nothing that its scene does not say


@dataclass(frozen=True)
class Ray:
    """States of the marked points at shares of a ray, rest included.

    full : (p,) travel [m] at its end;  share : (k,) 0 to 1
    u : (k, points, 3) displacements of the markers, then of the targets [m]
    force : (k, p, 3) of the body on the pads [N], at the scene's modulus or the laboratory's own
    """

    full: np.ndarray
    share: np.ndarray
    u: np.ndarray
    force: np.ndarray

    def at(self, share, what):
        """Values (t, ..., 3) of 'u' or 'force' at shares (t,) of the ray."""
        return CubicSpline(self.share, getattr(self, what))(share)

    def changed(self, effect, plain):
        """The Ray with the difference of two others, of the same travel, added."""
        return Ray(self.full, self.share, self.u + effect.u - plain.u,
                   self.force + effect.force - plain.force)
