"""A force sensor that shows too much or too little of the force."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import Kind, SensingTerm, Stage, TermSpec
from arm_brachy.devices.terms.selection import chosen_names


@dataclass(frozen=True)
class ForceGain(SensingTerm):
    """Forces on some or all pads are scaled, all axes alike.

    Symbols: f_i true force on pad i [N], g `gain`. Moments are left alone. Holds for a sensitivity
    that is off; one that mixes its axes is `axis_crosstalk`, a bent characteristic no term.
    Test: devices/terms/test_force_gain.py
    """

    gain: float = quantity(
        0.08, '', 'apparent over true force, minus one', low=-0.9, high=5.0,
        prior=('normal', 0.0, 0.08), typical=0.08,
        source='engineering judgement: a cable or cover across the sensor carries some percent of '
               'the load, or a calibration is of another unit', neutral=0.0)
    pads: tuple[str, ...] = ()  # names; empty means all

    spec: ClassVar[TermSpec] = TermSpec(
        name='force_gain', kind=Kind.SENSING, stage=Stage.FORCE,
        summary='measured forces are scaled',
        equation='y_i = (1 + g) f_i',
        source='definition: error of the sensitivity (VIM, JCGM 200:2012, 4.12)',
        invisible_when='all pads have it alike and no weight of known mass acts: then it equals a '
                       'modulus scaled by 1 + g; with two pads a gain of one equals the inverse '
                       'gain of the other and another modulus',
        leaves_open='a sensitivity that depends on the load, or differs between the axes')

    def distort(self, t, names, values, pads):
        """Return the apparent forces (k, 3) [N].

        Raises ConfigError if there is no pad of a name in `pads`.
        """
        chosen = chosen_names(self.pads, names, 'force_gain: pads')
        return (1.0 + self.gain * chosen[:, None]) * np.asarray(values, dtype=float)
