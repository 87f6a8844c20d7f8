"""The words of a procedure: its steps, what it orders, what it is told of needle and probe.

What happens in each step, and when the next one begins: see `procedure`.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from arm_brachy.core.outcome import Outcome
from arm_brachy.core.probe_phase import ProbePhase

MOVE = 'bring_target'   # name of the task during which the pads move the target


class Phase(Enum):
    """Where the procedure stands."""

    SETTLING = 'settling'
    REGISTERING = 'registering'
    MOVING = 'moving'
    SCANNING = 'scanning'
    PLACING = 'placing'
    APPROACHING = 'approaching'
    MEETING = 'meeting'
    INSERTING = 'inserting'
    DWELLING = 'dwelling'
    WITHDRAWING = 'withdrawing'
    RETRACTING = 'retracting'
    HOMING = 'homing'
    FINISHED = 'finished'


class Kind(Enum):
    """What can be ordered; the value is `Order.value`'s meaning."""

    SET_GOAL = 'position (3,) [m] of the target'
    SHIFT = 'position (3,) [m] of the target, corrected: the same task'
    ARRIVED = 'nothing: the target is at its goal, which the pads keep'
    REST = 'nothing: drop the goal, the pads stay where they are'
    RELEASE = 'nothing: drop the goal and send the pads home'
    SCAN = 'nothing: scan the skin'
    PLACE = 'hole (3,) [m], roll [rad]'
    DRIVE = 'depth [m], speed [m/s]'
    TURN = 'roll [rad]'
    BEND = ('curvature [1/m] of the needle and offset (3,) [m] by the tissue, for what is told of '
            'its tip')
    SHOW = 'where the tip will be (3,) [m] and where it is to be (3,) [m], for the picture'
    STAY = 'nothing: the needle holds'
    FOLLOW = 'nothing: the probe follows the tip'
    RETRACT = 'nothing: the probe goes off the skin'
    FINISH = 'nothing: all is over'


@dataclass(frozen=True)
class Order:
    """One thing to do now."""

    kind: Kind
    value: tuple = ()


@dataclass(frozen=True)
class NeedleSeen:
    """What is told of the needle: depth [m], force along it [N]."""

    depth: float
    force: float = 0.0


@dataclass(frozen=True)
class ProbeSeen:
    """What the probe's controller says; see ProbeState."""

    phase: int = ProbePhase.IDLE
    in_contact: bool = False
    out_of_plane: float = np.nan
    outcome: Outcome = Outcome.OK
    message: str = ''


# Gone through to the end whatever has happened.
WAY_BACK = (Phase.WITHDRAWING, Phase.RETRACTING, Phase.HOMING, Phase.FINISHED)
# What is said of a step that lasted too long. error [mm], depth [mm]
SLOW = {
    Phase.REGISTERING: 'no estimate of the target; look at the markers',
    Phase.MOVING: 'the target is {error} mm from its goal; choose another hole',
    Phase.SCANNING: 'no cloud came; look at the scanner',
    Phase.PLACING: 'the needle is {depth} mm deep; look at its drive',
    Phase.APPROACHING: 'no contact over the tip; look at the probe',
    Phase.MEETING: 'the image plane has not met the tip; choose a smaller view, or look at the '
                   'probe',
    Phase.INSERTING: 'the needle is {depth} mm deep; look at its drive',
    Phase.WITHDRAWING: 'the needle is {depth} mm deep; pull it out by hand',
    Phase.RETRACTING: 'the probe has not come off; look at the arm',
    Phase.HOMING: 'the pads are not home; look at the actuators',
}
