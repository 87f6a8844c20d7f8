"""The thesis' scheme: position or force, one at a time, each as a velocity of the probe.

    position:  v = K1 e + K2 int e dt + K3 de/dt across the axis, none along it      (6.8)
               w = G1 e + G2 int e dt + G3 de/dt,  e the rotation vector       (6.9, corrected)
    force:     v = z (F1 (f_d - f) + F2 int (f_d - f) dt),  nothing else             (figure 6.4)
Position is corrected once its error passes an outer bound, until it is within an inner one; the
rest of the time belongs to the force. The velocity is integrated into the pose that the arm's
stiff pose controller follows, as the Panda's own Cartesian velocity interface does.
The thesis gives no gains; these are own choices.
"""

from collections import namedtuple
from dataclasses import dataclass, fields

import numba
import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.robot.reference import rotation_vector


@dataclass(frozen=True)
class SwitchedParams:
    """Gains and bounds of the switched scheme."""

    rate: float = quantity(8.0, 'per_s', 'K1 and G1', low=0.1, high=50.0,
                           source='own choice: 95 % of a step within 0.4 s')
    integral: float = quantity(4.0, '', 'K2 and G2, 1/s2', low=0.0, high=100.0,
                               source='own choice: slower than K1 by a factor of two')
    damping: float = quantity(0.1, '', 'K3 and G3', low=0.0, high=1.0, source='own choice')
    force_rate: float = quantity(0.015, '', 'F1, m/s per N', low=0.0, high=1.0,
                                 source='own choice: 5 1/s on a tissue of 300 N/m')
    force_integral: float = quantity(0.015, '', 'F2, m/s2 per N', low=0.0, high=1.0,
                                     source='own choice: slower than F1')
    outer: float = quantity(0.5, 'mm', 'error from which on position is corrected', low=0.01,
                            high=20.0, source='the tolerance of the image plane')
    inner: float = quantity(0.1, 'mm', 'error at which the force takes over again', low=0.001,
                            high=20.0, source='a fifth of the outer bound')
    outer_turn: float = quantity(1.0, 'deg', 'the same for rotation', low=0.01, high=30.0,
                                 source='0.5 mm at 30 mm depth')
    inner_turn: float = quantity(0.2, 'deg', 'the same for rotation', low=0.001, high=30.0,
                                 source='a fifth of the outer bound')


SwitchedGains = namedtuple('SwitchedGains', [field.name for field in fields(SwitchedParams)])


@numba.njit(cache=True)
def switched_velocity(gains, dt, R, p, v, w, R_goal, p_goal, force_error, in_contact, positioning,
                      integrals):
    """Return (velocity (3,), angular velocity (3,), positioning) of the next period.

    R, p, v, w : probe now;  R_goal, p_goal : its goal;  force_error : [N] goal less measured
    in_contact : without contact position alone is controlled, all the time
    positioning : True while position has its turn
    integrals : (7,) of position, rotation and force errors, changed in place
    """
    z = R[:, 2].copy()
    e = p_goal - p
    e -= z * (z @ e)
    turn = rotation_vector(R_goal @ R.T)
    off, turned = np.sqrt(e @ e), np.sqrt(turn @ turn)
    if positioning:
        positioning = off > gains.inner or turned > gains.inner_turn
    else:
        positioning = off > gains.outer or turned > gains.outer_turn
    if positioning or not in_contact:
        integrals[:3] += dt * e
        integrals[3:6] += dt * turn
        across = v - z * (z @ v)
        return (gains.rate * e + gains.integral * integrals[:3] - gains.damping * across,
                gains.rate * turn + gains.integral * integrals[3:6] - gains.damping * w,
                positioning)
    integrals[:6] = 0.0
    integrals[6] += dt * force_error
    speed = gains.force_rate * force_error + gains.force_integral * integrals[6]
    return speed * z, np.zeros(3), positioning
