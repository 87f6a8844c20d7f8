"""Friction of the Panda's joints: a smooth step in velocity, zero at rest."""

import numba
import numpy as np

from arm_brachy.robot import panda_parameters as panda


def joint_friction(dq):
    """Return the torque (..., 7) [N m] that friction asks of the motors at velocities dq [rad/s].

    tau = phi1 / (1 + exp(-phi2 (dq + phi3))) - phi1 / (1 + exp(-phi2 phi3)): Coulomb friction of
    height about phi1 / 2 to either side, with the viscous part within it.
    Valid for moving joints: it has no stiction, so a simulated joint at rest creeps under load.
    Source: Gaz et al. 2019, supplementary eq. and table IX (see `panda_parameters`).
    """
    return friction_torque(np.asarray(dq, dtype=float), panda.FRICTION_LEVEL,
                           panda.FRICTION_SLOPE, panda.FRICTION_SHIFT)


@numba.njit(cache=True)
def friction_torque(dq, level, slope, shift):
    """Compiled body of `joint_friction` with phi1, phi2, phi3 given."""
    at_rest = level / (1.0 + np.exp(-slope * shift))
    return level / (1.0 + np.exp(-slope * (dq + shift))) - at_rest
