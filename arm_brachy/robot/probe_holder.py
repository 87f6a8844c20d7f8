"""What holds the probe, as the arm's phases see it: the seam between strategies and a mechanism.

All poses in the world frame W; the probe's frame P as in `probe_pose`. `panda_holder.PandaHolder`
is one; `scissor_holder.ScissorHolder`, which can only turn about a centre, is another, with the
orientation strategy alone.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np


class Way(IntEnum):
    """What a tick asks for; the numbers are those of `arm_loop`."""

    POSE = 0         # the pose in all directions
    FORCE = 1        # the pose across the axis, the contact force along it
    BRAKE = 2        # come to rest
    RETREAT = 3      # off the skin, along the axis


@dataclass(frozen=True)
class Errand:
    """What the holder shall do in a tick.

    way : Way;  R (3, 3), p (3,) : goal pose at the start of the tick;  v, w : how it moves
    axial : [m/s] with which the skin is expected to move along the axis
    seek : [m/s] along the axis while nothing is touched;  force : [N] along the axis
    """

    way: Way
    R: np.ndarray
    p: np.ndarray
    v: np.ndarray
    w: np.ndarray
    axial: float = 0.0
    seek: float = 0.0
    force: float = 0.0


@dataclass(frozen=True)
class HolderState:
    """The holder at the end of a tick.

    R (3, 3), p (3,) : probe by the encoders;  R_true, p_true : where it is
    q, dq, torque : of the joints, m and N where one is a slide
    wrench : (6,) on the probe, axes of P, about its face, measured
    in_contact : bool;  trip : 0 or the limit that was passed;  force_goal : [N] by now
    """

    R: np.ndarray
    p: np.ndarray
    R_true: np.ndarray
    p_true: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    torque: np.ndarray
    wrench: np.ndarray
    in_contact: bool
    trip: int
    force_goal: float


class ProbeHolder(Protocol):
    """Face of a mechanism that holds the probe."""

    joint_names: tuple
    home: tuple           # (R (3, 3), p (3,)) where it rests
    planners: dict        # strategy -> planner class of `probe_planner`, for what it can do

    def state(self):
        """Return the HolderState now."""

    def run(self, errand, reading, periods):
        """Carry out an Errand; return the measured force (periods,) [N] along the axis.

        reading : wrench (6,) of the tissue on the probe and stiffness (6, 6), axes of W, for the
            probe's true pose now; None = as this holder's own contact model leaves it
        """

    def begin_retreat(self, away):
        """Fix where a retreat ends: `away` [m] off the skin; a passed limit is forgotten."""

    def clear_trip(self):
        """Forget a passed limit."""

    def retreated(self):
        """True at the end of a retreat."""

    def obstacle(self, R, p):
        """Why a pose cannot be taken, in one line; '' if it can."""

    def weigh(self, hurry=1.0):
        """Follow the sensor's zero by the readings of the last tick: nothing touches the probe.

        hurry : times as fast as at home
        Returns how much force [N] there was; from force_torque.MOST_DRIFT on it is not followed.
        """

    def picture(self, width, height, skin):
        """Return (height, width, 3) uint8 of it over the body.

        skin : (x (n, 3), triangles (k, 3)) in W, or None
        """

    def close(self):
        """Let go what it holds."""
