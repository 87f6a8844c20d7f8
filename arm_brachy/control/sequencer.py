"""The clinician's side as a schedule: rest, set a goal, wait, send the pads home, next task."""

from enum import Enum

import numpy as np

# A pad whose encoder reads less [m] is at home: 16 counts of the L16's position sensor.
HOME = 0.2e-3
# And one that moves slower than this [m/s] is at rest. Speeds are differences of encoder counts:
# one count of 0.0122 mm in a tick of 50 ms reads as 0.244 mm/s and may be flicker, two are motion.
REST = 0.3e-3


def at_home(q, velocity):
    """True if all pads are retracted and at rest, by their encoders: (p,) [m], (p,) [m/s]."""
    return bool(np.all(np.asarray(q) < HOME) and np.all(np.abs(velocity) < REST))


class Phase(Enum):
    """Where the sequence stands."""

    SETTLING = 'settling'
    ACTIVE = 'active'
    HOMING = 'homing'
    FINISHED = 'finished'


class Action(Enum):
    """What the operator does at this step."""

    WAIT = 'wait'
    SET_GOAL = 'set_goal'
    RELEASE = 'release'    # the task's time is over: abort the goal, send the pads home
    FINISH = 'finish'


class Sequencer:
    """Walks through tasks by the clock of the data; it looks at nothing but time and `at_home`.

    tasks : sequence with `.duration` [s];  settle : rest [s] before each task, all there is
        without one
    A homing that does not end within `homing_limit` [s] ends the sequence; `verdict` says so.
    index : of the task;  phase : Phase;  verdict : one line once FINISHED, '' if nothing was left
    out
    """

    def __init__(self, tasks, settle, homing_limit=120.0):
        self._tasks, self._settle, self._limit = tuple(tasks), settle, homing_limit
        self.index = 0
        self.phase = Phase.SETTLING
        self._since, self.verdict = None, ''

    def step(self, t, at_home):
        """Return the Action at time t [s]; at_home: all pads are retracted and at rest."""
        if self._since is None:
            self._since = t
        elapsed = t - self._since
        if self.phase is Phase.SETTLING:
            return Action.WAIT if elapsed < self._settle else self._after_settling(t)
        if self.phase is Phase.ACTIVE:
            over = elapsed >= self._tasks[self.index].duration
            return self._enter(Phase.HOMING, t, Action.RELEASE) if over else Action.WAIT
        if self.phase is Phase.HOMING and (at_home or elapsed > self._limit):
            return self._after_homing(t, at_home)
        return Action.FINISH if self.phase is Phase.FINISHED else Action.WAIT

    def _after_settling(self, t):
        if not self._tasks:
            return self._enter(Phase.FINISHED, t, Action.FINISH)
        return self._enter(Phase.ACTIVE, t, Action.SET_GOAL)

    def _after_homing(self, t, at_home):
        self.index += 1
        if self.index < len(self._tasks) and at_home:
            return self._enter(Phase.SETTLING, t, Action.WAIT)
        if not at_home:
            self.verdict = (f'cut short: the pads were not at home within {self._limit:g} s; '
                            f'{len(self._tasks) - self.index} of {len(self._tasks)} tasks not '
                            'begun; look at the actuators')
        return self._enter(Phase.FINISHED, t, Action.FINISH)

    def _enter(self, phase, t, action):
        self.phase, self._since = phase, t
        return action
