"""Series compliance: rod, bracket and pad give way under what pushes back on them."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.core.term import ActuationTerm, Kind, Stage, TermSpec
from arm_brachy.devices.terms.selection import chosen_actuators

# Steps of a pad below this [m] say nothing of the stiffness before it: the tissue solver's
# tolerance on the force would be divided by next to nothing.
_SHORTEST = 1e-7


@dataclass(frozen=True)
class ComplianceMemory:
    """State of the spring.

    pad : (n,) [m] at the last step;  move : (n,) [m] from the step before to it
    effort : (n,) [N] at the step before the last
    stiffness : [N/m] of what the pads push on, as last learned
    """

    pad: np.ndarray
    move: np.ndarray
    effort: np.ndarray
    stiffness: float


@dataclass(frozen=True)
class ActuatorCompliance(ActuationTerm):
    """A linear spring between motor and pad, in balance with the force on the pad.

    Symbols: u motor position, y pad position [m], F(y) force pushing the pads back [N], c
    `compliance`; y- and F- those of the step before, k stiffness of the tissue. The effort handed
    in belongs to the pad position of the step before. Fed back as it is, y = u - c F-, the error
    of every step is -c k times that of the last: the pad rings, and from c k = 1 on it runs away.
    Therefore F- is carried on to the new position, F = F- + k (y - y-), with k learned from the
    last step, (dF . dy) / (dy . dy). At rest the balance is exact, whatever k; while the force
    changes by itself (relaxation) the pad is one step late. Stable as long as k exceeds half the
    true stiffness; more only slows it down, so k falls by at most half in one step. Steps in which
    the force falls while the pad goes in teach nothing: the tissue changed, or another pad moved.
    Holds for effort one step old; mass and damping of the mount are left out.
    Test: devices/terms/test_actuator_compliance.py, closed_loop/test_actuator_compliance.py
    """

    compliance: float = quantity(
        0.125, 'mm_N', 'yield of the pad against the motor', low=0.0, high=10.0,
        prior=('lognormal', 0.125, 3.0), typical=0.125,
        source='engineering judgement: 8 N/mm, a printed bracket and the side play of a slender '
               'rod', neutral=0.0)
    actuators: tuple[int, ...] = ()  # of the bank, in a file names of pads too; () means all

    spec: ClassVar[TermSpec] = TermSpec(
        name='actuator_compliance', kind=Kind.ACTUATION, stage=Stage.TRANSMISSION,
        summary='the pad yields to what pushes back on it',
        equation='y = u - c F(y), solved as y = u - c (F- + k (u - y-)) / (1 + c k)',
        source="definition: Hooke's law in series; step 1 / (1 + c k) of Barzilai & Borwein 1988, "
               'IMA J Numer Anal 8:141',
        invisible_when='no pad marker is seen and a single pad is pushed in one direction: it '
                       'then equals a negative gain of the actuator',
        leaves_open='a spring that stiffens, and friction in it')

    def memory(self, q0):
        """Return the state of a bank that rests unloaded at q0 (n,) [m].

        Raises ConfigError if `actuators` names one that the bank does not have.
        """
        chosen_actuators(self.actuators, len(q0), self.spec.name)
        q0 = np.array(q0, dtype=float)
        return ComplianceMemory(q0, np.zeros_like(q0), np.zeros_like(q0), 0.0)

    def step(self, memory, u, effort, t, dt):
        """Return (pad positions (n,) [m], new memory); effort (n,) [N] is that at memory.pad."""
        chosen = chosen_actuators(self.actuators, len(u), self.spec.name)
        stiffness = _learned(memory.stiffness, chosen * memory.move, effort - memory.effort)
        there = effort + stiffness * (u - memory.pad)
        give = self.compliance * there / (1.0 + self.compliance * stiffness)
        y = np.where(chosen, u - give, u)
        return y, ComplianceMemory(y.copy(), y - memory.pad, np.array(effort), stiffness)


def _learned(stiffness, move, change):
    """Stiffness [N/m] by which the forces changed, `change` (n,), as the pads moved, (n,)."""
    work, square = float(move @ change), float(move @ move)
    if work <= 0.0 or square < _SHORTEST**2:
        return stiffness
    return max(work / square, 0.5 * stiffness)
