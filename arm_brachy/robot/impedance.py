"""Cartesian impedance with hybrid force control along the probe's axis, at a kilohertz.

    tau = J^T (F_pose + F_force) + C dq + g + friction + N (posture) ,  then the limits
    F_pose  = K e + D (v_d - v)   in the directions that the pose controls,
              e = (p_d - p, Log R_d R^T), each clipped in length
    F_force = z (f_d + k_p (f_d - f) + k_i int (f_d - f) dt - d v_z)   along the probe's axis z
    D = zeta (A^1/2 K^1/2 + K^1/2 A^1/2),  A = (J M^-1 J^T)^-1   (square-root damping design)
    N = 1 - J^T (A J M^-1)   dynamically consistent null space
z points out of the probe's face; f > 0 presses. In free motion the pose controls z as well.
Sources: Hogan 1985, J Dyn Sys Meas Control 107:1 (impedance); Khatib 1987, IEEE J Robot Autom 3:43
(operational space, null space); Raibert and Craig 1981 (hybrid control); Albu-Schaeffer, Ott,
Frese, Hirzinger 2003, ICRA (damping from square roots of stiffness and inertia).
Valid away from singular poses: A is regularised by `singular`, where stiffness goes first.
"""

from collections import namedtuple
from dataclasses import astuple, dataclass, fields

import numba
import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.robot import panda_parameters as panda
from arm_brachy.robot.reference import clipped, rotation_vector
from arm_brachy.robot.rigid_body import (
    end_effector,
    frames,
    mass_matrix,
    newton_euler,
    point_jacobian,
)

_CLOSEST = 1e-4      # rad, below which a joint limit pushes no harder


@dataclass(frozen=True)
class ImpedanceParams:
    """Gains of the controller."""

    stiffness: float = quantity(2000.0, 'N_m', 'of translation', low=10.0, high=5000.0,
                                source='upper half of what Franka allows its Cartesian impedance')
    turning_stiffness: float = quantity(80.0, 'Nm_rad', 'of rotation', low=1.0, high=300.0,
                                        source='as above')
    damping_ratio: float = quantity(1.0, '', 'of every mode', low=0.1, high=2.0,
                                    source='critical')
    force_gain: float = quantity(1.5, '', 'proportional, on the force error', low=0.0, high=20.0,
                                 source='own choice, below the limit that sensor delay sets')
    force_rate: float = quantity(12.0, 'per_s', 'integral, on the force error', low=0.0,
                                 high=200.0, source='own choice: settles within 0.3 s')
    force_most: float = quantity(10.0, 'N', 'largest integral', low=0.0, high=100.0,
                                 source='own choice: three times the usual contact force')
    force_damping: float = quantity(60.0, 'Ns_m', 'against motion along the axis', low=0.0,
                                    high=1000.0, source='own choice: critical at 400 N/m and the '
                                                        "arm's 2 to 3 kg along the axis")
    posture_stiffness: float = quantity(10.0, 'Nm_rad', 'of the null space', low=0.0, high=100.0,
                                        source='own choice')
    posture_damping: float = quantity(4.0, 'Nms_rad', 'of the null space', low=0.0, high=50.0,
                                      source='own choice')
    margin: float = quantity(10.0, 'deg', 'before a joint limit at which it pushes back', low=0.5,
                             high=45.0, source='own choice: brakes from the speed limit in 0.1 s')
    wall: float = quantity(4.0, 'Nm', 'of a joint limit at half the margin; grows without end '
                           'towards the limit', low=0.1, high=50.0,
                           source='own choice: the full torque of the wrist at a quarter of it')
    wall_damping: float = quantity(8.0, 'Nms_rad', 'of motion towards a joint limit, within the '
                                   'margin', low=0.0, high=100.0, source='own choice')
    reach: float = quantity(20.0, 'mm', 'largest error of position that is acted on', low=1.0,
                            high=200.0, source='own choice: 40 N at most across the axis')
    turn: float = quantity(15.0, 'deg', 'largest error of rotation that is acted on', low=1.0,
                           high=90.0, source='own choice: 20 N m at most')
    singular: float = quantity(1e-4, '', 'regularises the inverse operational inertia', low=1e-8,
                               high=1e-1, source='a thousandth of its usual smallest eigenvalue')


# The same for compiled code, which knows no dataclasses.
Gains = namedtuple('Gains', [field.name for field in fields(ImpedanceParams)])


@dataclass
class Command:
    """What the end effector shall do in one period. Base frame, SI.

    R, p, v, w : pose, velocity, angular velocity;  force : [N] along the probe's axis
    in_contact : True = force along the axis is controlled, False = the pose is in all directions
    """

    R: np.ndarray
    p: np.ndarray
    v: np.ndarray
    w: np.ndarray
    force: float = 0.0
    in_contact: bool = False


class ImpedanceController:
    """Joint torques from joint states and the force on the probe; one call a period.

    arm : rigid_body.Arm with its payload;  params : ImpedanceParams
    posture : (7,) [rad] that the null space is drawn to
    """

    def __init__(self, arm, params, posture, period=1e-3):
        """period : [s] between calls."""
        self._arm, self._period = arm, period
        self._gains = Gains(*astuple(params))
        self._posture = np.array(posture, dtype=float)
        self._integral, self._torque = 0.0, None
        self._limits = panda.JOINT_LIMITS

    def reset(self):
        """Forget the integral of the force error, as when contact is lost."""
        self._integral = 0.0

    def step(self, q, dq, force, command):
        """Return the torques (7,) [N m], limited in size and in rate.

        q, dq : (7,) [rad, rad/s];  force : [N] with which the probe presses, along its axis
        """
        arm, limits = self._arm, self._limits
        if command.in_contact:
            gains = self._gains
            grown = self._integral + gains.force_rate * self._period * (command.force - force)
            self._integral = min(max(grown, -gains.force_most), gains.force_most)
        wanted = _torque(
            arm.dh, arm.mass, arm.centre, arm.inertia, arm.tip, arm.gravity, self._gains,
            self._posture, limits.low, limits.high, q, dq, command.R, command.p, command.v,
            command.w, command.force, command.in_contact, force, self._integral)
        if self._torque is None:
            self._torque = arm.gravity_torque(q)
        change = limits.torque_rate * self._period
        wanted = np.clip(wanted, self._torque - change, self._torque + change)
        self._torque = np.clip(wanted, -limits.torque, limits.torque)
        return self._torque


@numba.njit(cache=True)
def _inverse_and_root(B):
    """Return B^-1 and its symmetric square root, B symmetric positive definite."""
    values, vectors = np.linalg.eigh(B)
    across = np.ascontiguousarray(vectors.T)
    return (vectors / values) @ across, (vectors / np.sqrt(values)) @ across


@numba.njit(cache=True)
def _torque(dh, mass, centre, inertia, tip, gravity, gains, posture, low, high, q, dq, R_goal,
            p_goal, v_goal, w_goal, f_goal, in_contact, force, integral):
    n = len(q)
    Rs, ps = frames(dh, q)
    R, p = Rs[-1], end_effector(Rs, ps, tip)
    J = point_jacobian(Rs, ps, p, n)
    M = mass_matrix(Rs, ps, mass, centre, inertia)
    M_inv = np.linalg.inv(M)
    twist = J @ dq
    mobility = J @ M_inv @ J.T
    for i in range(6):
        mobility[i, i] += gains.singular
    A, root = _inverse_and_root(mobility)
    k = np.empty(6)
    k[:3], k[3:] = gains.stiffness, gains.turning_stiffness
    root *= np.sqrt(k)
    D = gains.damping_ratio * (root + root.T)
    e, rate = np.empty(6), np.empty(6)
    e[:3] = clipped(p_goal - p, gains.reach)
    e[3:] = clipped(rotation_vector(R_goal @ R.T), gains.turn)
    rate[:3], rate[3:] = v_goal - twist[:3], w_goal - twist[3:]
    z = R[:, 2].copy()
    if in_contact:   # the axis belongs to the force
        e[:3] -= z * (z @ e[:3])
        rate[:3] -= z * (z @ rate[:3])
    F = k * e + D @ rate
    if in_contact:
        F[:3] -= z * (z @ F[:3])
        F[:3] += z * (f_goal + gains.force_gain * (f_goal - force) + integral
                      - gains.force_damping * (z @ twist[:3]))
    tau = J.T @ F
    pull = gains.posture_stiffness * (posture - q) - gains.posture_damping * dq
    tau += pull - J.T @ (A @ (J @ (M_inv @ pull)))
    for i in range(n):
        tau[i] += _wall(q[i] - low[i], dq[i], gains) - _wall(high[i] - q[i], -dq[i], gains)
    return tau + newton_euler(dh, mass, centre, inertia, gravity, q, dq, np.zeros(n))


@numba.njit(cache=True)
def _wall(inside, speed, gains):
    """Torque [N m] away from a joint limit that is `inside` [rad] off."""
    if inside >= gains.margin:
        return 0.0
    torque = gains.wall * (gains.margin / max(inside, _CLOSEST) - 1.0)
    return torque - gains.wall_damping * min(speed, 0.0)
