"""What loads do to the scissor linkage: how the face moves, what its weight asks of the joints.

Both from splines over theta_1, since a finite-element solution takes 5 ms. Axes of frame C: origin
in the centre of the sphere, axes of frame B of `scissor_rcm`.
"""

from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from arm_brachy.robot.scissor_stiffness import carrier_compliance, layout, mass_of_arc

_OPENINGS = 30       # knots: the spline is within 1e-3 of what lies between


class Bending:
    """linkage : ScissorParams;  density : [kg/m3];  clear : (low, high) of theta_1 [rad]"""

    def __init__(self, linkage, density, clear):
        """Make the splines, once for every linkage."""
        self._carrier, self._moment = _splines(linkage, clear)
        self._mass = mass_of_arc(linkage, density)
        self._slope = self._moment.derivative()

    def at_face(self, theta_0, theta_1, arm):
        """Return C (6, 6) [m/N, rad/(N m)] at the face; arm : (3,) from the carrier to it."""
        A, turn = np.zeros((6, 6)), _about_z(theta_0)
        A[:3, :3] = A[3:, 3:] = turn
        A[:3, 3:] = np.cross(turn.T, arm).T           # turn's columns x arm
        return A @ self._carrier(theta_1) @ A.T

    def weight_torque(self, theta_0, theta_1, gravity):
        """Return what theta_0 and theta_1 hold (2,) [N m] of the links; gravity : (3,) [m/s2]"""
        turn = _about_z(theta_0)
        down = self._mass * turn.T @ gravity
        return -np.array([down @ np.cross([0.0, 0.0, 1.0], self._moment(theta_1)),
                          down @ self._slope(theta_1)])


@cache
def _splines(linkage, clear):
    """CubicSplines over theta_1: the carrier's compliance (6, 6), the arcs' middles (3,) [m]."""
    openings = np.linspace(*clear, _OPENINGS)
    return (CubicSpline(openings, [carrier_compliance(linkage, t) for t in openings]),
            CubicSpline(openings, [_middles(linkage, t) for t in openings]))


def _middles(linkage, theta_1):
    """(3,) [m] sum of the arcs' centres of mass at theta_0 = 0."""
    hinges, arcs = layout(linkage, theta_1)
    half = 0.5 * linkage.beta
    # An arc's centre of mass lies sin(h) / h of the radius from the centre of the sphere.
    out = np.zeros(3)
    for arc in arcs:
        middle = hinges[arc.start] + hinges[arc.end]
        out += middle / np.linalg.norm(middle)
    return linkage.radius * np.sin(half) / half * out


def _about_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
