"""The base moves to and fro: the chest wall of a patient who breathes."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import BodyTerm, Kind, Stage, TermSpec


@dataclass(frozen=True)
class Breathing(BodyTerm):
    """Rigid harmonic translation of the base, and of all that is fixed to it.

    Symbols: A `amplitude`, f `frequency`, phi `phase`, e the unit vector along `direction`. Fixed
    nodes, the springs of a compliant base, the ground under a debonded one and base markers move;
    pads and obstacles stay in the world. Time is that of the run. Between ticks of dt the base
    moves linearly, which cuts A (2 pi f dt)^2 / 8 off the crest: 1e-4 A at 0.23 Hz and 20 ms.

    Holds for a chest wall that moves as a whole and by less than it would bend or tilt. A body
    held in its stress-free shape until a release does not breathe before it.
    Test: tissue/terms/test_breathing.py (moving frame, superposition, markers of the base)
    """

    amplitude: float = quantity(
        0.0, 'mm', 'half the travel', low=0.0, high=30.0, prior=('lognormal', 0.4, 2.0),
        typical=0.4, source='engineering judgement: prone or restrained; free breathing moves a '
                            'supine chest wall by several mm', neutral=0.0)
    frequency: float = quantity(
        0.23, 'Hz', 'breaths per second', low=0.01, high=5.0, prior=('lognormal', 0.23, 1.3),
        source='an adult at rest: 12 to 18 per minute')
    phase: float = quantity(
        0.0, 'deg', 'phase at t = 0', low=-360.0, high=360.0, prior=('uniform', -180.0, 180.0),
        source='any moment of a breath')
    direction: tuple = quantity(
        [0.0, 0.0, 1.0], '', 'direction of the motion, any length, world frame', shape=(3,),
        low=-1.0, high=1.0, source='out of the chest wall')

    spec: ClassVar[TermSpec] = TermSpec(
        name='breathing', kind=Kind.BOUNDARY, stage=Stage.BODY, timed=True,
        summary='the base moves rigidly to and fro',
        equation='x = X + A sin(2 pi f t + phi) e for fixed nodes',
        source='first harmonic of a periodic motion; kinematics alone',
        invisible_when='the run is short against a breath (then it is an offset); a drift of the '
                       'registration of the same period, where neither pad forces are recorded '
                       'nor pads seen',
        leaves_open='pauses and breaths that differ; a base that bulges or tilts instead of '
                    'moving as a whole')

    def __post_init__(self):
        if not np.any(self.direction):
            raise ConfigError('direction = 0 0 0; must have a length; give any vector along the '
                              'motion')

    def prepare(self, body):
        """Return `body` as it is: where its base is, is a matter of time."""
        return body

    def memory(self, body):
        """Return the vector (3,) [m] from the middle to the crest; it does not change."""
        return self.amplitude * np.array(self.direction) / np.linalg.norm(self.direction)

    def before_step(self, body, memory, t, dt, fields):
        """Move `fields.base` to where it is at t."""
        fields.base += np.sin(2.0 * np.pi * self.frequency * t + self.phase) * memory

    def after_step(self, body, memory, x, t, dt):
        """Return the vector as it is."""
        return memory
