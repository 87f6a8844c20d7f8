"""A force sensor whose axes talk into each other, or are turned."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import Kind, SensingTerm, Stage, TermSpec
from arm_brachy.devices.terms.selection import chosen_names


@dataclass(frozen=True)
class AxisCrosstalk(SensingTerm):
    """Shares of a force along one axis that some or all sensors show along the others.

    Symbols: f_i true force on pad i [N], C a matrix without diagonal: `onward` its entries
    (y, x), (z, y), (x, z), `backward` (z, x), (x, y), (y, z), rows what is shown. A sensor turned
    by a small rotation vector w shows f + w x f to first order: onward = (w_z, w_x, w_y),
    backward = -(w_y, w_z, w_x). Where a pad carries its load in one direction n, nothing but C n
    shows: of oblique pads that has a part along n, a gain. Moments are left alone. Holds for a
    linear characteristic.
    Test: devices/terms/test_axis_crosstalk.py
    """

    onward: tuple = quantity(
        [0.05, 0.0, 0.0], '', 'shares of the forces along x, y, z that show along y, z, x',
        low=-1.0, high=1.0, shape=(3,), prior=('normal', 0.0, 0.05), typical=0.05,
        source='engineering judgement: a sensor without a calibration matrix, or screwed to its '
               'post by eye, 3 degrees off', neutral=0.0)
    backward: tuple = quantity(
        [0.0, 0.0, 0.0], '', 'shares of the forces along x, y, z that show along z, x, y',
        low=-1.0, high=1.0, shape=(3,), prior=('normal', 0.0, 0.05), typical=0.05,
        source='as onward', neutral=0.0)
    pads: tuple[str, ...] = ()  # names; empty means all

    spec: ClassVar[TermSpec] = TermSpec(
        name='axis_crosstalk', kind=Kind.SENSING, stage=Stage.FORCE,
        summary='axes of a force sensor talk into each other, or are turned',
        equation='y_i = (I + C) f_i',
        source='definition: off-diagonal entries of the inverse of a calibration matrix',
        invisible_when='forces act along one line alone: of the six shares three sums then show, '
                       'of a line along an axis two',
        leaves_open='shares that grow with load or saturate; a sensor that turns under load')

    def distort(self, t, names, values, pads):
        """Return the apparent forces (k, 3) [N].

        Raises ConfigError if there is no pad of a name in `pads`.
        """
        chosen = chosen_names(self.pads, names, 'axis_crosstalk: pads')
        values = np.asarray(values, dtype=float)
        return values + chosen[:, None] * (values @ self.matrix.T)

    @property
    def matrix(self):
        """C (3, 3), rows what is shown, columns what acts."""
        out = np.zeros((3, 3))
        for axis in range(3):
            out[(axis + 1) % 3, axis] = self.onward[axis]
            out[(axis + 2) % 3, axis] = self.backward[axis]
        return out
