"""Cartesian impedance with hybrid force control along the probe's axis, at a kilohertz.

    tau = J^T (F_pose + F_force) + C dq + g + friction + N (posture) ,  then the limits
    F_pose  = A a_d + K e + D (v_d - v)   in the directions that the pose controls,
              e = (p_d - p, Log R_d R^T), each clipped in length
    F_force = z (f_d + k_p e + k_i int e dt + k_d (df_d/dt - s) - d v_z),  e = f_d - f, along the
              probe's axis z
    s = k v_z + L (f - y),  dy/dt = s    observed slope of the force (Luenberger)
    D = zeta (A^1/2 K^1/2 + K^1/2 A^1/2),  A = (J M^-1 J^T)^-1   (square-root damping design)
    N = 1 - J^T (A J M^-1)   dynamically consistent null space
z points out of the probe's face; f > 0 presses. In free motion the pose controls z as well.
s is the measured slope below L and k v_z above it: k_d damps what the probe does to the tissue and
not how it goes with it, as a body that breathes asks for, without differentiating noise.
Sources: Hogan 1985, J Dyn Sys Meas Control 107:1 (impedance); Khatib 1987, IEEE J Robot Autom 3:43
(operational space, null space); Raibert and Craig 1981 (hybrid control); Albu-Schaeffer, Ott,
Frese, Hirzinger 2003, ICRA (damping from square roots of stiffness and inertia).
Valid away from singular poses: A is regularised by `singular`, where stiffness goes first.
"""

from collections import namedtuple
from dataclasses import dataclass, fields

import numba
import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.robot.reference import clipped, rotation_vector

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
    force_gain: float = quantity(4.0, '', 'proportional, on the force error', low=0.0, high=20.0,
                                 source='own choice, below the limit that sensor delay sets')
    force_rate: float = quantity(20.0, 'per_s', 'integral, on the force error', low=0.0,
                                 high=200.0, source='own choice: settles within 0.3 s')
    force_most: float = quantity(10.0, 'N', 'largest integral', low=0.0, high=100.0,
                                 source='own choice: three times the usual contact force')
    force_lead: float = quantity(0.5, 's', 'differential, on the force error', low=0.0, high=5.0,
                                 source='own choice: 150 N s/m on 300 N/m, 0.8 of critical for '
                                        "the arm's 5.7 kg along the axis, the other directions "
                                        'held, and the gain above')
    tissue: float = quantity(300.0, 'N_m', 'stiffness that is expected along the axis', low=10.0,
                             high=1e4, source='a probe of 25 mm on 6 kPa, 2 E a')
    observer: float = quantity(20.0, 'per_s', 'below which the slope of the force is the measured '
                               'one, above that of motion against the tissue', low=1.0, high=200.0,
                               source='own choice: 0.2 N of noise in the command')
    force_damping: float = quantity(10.0, 'Ns_m', 'against motion along the axis', low=0.0,
                                    high=1000.0, source='own choice: 0.05 N on a body that '
                                                        'breathes 3 mm at 0.25 Hz')
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


@numba.njit(cache=True)
def _inverse_and_root(B):
    """Return B^-1 and its symmetric square root, B symmetric positive definite."""
    values, vectors = np.linalg.eigh(B)
    across = np.ascontiguousarray(vectors.T)
    return (vectors / values) @ across, (vectors / np.sqrt(values)) @ across


@numba.njit(cache=True)
def shaped(M, J, gains):
    """Return (A (6, 6) inertia, D (6, 6) damping, N (7, 7) null space projector) in a pose.

    M, J : mass matrix and Jacobian there;  gains : Gains
    Both change with the pose, so slowly that a few periods may pass between two calls.
    """
    M_inv = np.linalg.inv(M)
    JM = J @ M_inv
    mobility = JM @ J.T
    for i in range(6):
        mobility[i, i] += gains.singular
    A, root = _inverse_and_root(mobility)
    root[:, :3] *= np.sqrt(gains.stiffness)
    root[:, 3:] *= np.sqrt(gains.turning_stiffness)
    return A, gains.damping_ratio * (root + root.T), np.eye(len(M)) - J.T @ (A @ JM)


@numba.njit(cache=True)
def force_slope(force, observed, speed, gains):
    """Return how the force rises [N/s], by the observer; `observed` is to rise by it.

    force, observed : [N] measured, and as the observer has it;  speed : as in `axial_force`
    """
    return gains.tissue * speed + gains.observer * (force - observed)


@numba.njit(cache=True)
def axial_force(goal, force, integral, slope, speed, gains):
    """Return what the arm shall push along the probe's axis [N].

    goal, force : [N];  integral : [N];  slope : [N/s] of the force error
    speed : [m/s] along the axis beyond what is expected
    """
    return (goal + gains.force_gain * (goal - force) + integral + gains.force_lead * slope
            - gains.force_damping * speed)


@numba.njit(cache=True)
def impedance_torque(J, R, p, A, D, N, gains, posture, low, high, q, dq, R_goal, p_goal, v_goal,
                     w_goal, a_goal, dw_goal, in_contact, axial):
    """Return the torques (7,) of impedance, force, null space and joint limits; no gravity.

    J (6, 7), R (3, 3), p (3,) : of the end effector;  A, D, N : from `shaped`
    a_goal, dw_goal : (3,) accelerations of the goal, so that it is followed without error
    axial : [N] from `axial_force`, used if in_contact
    """
    twist = J @ dq
    e, rate, pace = np.empty(6), np.empty(6), np.empty(6)
    e[:3] = clipped(p_goal - p, gains.reach)
    e[3:] = clipped(rotation_vector(R_goal @ R.T), gains.turn)
    rate[:3], rate[3:] = v_goal - twist[:3], w_goal - twist[3:]
    pace[:3], pace[3:] = a_goal, dw_goal
    z = R[:, 2].copy()
    if in_contact:   # the axis belongs to the force
        e[:3] -= z * (z @ e[:3])
        rate[:3] -= z * (z @ rate[:3])
    F = A @ pace + D @ rate
    F[:3] += gains.stiffness * e[:3]
    F[3:] += gains.turning_stiffness * e[3:]
    if in_contact:
        F[:3] += z * (axial - z @ F[:3])
    pull = gains.posture_stiffness * (posture - q) - gains.posture_damping * dq
    tau = J.T @ F + N @ pull
    for i in range(len(q)):
        tau[i] += _wall(q[i] - low[i], dq[i], gains) - _wall(high[i] - q[i], -dq[i], gains)
    return tau


@numba.njit(cache=True)
def _wall(inside, speed, gains):
    """Torque [N m] away from a joint limit that is `inside` [rad] off."""
    if inside >= gains.margin:
        return 0.0
    torque = gains.wall * (gains.margin / max(inside, _CLOSEST) - 1.0)
    return torque - gains.wall_damping * min(speed, 0.0)
