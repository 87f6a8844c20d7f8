"""The guide template: holes of a square grid, and where they appear in the ultrasound image.

Frame T of the template: origin in the middle hole, x and y along its columns and rows, z along
the needles. Image frame U: pixels, u along the transducer's elements from the left edge, v with
depth from the face.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.quantity import quantity, whole

_GRAZING = 1e-3      # cosine of needles to the plane's normal, below which they run along it


@dataclass(frozen=True)
class TemplateParams:
    """A template of the kind used in brachytherapy."""

    columns: int = whole(13, 'of holes', low=1, high=100)
    rows: int = whole(13, 'of holes', low=1, high=100)
    pitch: float = quantity(5.0, 'mm', 'between holes', low=1.0, high=20.0,
                            source='usual template of prostate and breast brachytherapy')
    origin: tuple = quantity((-49.5, -49.5, 27.0), 'mm', 'of the middle hole, where needles leave '
                             'it, in W', shape=(3,), source='own choice: 12 mm off the skin of '
                                                            'breast.yaml, between two pads')
    axis: tuple = quantity((1.0, 1.0, 0.0), '', 'along the needles, in W; any length', shape=(3,),
                           source='own choice: between the pads of breast.yaml')
    up: tuple = quantity((0.0, 0.0, 1.0), '', 'of the template, in W: the rows go up it',
                         shape=(3,), source='own choice: away from the chest wall')


@dataclass(frozen=True)
class ImageGeometry:
    """A rectangular image of a linear probe.

    width, height : pixels;  scale : (2,) [pixel/m] along the elements and with depth
    """

    width: int
    height: int
    scale: tuple


def base_to_image(R, p, image):
    """Return the (4, 4) matrix that takes homogeneous points of B to (u, v, distance, 1).

    R, p : pose of the probe in the base frame;  image : ImageGeometry
    The distance [m] is that from the image plane. Scaling comes last: S B A, with A the
    translation to the probe, B the rotation into its frame, S the scaling to pixels and the shift
    to the image's corner. (6.10) prints A B C, which scales base coordinates before they are
    turned: wrong for any pose whose axes are not those of the base.
    """
    A, B, S = np.eye(4), np.eye(4), np.zeros((4, 4))
    A[:3, 3] = -np.asarray(p)
    B[:3, :3] = R.T
    S[0, 0], S[0, 3] = image.scale[0], 0.5 * (image.width - 1)
    S[1, 2] = image.scale[1]
    S[2, 1] = S[3, 3] = 1.0
    return S @ B @ A


def pixels(matrix, points):
    """Return (k, 3): u, v [pixel], distance from the plane [m] of points (k, 3) [m] in B."""
    points = np.atleast_2d(points)
    return (np.column_stack([points, np.ones(len(points))]) @ matrix.T)[:, :3]


class Template:
    """A template in its place.

    params : TemplateParams;  R, p : its pose in the base frame, (3, 3) and (3,) [m]
    """

    def __init__(self, params, R, p):
        """Set it up; see the class."""
        self.params, self.R, self.p = params, np.array(R, float), np.array(p, float)

    @classmethod
    def placed(cls, params):
        """The template where its params have it. Raises InputError if `up` is along `axis`."""
        z, up = np.array(params.axis, float), np.array(params.up, float)
        x = np.cross(up, z)
        if np.linalg.norm(x) < _GRAZING * np.linalg.norm(z) * np.linalg.norm(up) or not z.any():
            raise InputError(f'template: axis = {list(params.axis)} and up = {list(params.up)}; '
                             'must be two directions that differ')
        x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
        return cls(params, np.column_stack([x, np.cross(z, x), z]), params.origin)

    @property
    def axis(self):
        """(3,) unit vector along the needles, base frame."""
        return self.R[:, 2]

    def hole(self, column, row):
        """Return where a hole is (3,) [m], base frame; (0, 0) is the first of each.

        Raises InputError for a hole that the template does not have.
        """
        for name, value, count in (('column', column, self.params.columns),
                                   ('row', row, self.params.rows)):
            if not 0 <= value < count:
                raise InputError(f'template: {name} = {value}; must be 0 to {count - 1}')
        return self.holes[column, row].copy()

    @cached_property
    def holes(self):
        """(columns, rows, 3) [m] of all holes, base frame."""
        x, y = (self.params.pitch * (np.arange(n) - 0.5 * (n - 1))
                for n in (self.params.columns, self.params.rows))
        return self.p + x[:, None, None] * self.R[:, 0] + y[:, None] * self.R[:, 1]

    def in_image(self, R, p, image):
        """Return where the axes of all holes pierce the image plane, (columns, rows, 2) [pixel].

        As `piercing`. Holes outside the picture are given too.
        """
        return self.piercing(R, p, image, self.holes)

    def piercing(self, R, p, image, points):
        """Return where lines along the needles pierce the image plane, (..., 2) [pixel].

        R, p : pose of the probe;  image : ImageGeometry;  points : (..., 3) [m] one on each line
        Raises InputError if the needles run along the image plane.
        """
        normal = R[:, 1]
        slope = normal @ self.axis
        if abs(slope) < _GRAZING:
            raise InputError('template: its needles run along the image plane; must cross it: '
                             'turn the probe across the needles')
        along = ((p - points) @ normal / slope)[..., None]
        at = pixels(base_to_image(R, p, image), (points + along * self.axis).reshape(-1, 3))
        return at[:, :2].reshape(*points.shape[:-1], 2)
