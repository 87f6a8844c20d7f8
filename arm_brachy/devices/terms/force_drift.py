"""The zero of a force sensor: off from the start, and creeping."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import Kind, SensingTerm, Stage, TermSpec
from arm_brachy.devices.terms.selection import chosen_names


@dataclass(frozen=True)
class ForceDrift(SensingTerm):
    """A constant and a linearly growing error of the forces on some or all pads.

    Symbols: f_i true force on pad i [N], b `bias` [N], r `rate` [N/s], t time of the cell [s],
    zero at its start. Pads do not turn, so that the axes of the sensors keep their directions in
    the world frame. Moments are left alone. Holds while warming up goes on evenly, for a few
    minutes; it does not level off as a real one does.
    Test: devices/terms/test_force_drift.py
    """

    rate: tuple = quantity(
        [0.25, 0.0, 0.0], 'N_min', 'growth of the error, world frame', low=-50.0, high=50.0,
        shape=(3,), prior=('normal', 0.0, 0.25), typical=0.25,
        source='engineering judgement: strain gauges that warm up, 0.5 % of a range of 50 N per '
               'minute', neutral=0.0)
    bias: tuple = quantity(
        [0.0, 0.0, 0.0], 'N', 'error at time zero, world frame', low=-50.0, high=50.0, shape=(3,),
        prior=('normal', 0.0, 0.25), typical=0.25,
        source='engineering judgement: tared under a load that then went away', neutral=0.0)
    pads: tuple[str, ...] = ()  # names; empty means all

    spec: ClassVar[TermSpec] = TermSpec(
        name='force_drift', kind=Kind.SENSING, stage=Stage.FORCE,
        summary='the zero of the force sensors is off and drifts',
        equation='y_i(t) = f_i(t) + b + r t',
        source='definition: zero error and instrumental drift (VIM, JCGM 200:2012, 4.28 and 4.21)',
        invisible_when='the pads are never unloaded in the recording: the bias then is a pad that '
                       'touches earlier, the drift a modulus that creeps',
        leaves_open='the course: a sensor that warms up settles, others wander')

    def distort(self, t, names, values, pads):
        """Return the apparent forces (k, 3) [N].

        Raises ConfigError if there is no pad of a name in `pads`.
        """
        chosen = chosen_names(self.pads, names, 'force_drift: pads')
        return values + chosen[:, None] * (np.array(self.bias) + t * np.array(self.rate))
