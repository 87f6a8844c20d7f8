"""What the arm that holds the probe is doing, for those who control it and those who wait."""

from enum import IntEnum


class ProbePhase(IntEnum):
    """Values of arm_brachy_msgs/ProbeState.phase; what they mean: robot.probe_phases."""

    IDLE = 0
    APPROACH = 1
    FOLLOW = 2
    HOLD = 3
    RETRACT = 4
    STOPPED = 5
