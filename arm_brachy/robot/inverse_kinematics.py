"""Joint angles of the Panda for a pose of its end effector, by damped least squares.

    dq = J+ e + (1 - J+ J) w (posture - q),   J+ = J^T (J J^T + s 1)^-1,   s = |e|^2 / 2 + s0
with e position and rotation vector of the error; the redundancy goes to the posture.
Source: Sugihara 2011, IEEE Trans Robot 27:984 (damping by the error); Nakamura and Hanafusa 1986,
J Dyn Sys Meas Control 108:163.
Valid from a start in the neighbourhood: it finds one of several elbows.
"""

import numba
import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.robot import panda_parameters as panda
from arm_brachy.robot.reference import rotation_vector
from arm_brachy.robot.rigid_body import end_effector, frames, point_jacobian

NEAR = 1e-5          # m, rad: how well a pose is met
_TURNS = 300         # iterations before a pose counts as out of reach
_DAMPING = 1e-7      # s0, against the Jacobian's square of order 1e-1
_PULL = 0.1          # share of the way to the posture in an iteration
_STEP = 0.2          # rad, largest change of an angle in an iteration


def inverse_kinematics(arm, R, p, start, *, margin, turns=_TURNS):
    """Return joint angles (7,) [rad] that put the end effector at R (3, 3), p (3,) [m].

    R, p : in the base frame
    arm : rigid_body.Arm;  start : (7,) where the search begins, also the posture drawn to
    margin : [rad] kept from every joint limit
    Raises InputError for a pose out of reach, with what is missing.
    """
    limits = panda.JOINT_LIMITS
    q, off, turned = _solve(arm.dh, arm.tip, R, p, np.array(start, dtype=float),
                            limits.low + margin, limits.high - margin, turns)
    if off > NEAR or turned > NEAR:
        place = ', '.join(f'{1e3 * c:.0f}' for c in p)
        raise InputError(f'arm: the pose at ({place}) mm of its base is out of reach by '
                         f'{1e3 * off:.1f} mm and {np.degrees(turned):.1f} deg; move the base or '
                         'turn the probe')
    return q


@numba.njit(cache=True)
def _solve(dh, tip, R_goal, p_goal, start, low, high, turns):
    q = start.copy()
    e = np.empty(6)
    off, turned = 0.0, 0.0
    for _ in range(turns):
        Rs, ps = frames(dh, q)
        p = end_effector(Rs, ps, tip)
        e[:3] = p_goal - p
        e[3:] = rotation_vector(R_goal @ Rs[-1].T)
        off, turned = np.sqrt(e[:3] @ e[:3]), np.sqrt(e[3:] @ e[3:])
        if off < NEAR and turned < NEAR:
            break
        J = point_jacobian(Rs, ps, p, len(q))
        square = J @ J.T
        for i in range(6):
            square[i, i] += _DAMPING + 0.5 * (e @ e)
        pull = _PULL * (start - q)
        step = pull + J.T @ np.linalg.solve(square, e - J @ pull)
        for i in range(len(q)):
            q[i] = min(max(q[i] + min(max(step[i], -_STEP), _STEP), low[i]), high[i])
    return q, off, turned
