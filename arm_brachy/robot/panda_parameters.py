"""The Franka Emika Panda in numbers: geometry, inertias, friction and the limits of its interface.

Inertial parameters are feasible ones identified from measured torques, not those of a CAD model:
they belong together, and single ones (the inertia of link 1) are only seen in combinations.
Source: Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, "Dynamic identification of the Franka
Emika Panda robot with retrieval of feasible parameters using penalty-based optimization", IEEE
RA-L 4(4):4147, 2019, supplementary tables VIII (inertias) and IX (friction).
Limits: Franka Control Interface documentation, "Robot and interface specifications".
"""

from dataclasses import dataclass

import numpy as np

JOINTS = 7
JOINT_NAMES = tuple(f'panda_joint{i + 1}' for i in range(JOINTS))
RIGHT_ANGLE = np.pi / 2

# Modified (Craig) Denavit-Hartenberg: a, alpha of the link before, d of the joint. m, rad.
DH = np.array([
    [0.0, 0.0, 0.333],
    [0.0, -RIGHT_ANGLE, 0.0],
    [0.0, RIGHT_ANGLE, 0.316],
    [0.0825, RIGHT_ANGLE, 0.0],
    [-0.0825, -RIGHT_ANGLE, 0.384],
    [0.0, RIGHT_ANGLE, 0.0],
    [0.088, RIGHT_ANGLE, 0.0],
])
FLANGE = 0.107  # m from frame 7 along its z

MASS = np.array([4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522])  # kg

# Centre of mass in the frame of its link. m.
CENTRE = np.array([
    [0.003875, 0.002081, -0.1750],
    [-0.003141, -0.02872, 0.003495],
    [0.027518, 0.039252, -0.066502],
    [-0.05317, 0.104419, 0.027454],
    [-0.011953, 0.041065, -0.038437],
    [0.060149, -0.014117, -0.010517],
    [0.010517, -0.004252, 0.061597],
])

# Ixx Iyy Izz Ixy Ixz Iyz about the centre of mass, axes of the link's frame. kg m2.
_INERTIA = np.array([
    [0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169],
    [0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704],
    [0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805],
    [0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641],
    [0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229],
    [0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341],
    [0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741],
])
_SYMMETRIC = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
INERTIA = _INERTIA[:, _SYMMETRIC]  # (7, 3, 3)

# Friction: N m, s/rad, rad/s (`friction.joint_friction`).
FRICTION_LEVEL = np.array([0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489])
FRICTION_SLOPE = np.array([5.1181, 9.0657, 10.136, 5.5903, 8.3469, 17.133, 10.336])
FRICTION_SHIFT = np.array([0.039533, 0.025882, -0.04607, 0.036194, 0.026226, -0.021047, 0.0035526])


@dataclass(frozen=True)
class JointLimits:
    """What the Franka Control Interface accepts, joints 1 to 7. SI."""

    low: np.ndarray
    high: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    torque: np.ndarray
    torque_rate: np.ndarray


@dataclass(frozen=True)
class CartesianLimits:
    """What it accepts of the end effector: translation [m/s, m/s2, m/s3], rotation [rad/s]."""

    velocity: float = 1.7
    acceleration: float = 13.0
    jerk: float = 6500.0
    rotation: float = 2.5


JOINT_LIMITS = JointLimits(
    low=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
    high=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
    velocity=np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]),
    acceleration=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
    jerk=np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]),
    torque=np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]),
    torque_rate=np.full(JOINTS, 1000.0))
CARTESIAN_LIMITS = CartesianLimits()
