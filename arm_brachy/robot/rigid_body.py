"""Recursive Newton-Euler dynamics of a serial arm with revolute joints, modified DH.

Frames are Craig's: frame i is fixed to link i, its z the axis of joint i. Everything is compiled,
since it runs at a kilohertz in the controller.
Source: Craig, Introduction to Robotics, 3rd ed., sec. 3.4 (kinematics), 5.7 and 6.5 (Newton-Euler,
eqs. 6.45 to 6.53).
"""

from dataclasses import dataclass, replace

import numba
import numpy as np

from arm_brachy.robot import panda_parameters as panda

STANDARD_GRAVITY = np.array([0.0, 0.0, -9.80665])


@dataclass(frozen=True)
class Payload:
    """A rigid body bolted to the flange.

    mass : [kg];  centre : (3,) [m] of mass, flange frame;  inertia : (3, 3) [kg m2] about it
    """

    mass: float
    centre: np.ndarray
    inertia: np.ndarray


@dataclass(frozen=True)
class Arm:
    """A serial arm of n revolute joints. SI, link frames.

    dh : (n, 3) a, alpha, d;  mass : (n,);  centre : (n, 3);  inertia : (n, 3, 3) about the centre
    tip : (3,) [m] origin of the end effector in the last frame, whose axes it shares
    gravity : (3,) [m/s2] in the base frame
    """

    dh: np.ndarray
    mass: np.ndarray
    centre: np.ndarray
    inertia: np.ndarray
    tip: np.ndarray
    gravity: np.ndarray

    @classmethod
    def panda(cls, gravity=STANDARD_GRAVITY):
        """The Panda without a tool, its end effector in the centre of the flange."""
        return cls(panda.DH, panda.MASS, panda.CENTRE, np.ascontiguousarray(panda.INERTIA),
                   np.array([0.0, 0.0, panda.FLANGE]), np.array(gravity, dtype=float))

    def carrying(self, payload, tip):
        """Return the arm with a Payload on its flange and its end effector in `tip`.

        tip : (3,) [m] in the flange frame
        """
        flange = np.array([0.0, 0.0, panda.FLANGE])
        centre = flange + payload.centre
        mass = self.mass[-1] + payload.mass
        joint = (self.mass[-1] * self.centre[-1] + payload.mass * centre) / mass
        inertia = (self.inertia[-1] + steiner(self.mass[-1], self.centre[-1] - joint)
                   + payload.inertia + steiner(payload.mass, centre - joint))
        return replace(self, mass=np.append(self.mass[:-1], mass),
                       centre=np.vstack([self.centre[:-1], joint]),
                       inertia=np.concatenate([self.inertia[:-1], inertia[None]]),
                       tip=flange + np.asarray(tip, dtype=float))

    def pose(self, q):
        """Return (R_BE (3, 3), p_BE (3,) [m]) of the end effector at joint angles q (n,)."""
        R, p = _frames(self.dh, np.asarray(q, dtype=float))
        return R[-1], p[-1] + R[-1] @ self.tip

    def jacobian(self, q):
        """Return J (6, n): linear, then angular velocity of the end effector, base frame."""
        return _jacobian(self.dh, self.tip, np.asarray(q, dtype=float))

    def torque(self, q, dq, ddq):
        """Return the joint torques (n,) [N m] that make ddq happen, gravity carried."""
        return _newton_euler(self.dh, self.mass, self.centre, self.inertia, self.gravity,
                             *(np.asarray(v, dtype=float) for v in (q, dq, ddq)))

    def gravity_torque(self, q):
        """Return g (n,) [N m], what holds the arm still."""
        rest = np.zeros(len(self.mass))
        return self.torque(q, rest, rest)

    def coriolis_torque(self, q, dq):
        """Return C(q, dq) dq (n,) [N m]."""
        return _newton_euler(self.dh, self.mass, self.centre, self.inertia, np.zeros(3),
                             np.asarray(q, dtype=float), np.asarray(dq, dtype=float),
                             np.zeros(len(self.mass)))

    def mass_matrix(self, q):
        """Return M (n, n) [kg m2], symmetric positive definite."""
        return _mass_matrix(self.dh, self.mass, self.centre, self.inertia,
                            np.asarray(q, dtype=float))


def steiner(mass, offset):
    """Return the inertia (3, 3) that a point mass [kg] at `offset` (3,) [m] has about 0."""
    return mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))


@numba.njit(cache=True)
def _step(dh, angle):
    """Rotation and origin of a frame in the one before."""
    ca, sa, ct, st = np.cos(dh[1]), np.sin(dh[1]), np.cos(angle), np.sin(angle)
    R = np.array([[ct, -st, 0.0], [st * ca, ct * ca, -sa], [st * sa, ct * sa, ca]])
    return R, np.array([dh[0], -sa * dh[2], ca * dh[2]])


@numba.njit(cache=True)
def _frames(dh, q):
    n = len(q)
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    R_before, p_before = np.eye(3), np.zeros(3)
    for i in range(n):
        R_step, p_step = _step(dh[i], q[i])
        p[i] = p_before + R_before @ p_step
        R[i] = R_before @ R_step
        R_before, p_before = R[i], p[i]
    return R, p


@numba.njit(cache=True)
def _jacobian(dh, tip, q):
    R, p = _frames(dh, q)
    end = p[-1] + R[-1] @ tip
    J = np.empty((6, len(q)))
    for i in range(len(q)):
        axis = R[i, :, 2]
        J[:3, i] = np.cross(axis, end - p[i])
        J[3:, i] = axis
    return J


@numba.njit(cache=True)
def _newton_euler(dh, mass, centre, inertia, gravity, q, dq, ddq):
    n = len(q)
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    force, moment = np.empty((n, 3)), np.empty((n, 3))
    w, dw, a = np.zeros(3), np.zeros(3), -gravity
    for i in range(n):  # outward: motion of each link, in its own frame
        R[i], p[i] = _step(dh[i], q[i])
        down = R[i].T
        a = down @ (np.cross(dw, p[i]) + np.cross(w, np.cross(w, p[i])) + a)
        carried = down @ w
        dw = down @ dw + np.cross(carried, np.array([0.0, 0.0, dq[i]]))
        dw[2] += ddq[i]
        w = carried
        w[2] += dq[i]
        c = centre[i]
        force[i] = mass[i] * (np.cross(dw, c) + np.cross(w, np.cross(w, c)) + a)
        moment[i] = inertia[i] @ dw + np.cross(w, inertia[i] @ w)
    f, m, torque = np.zeros(3), np.zeros(3), np.empty(n)
    for i in range(n - 1, -1, -1):  # inward: what each joint has to carry
        if i < n - 1:
            f_carried = R[i + 1] @ f
            m = R[i + 1] @ m + np.cross(p[i + 1], f_carried)
            f = f_carried
        m = m + moment[i] + np.cross(centre[i], force[i])
        f = f + force[i]
        torque[i] = m[2]
    return torque


@numba.njit(cache=True)
def _mass_matrix(dh, mass, centre, inertia, q):
    n = len(q)
    M, rest, still = np.empty((n, n)), np.zeros(n), np.zeros(3)
    for i in range(n):
        unit = np.zeros(n)
        unit[i] = 1.0
        M[:, i] = _newton_euler(dh, mass, centre, inertia, still, q, rest, unit)
    return 0.5 * (M + M.T)
