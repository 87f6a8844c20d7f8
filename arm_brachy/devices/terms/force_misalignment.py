"""A force sensor whose axes are turned, or talk into each other."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import Kind, SensingTerm, Stage, TermSpec
from arm_brachy.devices.terms.selection import chosen_names


@dataclass(frozen=True)
class ForceMisalignment(SensingTerm):
    """Forces on some or all pads are shown in axes that are turned against those assumed.

    Symbols: f_i true force on pad i [N], w `turn` [rad], a rotation vector in the world frame, R(w)
    its matrix; y = f + w x f to first order. Cross-talk, y = (I + C) f with C off the diagonal,
    looks the same where one direction n carries the load: w x n = C n; what it makes of the small
    forces across is then wrong in sign where C is symmetric. A turn about n itself shows as far
    as there are forces across. Moments are left alone.
    Test: devices/terms/test_force_misalignment.py
    """

    turn: tuple = quantity(
        [0.0, 0.0, 3.0], 'deg', 'rotation of the shown forces, world frame', low=-45.0, high=45.0,
        shape=(3,), prior=('normal', 0.0, 3.0), typical=3.0,
        source='engineering judgement: a sensor screwed to its post by eye; as much as cross-talk '
               'of 5 % of the load', neutral=0.0)
    pads: tuple[str, ...] = ()  # names; empty means all

    spec: ClassVar[TermSpec] = TermSpec(
        name='force_misalignment', kind=Kind.SENSING, stage=Stage.FORCE,
        summary='axes of the force sensors are turned, or talk into each other',
        equation='y_i = R(w) f_i',
        source="definition: rotation by a vector (Rodrigues' formula); cross-talk to first order",
        invisible_when='forces act along one line alone and the turn is about it')

    def distort(self, t, names, values, pads):
        """Return the apparent forces (k, 3) [N].

        Raises ConfigError if there is no pad of a name in `pads`.
        """
        chosen = chosen_names(self.pads, names, 'force_misalignment: pads')
        values = np.asarray(values, dtype=float)
        return np.where(chosen[:, None], Rotation.from_rotvec(self.turn).apply(values), values)
