"""What the pads do in every recording: ten pushes, 98 s, with rounded corners."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.experiments.half_cylinder.layout import MM

# Travel of the pads left, right and top [m] at the end of a ray.
RAYS = {name: tuple(MM * np.array(travel, dtype=float)) for name, travel in {
    'left': (6, 0, 0), 'right': (0, 6, 0), 'top': (0, 0, 5), 'left_right': (5, 5, 0),
    'left_top': (5, 0, 4), 'right_top': (0, 5, 4), 'all': (4, 4, 3.5)}.items()}
FIRST = 5.0         # s, of rest before all
ROUNDED = 0.2       # s, over which the speed of a pad changes
STEP = 0.8 * MM     # at most, of a pad between instants at which memory is solved, if 9 will do
SOON = np.array((0.25, 0.7, 1.4, 2.2))      # s after a corner: instants while the pads wait


@dataclass(frozen=True)
class Push:
    """The pads go out along a ray, wait, come back and rest.

    share : of the ray;  speed : [m/s] of the pad that goes farthest;  hold, rest : [s]
    """

    ray: str
    share: float
    speed: float
    hold: float
    rest: float

    @property
    def travel(self):
        """Of the pads while they wait, (p,) [m]."""
        return self.share * np.array(RAYS[self.ray])

    @property
    def way(self):
        """Time [s] to go there."""
        return self.travel.max() / self.speed

    def gone(self, t):
        """Share (t,) of its travel at times t (t,) [s] after its start, 0 to 1."""
        out = _ramp(t, self.way) - _ramp(t - self.way - self.hold, self.way)
        return np.maximum(out, 0.0)


def _ramp(t, way):
    """From 0 at t = 0 to 1 at t = way, as the mean over ROUNDED of a straight ramp."""
    def area(t):
        return np.where(t < way, np.maximum(t, 0.0) ** 2 / (2.0 * way), t - way / 2.0)
    return (area(t + ROUNDED / 2.0) - area(t - ROUNDED / 2.0)) / ROUNDED


PUSHES = tuple(Push(ray, share, speed * MM, hold, rest) for ray, share, speed, hold, rest in (
    ('left', 1, 4, 4, 3), ('right', 1, 2, 3, 3), ('top', 1, 8, 4, 3), ('left_right', 1, 4, 3, 3),
    ('left_top', 1, 3, 3, 2), ('right_top', 1, 8, 4, 3), ('all', 1, 4, 3, 3),
    ('left', 1 / 2, 10, 5, 3), ('right', 2 / 3, 8, 3, 4), ('top', 1, 1.5, 2, 4)))
STARTS = FIRST + np.cumsum([0.0, *(2 * p.way + p.hold + p.rest for p in PUSHES)])
END = float(STARTS[-1])     # of a recording [s]


def travel(t):
    """Of the pads at times t (t,) [s], (t, p) [m]."""
    return sum(np.outer(push.gone(t - start), push.travel)
               for push, start in zip(PUSHES, STARTS, strict=False))


def response(rays, t, what):
    """What of an elastic body at times t (t,) [s]: 'u' or 'force' of ray.Ray, (t, ..., 3).

    rays : name of RAYS -> ray.Ray
    """
    out = np.repeat(next(iter(rays.values())).at(np.zeros(1), what), len(t), axis=0)
    for push, start in zip(PUSHES, STARTS, strict=False):
        gone = push.gone(t - start)
        out[gone > 0.0] = rays[push.ray].at(push.share * gone[gone > 0.0], what)
    return out


def instants():
    """Times [s] at which a body that remembers is solved, increasing, the first at rest."""
    out = [0.0]
    for push, start in zip(PUSHES, STARTS, strict=False):
        corner, way = ROUNDED / 2.0, push.way + ROUNDED
        steps = np.linspace(0.0, way, 1 + int(np.clip(np.ceil(push.travel.max() / STEP), 4, 9)))
        there, leave = start - corner + way, start + push.way + push.hold - corner
        out += [*(start - corner + steps),
                *(there + SOON[SOON < leave - there - SOON[0]]), *(leave + steps),
                *(leave + way + SOON[SOON < push.rest - ROUNDED - SOON[0]])]
    return np.array(out)
