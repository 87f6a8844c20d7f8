"""What a step of contact comes to."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from arm_brachy.core.outcome import Outcome


class Touch(IntEnum):
    """What a node of the surface does at a rigid body."""

    FREE = 0
    STICKS = 1
    SLIPS = 2


@dataclass(frozen=True)
class ContactState:
    """Tissue and rigid bodies at rest with each other, world frame.

    x : (n, 3) [m];  X_WB : (b, 4, 4) poses;  force : (b, 3) [N] of the tissue ON each body
    moment : (b, 3) [N m] of the same about the body's origin
    penetration : (b,) [m] deepest point, at most max pressure / k + onset / 2
    dissipation : (b,) [J] work of friction in the last step, >= 0
    pad_force, pad_moment : (p, 3) as StaticSolution, for pads that are bonded besides
    points : PointStates of each body, which the next step starts from
    residual : [N] largest out-of-balance force component on a free node
    iterations : Newton corrections of the step;  factorisations : tangents factorised
    solves : back-solves with a factor;  steps : parts it was taken in
    outcome : OK, or why the state is still the one before
    """

    x: np.ndarray
    X_WB: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    penetration: np.ndarray
    dissipation: np.ndarray
    pad_force: np.ndarray
    pad_moment: np.ndarray
    points: tuple
    residual: float
    iterations: int = 0
    factorisations: int = 0
    solves: int = 0
    steps: int = 0
    outcome: Outcome = Outcome.OK


@dataclass(frozen=True)
class NodalContact:
    """What the nodes of the surface feel of each body.

    pressure : (b, n) [Pa] mean over the touching points around a node, weighted with w N_a^2
    gap : (b, n) [m] signed distance, inf off the surface the body may touch
    touch : (b, n) of `Touch`; SLIPS where points that slide bear most of the pressure
    """

    pressure: np.ndarray
    gap: np.ndarray
    touch: np.ndarray
