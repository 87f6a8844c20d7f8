"""The gel block: its size, its pads, what is marked on it and in it.

Frame W: origin in the middle of the glued base, z up, x along the long side. SI.
"""

from dataclasses import dataclass

import numpy as np

MM = 1e-3
SIZE = (120 * MM, 90 * MM, 60 * MM)     # along x, y, z
E, NU, DENSITY = 12e3, 0.485, 1000.0    # of the scene [Pa, 1, kg/m^3]
SIDE = 28 * MM                          # of a pad, which is square and bonded
STROKE = 12 * MM
STANDOFF = 12 * MM                      # of the optical marker behind its pad


@dataclass(frozen=True)
class Pad:
    """A square pad: centre (3,) [m] and push direction (3,), along an axis of W."""

    name: str
    centre: tuple
    direction: tuple

    @property
    def marker(self):
        """Where its optical marker is at rest, (3,) [m]."""
        return np.array(self.centre) - STANDOFF * np.array(self.direction)

    def carries(self, points):
        """Which of the points (n, 3) [m] are bonded to it, (n,) bool."""
        off = points - np.array(self.centre)
        return ((np.abs(off @ np.array(self.direction)) < 1e-6 * MM)
                & (np.abs(off).max(axis=1) <= SIDE / 2 + 1e-6 * MM))


PADS = (Pad('pad_a', (60 * MM, 6 * MM, 30 * MM), (-1.0, 0.0, 0.0)),
        Pad('pad_b', (-10 * MM, 45 * MM, 30 * MM), (0.0, -1.0, 0.0)))
DIRECTIONS = np.array([pad.direction for pad in PADS])


def _named(pattern, points_mm):
    return {pattern.format(i): MM * np.array(p, dtype=float)
            for i, p in enumerate(points_mm, start=1)}


# Eight on top, the others on the sides, none within 10 mm of a pad's rim.
MARKERS = _named('m{:02d}', (
    (40, 28, 60), (-40, 28, 60), (-40, -28, 60), (40, -28, 60), (2, 31, 60), (0, -30, 60),
    (14, -4, 60), (-21, 4, 60), (60, -25, 38), (60, 34, 20), (-60, 25, 38), (-60, -34, 20),
    (32, 45, 38), (-45, 45, 22), (-35, -45, 32), (1, -45, 40), (36, -45, 27), (20, -45, 14)))
TARGETS = _named('t{}', ((10, 5, 30), (-25, -10, 35), (26, 14, 42)))
BASE_MARKERS = _named('base_{}', ((70, 55, 0), (-70, 55, 0), (-70, -55, 0)))
PAD_MARKERS = {f'on_{pad.name}': pad.marker for pad in PADS}
