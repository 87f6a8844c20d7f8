"""The half-cylinder: its size, its pads, what is marked on it and in it.

Frame W: origin in the middle of the glued flat side, x along the axis, z up. SI; an angle is
measured from the vertical towards +y.
"""

from dataclasses import dataclass

import numpy as np

MM = 1e-3
RADIUS, LENGTH = 36 * MM, 100 * MM
E, NU = 9e3, 0.48               # of the body [Pa, 1]
SAID, DENSITY = 10e3, 1000.0    # Young's modulus and density in the scene [Pa, kg/m^3]
DISC = 9 * MM                   # radius of a pad, which is round, curved and bonded
STROKE = 12 * MM
STANDOFF = 8 * MM               # of the optical marker behind its pad


def outward(angle):
    """Unit vector (3,) normal to the round side at an angle [degrees]."""
    a = np.radians(angle)
    return np.array([0.0, np.sin(a), np.cos(a)])


def on_the_side(x, angle):
    """Point (3,) [m] of the round side at x [m] and an angle [degrees]."""
    return np.array([x, 0.0, 0.0]) + RADIUS * outward(angle)


@dataclass(frozen=True)
class Pad:
    """A round pad, pushed straight at the axis: its centre by x [m] and angle [degrees]."""

    name: str
    x: float
    angle: float

    @property
    def centre(self):
        """Middle of the disc at rest, (3,) [m]."""
        return on_the_side(self.x, self.angle)

    @property
    def direction(self):
        """Of the push, (3,)."""
        return -outward(self.angle)

    @property
    def marker(self):
        """Where its optical marker is at rest, (3,) [m]."""
        return self.centre - STANDOFF * self.direction


PADS = (Pad('left', -22 * MM, 55.0), Pad('right', 12 * MM, -50.0), Pad('top', 28 * MM, 6.0))
DIRECTIONS = np.array([pad.direction for pad in PADS])
_PLACES = ((-40, 20), (-22, 30), (-38, 62), (-4, 40), (0, 0), (12, -22), (32, -45), (44, 10),
           (-26, -30))          # mm, degrees
MARKERS = {f'm{i}': on_the_side(x * MM, angle) for i, (x, angle) in enumerate(_PLACES, start=1)}
TARGETS = {'seed_a': MM * np.array([-10.0, 5.0, 18.0]),
           'seed_b': MM * np.array([14.0, -8.0, 20.0])}
BASE_MARKERS = {'base_1': MM * np.array([60.0, 45.0, 0.0]),
                'base_2': MM * np.array([-60.0, -45.0, 0.0])}
POINTS = np.array([*MARKERS.values(), *TARGETS.values()])
