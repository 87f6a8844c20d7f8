"""What the manipulator asks of a model, whatever it is made of."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from arm_brachy.core.outcome import Outcome


@dataclass(frozen=True)
class ModelState:
    """The model at one set of pad travels.

    position : (3,) [m] target, world frame;  jacobian : (3, p) [m/m] along the push directions
    outcome : OK, or why the solve failed (the arrays are then NaN)
    """

    position: np.ndarray
    jacobian: np.ndarray
    outcome: Outcome = Outcome.OK


class TargetModel(Protocol):
    """Where a target is and what a push does to it; on finite elements: `TissueModel`."""

    targets: tuple

    def rest(self, target):
        """Position (3,) [m] of the named target with every pad at zero travel, world frame."""

    def evaluate(self, q, target):
        """Return ModelState of the named target at pad travel q (p,) [m]."""
