"""What can be reached from here, the closest point if the goal cannot, and why, for a person."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.optimize import lsq_linear, nnls


class Limit(Enum):
    """What stands between the target and its goal."""

    NONE = 'reachable'
    CONE = 'outside the cone of the pads'
    STROKE = 'stroke exhausted'
    SPEED = 'not within the time given'


@dataclass(frozen=True)
class Reach:
    """Answer of `closest_reachable`.

    displacement : (m,) [m] nearest that can be had;  travel : (p,) [m] of the pads that gives it
    shortfall : distance from the goal [m];  limit : why;  pads : names that the limit concerns
    explanation : one line for a person
    """

    displacement: np.ndarray
    travel: np.ndarray
    shortfall: float
    limit: Limit
    pads: tuple
    explanation: str

    @property
    def feasible(self):
        """True if the goal itself can be reached."""
        return self.limit is Limit.NONE


def closest_reachable(J, goal, q, stroke, names, *, retraction=False, max_speed=None, time=None,
                      tolerance=1e-4):
    """Nearest displacement to `goal` that the pads can give from travel q, and what limits it.

    J : (m, p) rows of the controlled axes;  goal : (m,) displacement from here [m]
    q : (p,) present travel [m];  stroke : (p,) largest travel [m];  names : p pad names
    retraction : pads may also go back, down to 0 (bonded pads only)
    max_speed, time : (p,) or scalar [m/s] and [s]; given both, only what fits in `time` counts
    tolerance : shortfall [m] that still counts as reached
    Returns Reach. Limits are tried from the one no waiting cures: cone, stroke, speed.
    Linearised: trustworthy within some 5 mm; the manipulator asks again at every step.
    """
    J, goal = np.asarray(J, dtype=float), np.asarray(goal, dtype=float)
    low = -np.maximum(q, 0.0) if retraction else np.zeros(J.shape[1])
    high = np.maximum(np.asarray(stroke) - q, 0.0)
    if not retraction and nnls(J, goal)[1] > tolerance:
        travel = bounded_least_squares(J, goal, low, high)
        limit = Limit.CONE
    else:
        travel, limit = _within_bounds(J, goal, low, high, max_speed, time, tolerance)
    residual = goal - J @ travel
    short = float(np.linalg.norm(residual))
    pads = _concerned(J, residual, limit, names, retraction)
    return Reach(J @ travel, travel, short, limit, pads, _explain(limit, pads, residual))


def bounded_least_squares(J, goal, low, high):
    """Minimise |J q - goal| over low <= q <= high; pads without freedom keep their bound.

    J : (m, p);  goal : (m,);  low, high : (p,), low <= high.  Returns q (p,).
    """
    q = np.array(low, dtype=float)
    free = high - low > 1e-9  # a nanometre: bvls needs an interior, a spent pad has none
    if free.any():
        rest = goal - J[:, ~free] @ q[~free]
        q[free] = lsq_linear(J[:, free], rest, (low[free], high[free]), method='bvls').x
    return np.clip(q, low, high)  # bvls oversteps a bound by a rounding error


def _within_bounds(J, goal, low, high, max_speed, time, tolerance):
    """Return (travel, limit) for the stroke, then for what fits in the time given."""
    travel = bounded_least_squares(J, goal, low, high)
    if np.linalg.norm(goal - J @ travel) > tolerance:
        return travel, Limit.STROKE
    if max_speed is not None and time is not None:
        step = np.broadcast_to(np.asarray(max_speed, dtype=float) * time, low.shape)
        travel = bounded_least_squares(J, goal, np.maximum(low, -step), np.minimum(high, step))
        if np.linalg.norm(goal - J @ travel) > tolerance:
            return travel, Limit.SPEED
    return travel, Limit.NONE


def _concerned(J, residual, limit, names, retraction):
    """Names of the pads that would shorten the residual if their bound gave way; cone: all.

    At the bounded optimum only a pad at a bound still has a slope J' r (Karush-Kuhn-Tucker); a
    falling one is held by stroke or speed only if it may go back at all.
    """
    if limit is Limit.NONE:
        return ()
    if limit is Limit.CONE:
        return tuple(names)
    slope = J.T @ residual
    held = np.abs(slope) if retraction else slope
    return tuple(n for n, h in zip(names, held, strict=True) if h > 1e-3 * np.abs(slope).max())


def _explain(limit, pads, residual):
    short_mm = 1e3 * np.linalg.norm(residual)
    if limit is Limit.NONE:
        return 'reachable'
    toward = ', '.join(f'{r:+.2f}' for r in residual / np.linalg.norm(residual))
    listed = ', '.join(pads)
    why = {
        Limit.CONE: f'{listed} only push and none moves the target towards ({toward})',
        Limit.STROKE: f'stroke of {listed} is exhausted',
        Limit.SPEED: f'{listed} cannot travel that fast; allow more time',
    }[limit]
    return f'{why}; the closest reachable point is {short_mm:.2f} mm short'
