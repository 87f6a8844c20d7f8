"""Lost motion: after a reversal the motor turns before the pad moves."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import ActuationTerm, Kind, Stage, TermSpec
from arm_brachy.devices.terms.selection import chosen_actuators


@dataclass(frozen=True)
class Backlash(ActuationTerm):
    """Play between motor and pad, the Prandtl-Ishlinskii play operator.

    Symbols: u motor position, y pad position, w `width` [m], a `start`. Homing ends in the
    retracting direction, so y = u while retracting and y = u - w while pushing. A bank that begins
    inside its gap (a > 0) has y = u there, y = u + a w while retracting and y = u - (1 - a) w
    while pushing: the place at the beginning is where its pads touch. The loop does not depend on
    speed. Holds while friction in the guide carries the pad across the gap; a pad that the tissue
    pushes back through the gap would show play only where the load changes sign.
    Test: devices/terms/test_backlash.py
    """

    width: float = quantity(
        0.25, 'mm', 'lost motion at a reversal', low=0.0, high=10.0,
        prior=('lognormal', 0.25, 3.0), typical=0.25,
        source='Actuonix L16 data sheet: mechanical backlash 0.25 mm', neutral=0.0)
    actuators: tuple[int, ...] = ()  # of the bank, in a file names of pads too; () means all
    start: float = quantity(
        0.0, '', 'share of the play that is taken up at the beginning: 0 after a retraction, 1 '
        'after a push', low=0.0, high=1.0, prior=('uniform', 0.0, 1.0),
        source='homing ends in the retracting direction; a bank that was not homed is anywhere')

    spec: ClassVar[TermSpec] = TermSpec(
        name='backlash', kind=Kind.ACTUATION, stage=Stage.TRANSMISSION,
        summary='the pad lags the motor by a fixed width after every reversal',
        equation='y(t) = min(max(y(t-), u(t) - (1 - a) w), u(t) + a w)',
        source='play operator: Visintin 1994, Differential Models of Hysteresis',
        invisible_when='pads only ever move one way (then it is an offset), or neither a pad '
                       'marker nor a marker on the tissue is seen across a reversal',
        leaves_open='corners that friction rounds; a gap that differs along the travel by wear; '
                    'a pad that creeps back through it')

    def memory(self, q0):
        """Return the pad positions (n,) of a bank at rest at q0, by `start` in its play.

        Raises ConfigError if `actuators` names one that the bank does not have.
        """
        chosen_actuators(self.actuators, len(q0), self.spec.name)
        return np.array(q0, dtype=float)

    def step(self, memory, u, effort, t, dt):
        """Return (pad positions (n,) [m], new memory); exact while u is monotone within a step."""
        width = self.width * chosen_actuators(self.actuators, len(u), self.spec.name)
        y = np.minimum(np.maximum(memory, u - (1.0 - self.start) * width), u + self.start * width)
        return y, y.copy()
