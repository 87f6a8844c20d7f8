"""What a probing protocol says of itself: which move, which phase of it, since when."""

from dataclasses import dataclass
from enum import Enum, IntEnum


class Status(IntEnum):
    """Values of arm_brachy_msgs/TaskState.state."""

    IDLE = 0
    HOMING = 1
    ACTIVE = 2
    DONE = 3
    REFUSED = 4
    FINISHED = 5


class Phase(Enum):
    """What the pads are told to do, in the words of `evaluation.regimes` (but for HELD)."""

    REST = 'rest'
    LOAD = 'load'
    HOLD = 'hold'
    UNLOAD = 'unload'
    EXCHANGE = 'exchange'   # some in, some out
    HELD = 'held'           # interrupted; the pads stand where they were stopped


@dataclass(frozen=True)
class Event:
    """Something that began or ended at time t [s].

    index, name : of the move, '' outside of moves
    message : the Phase that begins; of REFUSED and FINISHED what went wrong, '' if nothing did
    """

    t: float
    status: Status
    index: int
    name: str = ''
    message: str = ''
