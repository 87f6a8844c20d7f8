"""Where the end effector shall be, made smooth: limits on speed, acceleration and jerk.

Planned poses come at 20 to 50 Hz and jump; what the impedance controller follows may not. Each of
position and orientation is a cascade of proportional laws, each with its limit:
    v* = clip(v_goal + w1 (goal - x), v_max),  a* = clip(w2 (v* - v), a_max),
    j = clip(w3 (a* - a), j_max)
Overdamped, hence without overshoot of any limit, for w3 >= 4 w2 >= 16 w1. A goal in uniform motion
v_goal is followed without lag; without v_goal the lag is its velocity over w1.
"""

from dataclasses import dataclass

import numba
import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.robot.panda_parameters import CARTESIAN_LIMITS

_SPREAD = 4.0        # ratio of successive rates: real poles


@dataclass(frozen=True)
class ReferenceParams:
    """How fast the end effector may be led; by default far below what the interface allows."""

    rate: float = quantity(6.0, 'per_s', 'of the approach to the goal', low=0.1, high=50.0,
                           source='own choice: 95 % of a step within half a second')
    speed: float = quantity(150.0, 'mm_s', 'largest', low=1.0, high=1700.0,
                            source='above the 123 mm/s mean of clinical maxima of needle speed')
    acceleration: float = quantity(2.0, 'm_s2', 'largest', low=0.01, high=13.0,
                                   source='own choice: a sixth of the interface limit')
    turning: float = quantity(60.0, 'deg_s', 'largest angular speed', low=1.0, high=143.0,
                              source='own choice: below half of the interface limit')

    @property
    def jerk(self):
        """Largest jerk [m/s3], that of the interface."""
        return 0.5 * CARTESIAN_LIMITS.jerk


def lead_limits(params):
    """Return (rates (3,) [1/s] of the cascade, limits (2, 3)) of a ReferenceParams.

    limits : speed, acceleration, jerk; rows translation [m/s ...] and rotation [rad/s ...]
    """
    w = params.rate
    # A limb of the end effector's length turns a rotation limit into one of translation.
    scale = params.turning / params.speed
    linear = np.array([params.speed, params.acceleration, params.jerk])
    return np.array([w, _SPREAD * w, _SPREAD**2 * w]), np.vstack([linear, scale * linear])


@numba.njit(cache=True)
def rotation_vector(R):
    """Return the rotation vector (3,) [rad] of R (3, 3), length at most pi.

    At half a turn the sign of the axis is arbitrary; the one found here depends on R alone.
    """
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = 0.5 * np.sqrt(axis @ axis)
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6:
        return axis * (0.5 * angle / sine)
    if cosine > 0.0:
        return 0.5 * axis
    k = 0
    for i in range(3):
        if R[i, i] > R[k, k]:
            k = i
    half = 0.5 * (R[:, k] + np.eye(3)[k])
    return half * (angle / np.sqrt(half @ half))


@numba.njit(cache=True)
def rotation(vector):
    """Return the rotation matrix (3, 3) of a rotation vector (3,) [rad] (Rodrigues)."""
    angle = np.sqrt(vector @ vector)
    K = np.array([[0.0, -vector[2], vector[1]], [vector[2], 0.0, -vector[0]],
                  [-vector[1], vector[0], 0.0]])
    if angle < 1e-9:
        return np.eye(3) + K
    s, c = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2
    return np.eye(3) + s * K + c * (K @ K)


@numba.njit(cache=True)
def clipped(vector, most):
    """Return the vector (3,), shortened to the length `most` if it is longer."""
    size = np.sqrt(vector @ vector)
    return vector if size <= most else vector * (most / size)


@numba.njit(cache=True)
def towards(wanted, v, a, rates, limits, dt):
    """Return (v, a) after dt [s] on the way to the velocity `wanted`, all (3,), within limits.

    rates : (3,) of the cascade, the first not used;  limits : (3,) speed, acceleration, jerk
    """
    wanted = clipped(wanted, limits[0])
    a_wanted = clipped(rates[1] * (wanted - v), limits[1])
    jerk = clipped(rates[2] * (a_wanted - a), limits[2])
    a = a + dt * jerk
    return v + dt * a, a
