"""Faults for a campaign against a cell's drives, drawn by a seed: what strangers and machines do.

Every fault asks for motion that nobody allowed, or takes away what motion depends on. Whatever
comes, three things must hold: no pad leaves the range that its controller asked for, a pad that
lost its permission rests within PX4's figure for a lost link, and the nodes live on.
"""

from dataclasses import dataclass
from enum import Enum

from arm_brachy.core.quantity import quantity
from arm_brachy.core.random import stream


class Kind(Enum):
    """What is done; the value says it to a person."""

    FORGED = 'commands without the key'
    OTHER_KEY = 'commands sealed with another key'
    REPLAYED = 'recorded commands sent again'
    TAMPERED = 'recorded commands with one byte changed'
    FLOODED = 'a burst of commands without the key'
    PAST = 'commands of a clock that is behind'
    FUTURE = 'commands of a clock that is ahead'
    FOREIGN_FRAME = 'commands in another frame'
    UNKNOWN_MODE = 'commands in an unknown mode'
    NOT_FINITE = 'commands that are not finite'
    FORGED_RUN = 'RUN and a release without the key under an emergency stop'
    FORGED_STATE = 'encoders forged under a hold'
    FROZEN_SUPERVISOR = 'a supervisor that falls silent'
    CUT_STREAM = 'a controller that falls silent'


@dataclass(frozen=True)
class Bounds:
    """What must hold, whatever comes."""

    overshoot: float = quantity(0.1, 'mm', 'way of a pad outside the range asked for', low=0.0,
                                source='eight counts of the default encoder')
    rest: float = quantity(1.0, 's', 'from the end of a permission until pads rest, wall pace',
                           low=0.0, source='PX4: COM_RC_LOSS_T and COM_OF_LOSS_T, 0.5 to 1 s')


@dataclass(frozen=True)
class Fault:
    """One fault: kind, number of messages, size. size : share of the kind's range, 0 to 1."""

    kind: Kind
    count: int
    size: float


def draw(n, seed):
    """n Faults: every kind in turn, in an order and with sizes that follow from the seed."""
    rng, kinds = stream(seed, 'faults'), list(Kind)
    drawn = [kinds[i % len(kinds)] for i in range(n)]
    rng.shuffle(drawn)
    return [Fault(kind, int(rng.integers(1, 20)), float(rng.random())) for kind in drawn]
