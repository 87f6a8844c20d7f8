"""The shapes that viewers of every kind can draw: ROS markers, a page in the browser, a report.

All positions are in the base frame of the cell W, in metres.
"""

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

GRID = 2.0**-16    # m, 15 um: coordinates are rounded to it, so that recordings compress
# viridis of matplotlib 3 (van der Walt and Smith, CC0) at equal steps; sRGB.
_VIRIDIS = np.array([[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142],
                     [31, 158, 137], [53, 183, 121], [109, 205, 89], [180, 222, 44],
                     [253, 231, 37]]) / 255.0
SHADES = 32


class Kind(Enum):
    """How the points of a Shape are meant."""

    TRIANGLES = 'triangles'   # corners, joined by `triangles`
    SPHERES = 'spheres'       # centres; size = diameter
    DOTS = 'dots'             # centres; size = side of a square on the screen
    LINE = 'line'             # through all points; size = width
    ARROW = 'arrow'           # from the first point to the second; size = diameter of the shaft
    DISC = 'disc'             # one centre; axes z along its normal, scale = diameters, thickness
    ELLIPSOID = 'ellipsoid'   # one centre; scale = its three diameters along the axes
    BOX = 'box'               # one centre; scale = its three edges along the axes
    TEXT = 'text'             # where it begins; size = height of a letter


@dataclass(frozen=True)
class Shape:
    """One thing to draw.

    layer : what it belongs to; viewers show and hide by it
    points : (k, 3) [m];  size : [m];  colour : r g b a in 0 to 1
    triangles : (f, 3) of TRIANGLES: their corners among the points
    shades : (k,) in 0 to 1, of TRIANGLES: place of each corner in `palette()`, None = colour
    axes : (3, 3), scale : (3,) [m], of DISC, ELLIPSOID and BOX
    """

    layer: str
    kind: Kind
    points: np.ndarray
    colour: tuple
    size: float = 0.0
    triangles: np.ndarray | None = None
    shades: np.ndarray | None = None
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    scale: tuple = (0.0, 0.0, 0.0)
    text: str = ''


def palette():
    """Return (SHADES, 3): colours from the least value to the largest, sRGB in 0 to 1."""
    stops = np.linspace(0.0, 1.0, len(_VIRIDIS))
    return np.column_stack([np.interp(np.linspace(0.0, 1.0, SHADES), stops, column)
                            for column in _VIRIDIS.T])


def shade_index(shades):
    """Return the rows (k,) of `palette()` for shades (k,) in 0 to 1; beyond, the last ones."""
    return np.clip(np.round(np.asarray(shades) * (SHADES - 1)), 0, SHADES - 1).astype(int)


def rounded(points):
    """Return points [m] on the grid of GRID; a recording of them takes a third of the space."""
    return np.round(np.asarray(points, dtype=float) / GRID) * GRID
