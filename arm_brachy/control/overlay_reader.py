"""The person who watches the image with the template's holes over it, and steers the needle.

Stands for a clinician, so that scenarios with and without overlay can be compared in simulation.
The picture has two marks: where the tip will be at the target's depth, by `needle_curvature`, and
where it is to be. At each look, if they are farther apart than a person sees, the base of the
needle is turned: the bevel then points from where a straight needle would end to where it should
end. Without the overlay nobody turns the needle.
The simulated person takes the marks as they were computed, not from the pixels of the picture.
"""

import numpy as np

_TURN = 0.1        # rad, below which a turn is not worth while
_LITTLE = 0.1e-3   # m that the rest of the way bends a needle by, below which no turn helps


class OverlayReader:
    """Looks every so often; `look` returns how the base shall be turned.

    params : SteeringParams
    """

    def __init__(self, params):
        """Has not looked yet."""
        self._params = params
        self._next = -np.inf

    def look(self, t, aim, curvature, depth, end, roll):
        """Return the roll [rad] that the base shall have, None = leave it.

        aim : (3,) [m] from the axis of the hole, where the tip is to be at a depth `end` [m]
        curvature : NeedleCurvature;  depth : [m] and roll : [rad] now
        """
        if t < self._next:
            return None
        self._next = t + self._params.look
        if np.linalg.norm(curvature.across(aim - curvature.ahead(end))) <= self._params.seen:
            return None
        if 0.5 * curvature.kappa * max(end - depth, 0.0) ** 2 < _LITTLE:
            return None
        one, other = (curvature.ahead(end, depth, side) for side in (0.0, np.pi))
        x, y = curvature.across(aim - 0.5 * (one + other))
        turn = (float(np.arctan2(y, x)) - roll + np.pi) % (2.0 * np.pi) - np.pi
        return None if abs(turn) < _TURN else roll + turn
