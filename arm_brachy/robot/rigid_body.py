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
        R, p = frames(self.dh, np.asarray(q, dtype=float))
        return R[-1], end_effector(R, p, self.tip)

    def jacobian(self, q):
        """Return J (6, n): linear, then angular velocity of the end effector, base frame."""
        return _jacobian(self.dh, self.tip, np.asarray(q, dtype=float))

    def torque(self, q, dq, ddq):
        """Return the joint torques (n,) [N m] that make ddq happen, gravity carried."""
        return newton_euler(self.dh, self.mass, self.centre, self.inertia, self.gravity,
                            *(np.asarray(v, dtype=float) for v in (q, dq, ddq)))

    def gravity_torque(self, q):
        """Return g (n,) [N m], what holds the arm still."""
        rest = np.zeros(len(self.mass))
        return self.torque(q, rest, rest)

    def coriolis_torque(self, q, dq):
        """Return C(q, dq) dq (n,) [N m]."""
        return newton_euler(self.dh, self.mass, self.centre, self.inertia, np.zeros(3),
                            np.asarray(q, dtype=float), np.asarray(dq, dtype=float),
                            np.zeros(len(self.mass)))

    def mass_matrix(self, q):
        """Return M (n, n) [kg m2], symmetric positive definite."""
        return _mass_matrix(self.dh, self.mass, self.centre, self.inertia,
                            np.asarray(q, dtype=float))


def steiner(mass, offset):
    """Return the inertia (3, 3) that a point mass [kg] at `offset` (3,) [m] has about 0."""
    return mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))


# Loops over three components: a call of BLAS or of np.cross costs more than the arithmetic.

@numba.njit(cache=True)
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def _turn(R, v, out):
    for i in range(3):
        out[i] = R[i, 0] * v[0] + R[i, 1] * v[1] + R[i, 2] * v[2]


@numba.njit(cache=True)
def _turn_back(R, v, out):
    for i in range(3):
        out[i] = R[0, i] * v[0] + R[1, i] * v[1] + R[2, i] * v[2]


@numba.njit(cache=True)
def _step(dh, angle, R, p):
    """Write rotation (3, 3) and origin (3,) of a frame in the one before."""
    ca, sa, ct, st = np.cos(dh[1]), np.sin(dh[1]), np.cos(angle), np.sin(angle)
    R[0, 0], R[0, 1], R[0, 2] = ct, -st, 0.0
    R[1, 0], R[1, 1], R[1, 2] = st * ca, ct * ca, -sa
    R[2, 0], R[2, 1], R[2, 2] = st * sa, ct * sa, ca
    p[0], p[1], p[2] = dh[0], -sa * dh[2], ca * dh[2]


@numba.njit(cache=True)
def frames(dh, q):
    """Return R (n, 3, 3), p (n, 3) [m] of the link frames in the base frame."""
    n = len(q)
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    R_step, p_step = np.empty((3, 3)), np.empty(3)
    for k in range(n):
        _step(dh[k], q[k], R_step, p_step)
        if k == 0:
            R[0], p[0] = R_step, p_step
            continue
        _turn(R[k - 1], p_step, p[k])
        for i in range(3):
            p[k, i] += p[k - 1, i]
            for j in range(3):
                R[k, i, j] = (R[k - 1, i, 0] * R_step[0, j] + R[k - 1, i, 1] * R_step[1, j]
                              + R[k - 1, i, 2] * R_step[2, j])
    return R, p


@numba.njit(cache=True)
def point_jacobian(R, p, point, n):
    """Return (6, 7) or so: velocity and angular velocity of a point fixed to link n - 1.

    R, p : as `frames` returns them;  point : (3,) [m] base frame. Columns from n on are zero.
    """
    J, arm, column = np.zeros((6, len(p))), np.empty(3), np.empty(3)
    for i in range(n):
        for k in range(3):
            arm[k] = point[k] - p[i, k]
            J[3 + k, i] = R[i, k, 2]
        _cross(J[3:, i], arm, column)
        for k in range(3):
            J[k, i] = column[k]
    return J


@numba.njit(cache=True)
def end_effector(R, p, tip):
    """Return where `tip` (3,) of the last frame is, base frame."""
    out = np.empty(3)
    _turn(R[-1], tip, out)
    for k in range(3):
        out[k] += p[-1, k]
    return out


@numba.njit(cache=True)
def _jacobian(dh, tip, q):
    R, p = frames(dh, q)
    return point_jacobian(R, p, end_effector(R, p, tip), len(q))


@numba.njit(cache=True)
def newton_euler(dh, mass, centre, inertia, gravity, q, dq, ddq):
    """Return the joint torques (n,) of `Arm.torque`."""
    n = len(q)
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    force, moment = np.empty((n, 3)), np.empty((n, 3))
    w, dw, a = np.zeros(3), np.zeros(3), -gravity
    w_next, dw_next = np.empty(3), np.empty(3)
    u, v, at = np.empty(3), np.empty(3), np.empty(3)
    for i in range(n):  # outward: motion of each link, in its own frame
        _step(dh[i], q[i], R[i], p[i])
        _cross(w, p[i], u)
        _cross(w, u, v)
        _cross(dw, p[i], u)
        for k in range(3):
            at[k] = u[k] + v[k] + a[k]
        _turn_back(R[i], at, a)
        _turn_back(R[i], w, w_next)
        _turn_back(R[i], dw, dw_next)
        dw_next[0] += w_next[1] * dq[i]     # w x (0, 0, dq)
        dw_next[1] -= w_next[0] * dq[i]
        dw_next[2] += ddq[i]
        w_next[2] += dq[i]
        for k in range(3):
            w[k], dw[k] = w_next[k], dw_next[k]
        _cross(w, centre[i], u)
        _cross(w, u, v)
        _cross(dw, centre[i], u)
        for k in range(3):
            force[i, k] = mass[i] * (u[k] + v[k] + a[k])
        _turn(inertia[i], w, u)
        _cross(w, u, v)
        _turn(inertia[i], dw, u)
        for k in range(3):
            moment[i, k] = u[k] + v[k]
    f, m, torque = np.zeros(3), np.zeros(3), np.empty(n)
    for i in range(n - 1, -1, -1):  # inward: what each joint has to carry
        if i < n - 1:
            _turn(R[i + 1], f, u)
            _turn(R[i + 1], m, at)
            _cross(p[i + 1], u, v)
            for k in range(3):
                f[k], m[k] = u[k], at[k] + v[k]
        _cross(centre[i], force[i], u)
        for k in range(3):
            m[k] += moment[i, k] + u[k]
            f[k] += force[i, k]
        torque[i] = m[2]
    return torque


@numba.njit(cache=True)
def mass_matrix(R, p, mass, centre, inertia):
    """Return M (n, n): the kinetic energy of each link through its own Jacobian.

    R, p : as `frames` returns them
    """
    n = len(mass)
    M, at = np.zeros((n, n)), np.empty(3)
    turned = np.empty((3, n))
    for link in range(n):
        _turn(R[link], centre[link], at)
        for k in range(3):
            at[k] += p[link, k]
        J = point_jacobian(R, p, at, link + 1)
        for i in range(link + 1):
            _turn_back(R[link], J[3:, i], at)
            _turn(inertia[link], at, turned[:, i])
            _turn(R[link], turned[:, i].copy(), turned[:, i])
        for i in range(link + 1):
            for j in range(i + 1):
                for k in range(3):
                    M[i, j] += mass[link] * J[k, i] * J[k, j] + J[3 + k, i] * turned[k, j]
    for i in range(n):
        for j in range(i):
            M[j, i] = M[i, j]
    return M


@numba.njit(cache=True)
def _mass_matrix(dh, mass, centre, inertia, q):
    R, p = frames(dh, q)
    return mass_matrix(R, p, mass, centre, inertia)
