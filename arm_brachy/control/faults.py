"""Faults for a campaign against a cell's drives, drawn by a seed: what strangers and machines do.

Every fault asks for motion that nobody allowed, or takes away what motion depends on. Whatever
comes, four things must hold: no pad and no needle leaves the range that its controller asked for,
what lost its permission rests within PX4's figure for a lost link, nothing forged is obeyed, and
the nodes live on.
"""

from dataclasses import dataclass
from enum import Enum
from itertools import islice

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
    FORGED_SERVICES = 'home, release and reset without the key under a hold'
    CYCLED = 'driver and supervisor taken down and up again under an emergency stop'
    TRANSITIONS = 'transitions of driver and supervisor while pads move'
    FORGED_GOAL = 'goals by service and by action without a ticket of theirs'
    FORGED_SENSOR = 'a stranger among the encoders'
    FORGED_NEEDLE = 'needle commands without the key, and recorded ones again'
    FORGED_FOLLOW = 'a probe that is told to follow and released without the key'
    FORGED_IMAGE = 'a stranger among the needle tips and probe poses'
    NEEDLE_ALONE = 'a supervisor that falls silent while needle and probe move'
    DEAD_NEEDLE = 'a needle driver that dies while the probe moves'
    DEAD_PROBE = 'a probe controller that dies while the needle moves'


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


# Of needle and probe, which have a bench of their own; the others are of the pads.
OF_THE_NEEDLE = (Kind.FORGED_NEEDLE, Kind.FORGED_FOLLOW, Kind.FORGED_IMAGE, Kind.NEEDLE_ALONE,
                 Kind.DEAD_NEEDLE, Kind.DEAD_PROBE)


def draw(n, seed):
    """n Faults: every kind in turn, in an order and with sizes that follow from the seed.

    The first faults of a longer campaign are those of a shorter one.
    """
    return list(islice(_drawn(seed), n))


def _drawn(seed):
    rng, kinds = stream(seed, 'faults'), list(Kind)
    while True:
        for k in rng.permutation(len(kinds)):
            yield Fault(kinds[k], int(rng.integers(1, 20)), float(rng.random()))
