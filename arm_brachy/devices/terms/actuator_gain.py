"""A wrong scale or zero of an actuator: the pad travels more or less than the encoder says."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import ActuationTerm, Kind, Stage, TermSpec
from arm_brachy.devices.terms.selection import chosen_actuators


@dataclass(frozen=True)
class ActuatorGain(ActuationTerm):
    """Pad travel is a straight line of motor travel: a slope off one and a constant.

    Symbols: u motor position, y pad position, b `offset` [m], g `gain`. The offset stands at home
    too: a positive one presses the pad into the tissue at rest, a negative one pulls on bonded
    tissue and leaves a gap in front of a touching pad. Holds for a lead or a scale of the encoder
    set wrong; a position sensor that is not linear bends the line.
    Test: devices/terms/test_actuator_gain.py
    """

    gain: float = quantity(
        0.06, '', 'pad travel over motor travel, minus one', low=-0.5, high=1.0,
        prior=('normal', 0.0, 0.06), typical=0.06,
        source='engineering judgement: three times the nonlinearity of the position sensor '
               '(Actuonix L16 data sheet: below 2 %)', neutral=0.0)
    offset: float = quantity(
        0.0, 'mm', 'pad position where the encoder says zero', low=-20.0, high=20.0,
        prior=('normal', 0.0, 0.5), typical=0.5,
        source='engineering judgement: where a pad first touches soft tissue, found by eye',
        neutral=0.0)
    actuators: tuple[int, ...] = ()  # of the bank, in a file names of pads too; () means all

    spec: ClassVar[TermSpec] = TermSpec(
        name='actuator_gain', kind=Kind.ACTUATION, stage=Stage.TRANSMISSION,
        summary='pad travel is scaled and shifted against the encoder',
        equation='y = (1 + g) u + b',
        source='definition: scale and zero error of a linear transmission',
        invisible_when='no pad marker is seen and a single pad is pushed in one direction: the '
                       'gain then equals a compliance in series, the offset where the pad first '
                       'touches',
        leaves_open='a scale that changes along the travel, as of a screw whose pitch is uneven')

    def memory(self, q0):
        """Return None: nothing is remembered.

        Raises ConfigError if `actuators` names one that the bank does not have.
        """
        chosen_actuators(self.actuators, len(q0), self.spec.name)

    def step(self, memory, u, effort, t, dt):
        """Return (pad positions (n,) [m], None)."""
        chosen = chosen_actuators(self.actuators, len(u), self.spec.name)
        return np.where(chosen, (1.0 + self.gain) * u + self.offset, u), None
