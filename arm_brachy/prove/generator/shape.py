"""Exact geometry: a dome as the image of the unit half-ball, and the discs that push it."""
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Dome:
    """Smooth image of the half-ball |b| <= 1, b_z >= 0; its flat face lies in z = 0.

    radii (2,) of the base along x and y [m]; height [m]; skew (2,) shift of the apex [m];
    bump (5,) coefficients of low-order modes of the shape [1], each below some 0.05.
    """

    radii: tuple
    height: float
    skew: tuple = (0.0, 0.0)
    bump: tuple = (0.0, 0.0, 0.0, 0.0, 0.0)

    def place(self, ball):
        """Points of the body (n, 3) [m], world frame, of points (n, 3) of the half-ball."""
        x, y, z = np.asarray(ball, float).T
        c = self.bump
        swell = 1 + c[0] * x * y + c[1] * z * (x**2 - y**2) + c[2] * x * z + c[3] * y * z
        return np.column_stack([
            self.radii[0] * x * swell + self.skew[0] * z**2,
            self.radii[1] * y * swell + self.skew[1] * z**2,
            self.height * z * (1 + c[4] * (x**2 - y**2)),
        ])

    def jacobian(self, ball, step=1e-6):
        """Derivative of `place` (n, 3, 3) [m], last axis the half-ball's, by central differences.

        `place` is a cubic, so the error is of order step^2.
        """
        ball = np.atleast_2d(ball)
        return np.stack([
            (self.place(ball + e) - self.place(ball - e)) / (2 * step)
            for e in step * np.eye(3)
        ], axis=2)

    def normal(self, ball):
        """Outward unit normals (n, 3) at points of the curved face."""
        ball = np.atleast_2d(ball)
        n = np.linalg.solve(self.jacobian(ball).transpose(0, 2, 1), ball[:, :, None])[:, :, 0]
        return n / np.linalg.norm(n, axis=1, keepdims=True)


@dataclass(frozen=True)
class Pad:
    """Rigid disc bonded to the surface that its cylinder meets; it only translates.

    centre (3,) on the surface and unit push direction (3,), world frame; radius, stroke [m].
    """

    name: str
    centre: tuple
    direction: tuple
    radius: float
    stroke: float

    def rim_distance(self, points):
        """Distance from the pad's axis less its radius (n,) [m]: negative under the disc."""
        arm = np.asarray(points) - self.centre
        d = np.asarray(self.direction)
        return np.linalg.norm(arm - (arm @ d)[:, None] * d, axis=1) - self.radius

    def faces(self, points):
        """Whether points (n, 3) of the surface lie on the pad's side of the body (n,)."""
        arm = np.asarray(points) - self.centre
        return arm @ np.asarray(self.direction) < self.radius


def direction_ball(azimuth, height):
    """Point of the unit half-sphere at `azimuth` [rad] and relative height 0 to 1."""
    r = np.sqrt(1 - height**2)
    return np.array([r * np.cos(azimuth), r * np.sin(azimuth), height])
