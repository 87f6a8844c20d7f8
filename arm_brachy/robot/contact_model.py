"""The tissue between two of its ticks, as the arm's faster loop feels it.

    W(t) = W_last - K (X(t) - X_last),   the normal part never pulls
W_last, K : wrench and stiffness that the tissue gave for the probe's pose X_last. This is the
interface-Jacobian scheme of co-simulation: the faster side carries the slower one's tangent, so
that a tick of 50 ms does not make a stiff contact unstable.
Source: Sicklinger et al. 2014, Int J Numer Meth Engng 98:418, sec. 3.
Valid while the probe moves far less within a tick than it indents the tissue.
"""

import numba
import numpy as np

from arm_brachy.robot.reference import rotation_vector


@numba.njit(cache=True)
def contact_wrench(R, p, R_last, p_last, W_last, K):
    """Return the wrench (6,) [N, N m] of the tissue on the probe about the middle of its face.

    R, p : pose of the probe now, z out of the face;  R_last, p_last : pose that W_last (6,) and
    K (6, 6) belong to. One frame for all. Zero where the normal force would pull.
    """
    moved = np.empty(6)
    moved[:3] = p - p_last
    moved[3:] = rotation_vector(R @ R_last.T)
    W = W_last - K @ moved
    if W[0] * R[0, 2] + W[1] * R[1, 2] + W[2] * R[2, 2] >= 0.0:
        W[:] = 0.0
    return W
