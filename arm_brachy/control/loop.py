"""How the manipulation loop is set up, and what one step of it reports."""

from dataclasses import dataclass, field
from enum import Enum
from typing import Literal

import numpy as np

from arm_brachy.control.mpc import MpcParams
from arm_brachy.control.observer import ObserverParams
from arm_brachy.control.pose_gate import PoseGateParams
from arm_brachy.control.reach import Reach
from arm_brachy.control.stillness import StillnessParams
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity


@dataclass(frozen=True)
class ManipulatorParams:
    """How the loop is closed and when it keeps still.

    loop : closed on the tracker, or open: the model's prediction stands for the measurement,
        as for the open-loop columns of Table 3.1
    go_to_closest : with a goal out of reach, go to the closest reachable point; False = hold
    """

    mpc: MpcParams = field(default_factory=MpcParams)
    observer: ObserverParams = field(default_factory=ObserverParams)
    gate: PoseGateParams = field(default_factory=PoseGateParams)
    stillness: StillnessParams = field(default_factory=StillnessParams)
    loop: Literal['closed', 'open'] = 'closed'
    go_to_closest: bool = True
    tolerance: float = quantity(
        0.2, 'mm', 'error on each controlled axis that counts as reached', low=1e-3, high=50.0,
        source='two thirds of the 0.3 mm steady-state error asked for')
    stale_after: float = quantity(
        0.5, 's', 'age of the last sample at which pushing stops', low=0.01, high=60.0,
        source='20 samples of a 40 Hz tracker')
    actuator_delay: float = quantity(
        0.3, 's', 'time within which an actuator carries out one push', low=0.0, high=10.0,
        source='three control periods')


@dataclass(frozen=True)
class ManipulatorStep:
    """What one step came to. World frame, SI.

    command : (p,) [m] travel each pad shall have, NaN as long as no pad travel was ever reported
    outcome, message : how it went, for a person
    reference : (3,) [m] goal, the estimate itself on free axes and without a goal
    estimate : (3,) [m] target, model plus disturbance;  disturbance : (3,) [m];  sd : [m] per axis
    jacobian : (3, p);  error : (3,) [m] reference - estimate;  pending : (p,) [m] travel under way
    reached : every controlled axis within tolerance;  settled : resting, no push until disturbed
    reach : Reach on the controlled axes, None without a goal;  closest : (3,) [m] where it leads
    The arrays are read-only: the controller goes on working with them.
    """

    t: float
    command: np.ndarray
    outcome: Outcome
    reference: np.ndarray
    estimate: np.ndarray
    disturbance: np.ndarray
    sd: float
    jacobian: np.ndarray
    error: np.ndarray
    pending: np.ndarray
    reached: bool = False
    settled: bool = False
    reach: Reach | None = None
    closest: np.ndarray | None = None
    message: str = ''

    def __post_init__(self):
        """Lock the arrays."""
        for name in ('command', 'reference', 'estimate', 'disturbance', 'jacobian', 'error',
                     'pending'):
            getattr(self, name).setflags(write=False)
        if self.closest is not None:
            self.closest.setflags(write=False)


class Mode(Enum):
    """What the operator wants."""

    IDLE = 'no goal given yet'
    ACTIVE = 'go to the goal'
    HOLD = 'held on request; the goal is kept'
    ABORTED = 'aborted on request; the goal is dropped'
    FORBIDDEN = 'the supervisor forbids motion; the goal is dropped'
