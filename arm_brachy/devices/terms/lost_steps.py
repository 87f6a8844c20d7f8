"""Lost steps: a motor or coupling slips once, and from then on the pad stands short."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import ActuationTerm, Kind, Stage, TermSpec
from arm_brachy.devices.terms.selection import chosen_actuators


@dataclass(frozen=True)
class LostSteps(ActuationTerm):
    """The pad stands behind the encoder by a constant from an instant on.

    Symbols: u motor position, y pad position, s `shortfall` [m], t_s `onset` [s]. The slip takes
    no time and shows at the first reading of the bank from the onset on. Homing does not mend it,
    since switch and encoder sit on the motor's side: at home the pad stands `shortfall` behind its
    zero, where it pulls on bonded tissue.
    Test: devices/terms/test_lost_steps.py
    """

    onset: float = quantity(0.0, 's', 'when it slips', low=0.0, high=1e5,
                            prior=('uniform', 0.0, 60.0), source='any time; 0 = before the start')
    shortfall: float = quantity(
        0.6, 'mm', 'how far the pad stands short; negative: too far in', low=-20.0, high=20.0,
        prior=('normal', 0.0, 0.6), typical=0.6,
        source='engineering judgement: half a turn of a screw of 1 to 1.5 mm lead', neutral=0.0)
    actuators: tuple[int, ...] = ()  # of the bank, in a file names of pads too; () means all

    spec: ClassVar[TermSpec] = TermSpec(
        name='lost_steps', kind=Kind.ACTUATION, stage=Stage.TRANSMISSION,
        summary='from an instant on the pad stands short of the encoder',
        equation='y(t) = u(t) - s if t >= t_s else u(t)',
        source='loss of synchronism of a stepping motor: Acarnley 2002, Stepping Motors, 4th ed.',
        invisible_when='the onset precedes the recording (then it is the offset of actuator_gain) '
                       'or no pad or tissue marker is seen after it',
        leaves_open='a loss in several goes or over a second or two; one that depends on load')

    def memory(self, q0):
        """Return None: nothing is remembered.

        Raises ConfigError if `actuators` names one that the bank does not have.
        """
        chosen_actuators(self.actuators, len(q0), self.spec.name)

    def step(self, memory, u, effort, t, dt):
        """Return (pad positions (n,) [m], None)."""
        slipped = chosen_actuators(self.actuators, len(u), self.spec.name) & (t >= self.onset)
        return np.where(slipped, u - self.shortfall, u), None
