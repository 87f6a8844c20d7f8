"""What the pads do in every recording, and where the block is meanwhile."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.experiments.gel_block.bodies import RAYS
from arm_brachy.experiments.gel_block.layout import MM, PADS

SLOW, FAST = 3 * MM, 12 * MM    # m/s, of the pad that goes farther
REST = 1.5                      # s, after every push
FIRST, LAST = 4.0, 1.5          # s, of rest before all and after all


@dataclass(frozen=True)
class Push:
    """Motors go out along a ray of bodies.RAYS, wait and come back.

    share : of the ray;  speed : [m/s] of the motor that goes farther;  hold : [s]
    """

    ray: str
    share: float
    speed: float
    hold: float

    @property
    def travel(self):
        """Of the motors while it waits, (p,) [m]."""
        return self.share * np.array(RAYS[self.ray])

    def knots(self, start):
        """Times [s] of start, arrival, departure and return, (4,)."""
        way = self.travel.max() / self.speed
        return start + np.cumsum([0.0, way, self.hold, way])


PUSHES = (Push('A', 1.0, SLOW, 2.0), Push('B', 1.0, SLOW, 2.0),
          Push('A', 0.7, FAST, 1.0), Push('B', 0.7, FAST, 1.0),
          Push('AB', 1.0, SLOW, 3.0), Push('AB', 0.7, FAST, 1.0),
          Push('A', 0.5, SLOW, 2.0), Push('B', 0.5, SLOW, 2.0))


def _timed(pushes):
    out, start = [], FIRST
    for push in pushes:
        out.append((push, push.knots(start)))
        start = out[-1][1][-1] + REST
    return tuple(out), start + LAST


TIMED, END = _timed(PUSHES)     # (Push, its knots) each, and the end of a recording [s]


def shares(t):
    """Share of its travel that each push has gone at times t (t,): (pushes, t), 0 to 1."""
    return np.array([np.interp(t, knots, (0.0, 1.0, 1.0, 0.0)) for _, knots in TIMED])


def motors(t):
    """Motor positions (t, p) [m] at times t (t,) [s]."""
    return shares(t).T @ np.array([push.travel for push in PUSHES])


def response(rays, t, what, gain):
    """What of the block at times t (t,) [s]: 'u' or 'force' of bodies.Ray, (t, ..., 3).

    rays : name -> bodies.Ray;  gain : (p,) pad travel over motor travel. The block has no
    inertia and no memory. Raises InputError if pads go where no ray goes.
    """
    at_rest = next(iter(rays.values())).at(np.zeros(1), what)
    out = np.repeat(at_rest, len(t), axis=0)
    for push, gone in zip(PUSHES, shares(t), strict=True):
        on = gone > 0.0
        ray, share = _along(rays, push.travel * np.array(gain))
        out[on] = ray.at(gone[on] * share, what)
    return out


def _along(rays, travel):
    """The Ray towards pad travel (p,) [m], and the share of it that this is."""
    for ray in rays.values():
        share = travel @ ray.full / (ray.full @ ray.full)
        if np.allclose(share * ray.full, travel, atol=1e-6 * MM) and share <= 1.0 + 1e-9:
            return ray, share
    told = ', '.join(f'{pad.name} {d / MM:g} mm' for pad, d in zip(PADS, travel, strict=True))
    raise InputError(f'no ray goes to {told}; must be one of {", ".join(rays)}; solve another')
