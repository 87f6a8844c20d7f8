"""Rigid bodies that touch tissue: analytic signed distance, gradient, Hessian.

Each is a convex core (a box or a cylinder, some sides at infinity) grown by a rounding radius, so
that one projection serves them all. In a body's own frame +z points into the tissue; pads and
probes have their front face in z = 0 and no back, because tissue never gets there.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.tissue import contact_kernels as kernels


class AbstractShape(ABC):
    """A rigid body in its own frame."""

    @property
    @abstractmethod
    def core(self):
        """(kind, (7,) array) as `contact_kernels.signed_distance` takes them."""

    @property
    @abstractmethod
    def depth(self):
        """[m] How far below the surface the distance is smooth; deeper, its normal jumps."""

    @property
    def mount(self):
        """(R (3, 3), p (3,) [m]): axes and origin of the core in the body's frame."""
        return np.eye(3), np.zeros(3)

    def signed_distance(self, y):
        """Return d (m,) [m], its gradient (m, 3) and Hessian (m, 3, 3) [1/m] at y (m, 3) [m].

        Positive outside; the gradient is the outward unit normal. Continuously differentiable
        outside and down to `depth`; the Hessian jumps where a flat face meets its rounding.
        """
        R, p = self.mount
        y = np.ascontiguousarray((np.asarray(y, dtype=float).reshape(-1, 3) - p) @ R)
        d, g, H = np.empty(len(y)), np.empty((len(y), 3)), np.empty((len(y), 3, 3))
        kernels.distances(*self.core, y, d, g, H)
        return d, g @ R.T, R @ H @ R.T


@dataclass(frozen=True)
class Plane(AbstractShape):
    """The half-space z <= 0."""

    @property
    def core(self):
        """A box with one side."""
        return kernels.BOX, np.array([-np.inf] * 3 + [np.inf, np.inf, 0.0, 0.0])

    @property
    def depth(self):
        """A plane is smooth at any depth."""
        return np.inf


@dataclass(frozen=True)
class Sphere(AbstractShape):
    """A ball of `radius` [m] about the origin."""

    radius: float

    def __post_init__(self):
        _positive(self, 'radius')

    @property
    def core(self):
        """A point, grown by the radius."""
        return kernels.CYLINDER, np.array([0.0] * 6 + [self.radius])

    @property
    def depth(self):
        """Down to the centre."""
        return self.radius


@dataclass(frozen=True)
class Disc(AbstractShape):
    """A pad: flat round face of `radius` [m] in z = 0, its edge rounded with `edge_radius` [m].

    The flat part has the radius `radius - edge_radius`. Raises ConfigError unless
    0 < edge_radius <= radius: a sharp edge has no normal and cuts the tissue.
    """

    radius: float
    edge_radius: float

    def __post_init__(self):
        _positive(self, 'radius', 'edge_radius')
        _within(self, 'edge_radius', self.radius)

    @property
    def core(self):
        """A cylinder without back."""
        return kernels.CYLINDER, np.array([self.radius - self.edge_radius, -np.inf,
                                           -self.edge_radius, 0.0, 0.0, 0.0, self.edge_radius])

    @property
    def depth(self):
        """The rounding: below it, the nearest surface may be the front or the side."""
        return self.edge_radius


@dataclass(frozen=True)
class RoundedBox(AbstractShape):
    """A linear probe: rectangular face `width` x `thickness` [m] along x and y, in z = 0.

    All edges are rounded with `edge_radius` [m]. Raises ConfigError unless it is positive and at
    most half of either side.
    """

    width: float
    thickness: float
    edge_radius: float

    def __post_init__(self):
        _positive(self, 'width', 'thickness', 'edge_radius')
        _within(self, 'edge_radius', min(self.width, self.thickness) / 2.0)

    @property
    def core(self):
        """A box without back."""
        r = self.edge_radius
        x, y = self.width / 2.0 - r, self.thickness / 2.0 - r
        return kernels.BOX, np.array([-x, -y, -np.inf, x, y, -r, r])

    @property
    def depth(self):
        """The rounding: below it, the nearest surface may be the front or a side."""
        return self.edge_radius


@dataclass(frozen=True)
class CurvedProbe(AbstractShape):
    """A convex probe: cylinder of `radius` about y, `thickness` along y [m], top at z = 0.

    Its two rims are rounded with `edge_radius` [m]. It is a whole cylinder: valid while the
    tissue touches no more of it than the sector a real probe has. Raises ConfigError unless the
    rounding is positive and at most the radius and half the thickness.
    """

    radius: float
    thickness: float
    edge_radius: float

    def __post_init__(self):
        _positive(self, 'radius', 'thickness', 'edge_radius')
        _within(self, 'edge_radius', min(self.radius, self.thickness / 2.0))

    @property
    def core(self):
        """A cylinder with two ends, about its own z."""
        r, half = self.edge_radius, self.thickness / 2.0 - self.edge_radius
        return kernels.CYLINDER, np.array([self.radius - r, -half, half, 0.0, 0.0, 0.0, r])

    @property
    def mount(self):
        """The core's y is the body's z, its z the body's -y; its axis lies at z = -radius."""
        R = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        return R, np.array([0.0, 0.0, -self.radius])

    @property
    def depth(self):
        """The rounding of the rims."""
        return self.edge_radius


def _positive(shape, *names):
    for name in names:
        if not getattr(shape, name) > 0.0:
            raise ConfigError(f'{type(shape).__name__}: {name} = {getattr(shape, name)}; must be '
                              '> 0 m')


def _within(shape, name, limit):
    if getattr(shape, name) > limit:
        raise ConfigError(f'{type(shape).__name__}: {name} = {getattr(shape, name)} m; must be at '
                          f'most {limit:g} m, or the face has no flat left')
