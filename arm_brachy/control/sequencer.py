"""The clinician's side as a schedule: rest, set a goal, wait, send the pads home, next task."""

from enum import Enum


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

    tasks : sequence with `.duration` [s];  settle : rest [s] before each task
    A homing that does not end within `homing_limit` [s] ends the sequence.
    """

    def __init__(self, tasks, settle, homing_limit=120.0):
        self._tasks, self._settle, self._limit = tuple(tasks), settle, homing_limit
        self.index = 0
        self.phase = Phase.SETTLING if self._tasks else Phase.FINISHED
        self._since = None

    def step(self, t, at_home):
        """Return the Action at time t [s]; at_home: all pads are retracted and at rest."""
        if self._since is None:
            self._since = t
        elapsed = t - self._since
        if self.phase is Phase.SETTLING:
            return self._enter(Phase.ACTIVE, t, Action.SET_GOAL) if elapsed >= self._settle \
                else Action.WAIT
        if self.phase is Phase.ACTIVE:
            over = elapsed >= self._tasks[self.index].duration
            return self._enter(Phase.HOMING, t, Action.RELEASE) if over else Action.WAIT
        if self.phase is Phase.HOMING and (at_home or elapsed > self._limit):
            return self._after_homing(t, at_home)
        return Action.FINISH if self.phase is Phase.FINISHED else Action.WAIT

    def _after_homing(self, t, at_home):
        self.index += 1
        if self.index < len(self._tasks) and at_home:
            return self._enter(Phase.SETTLING, t, Action.WAIT)
        return self._enter(Phase.FINISHED, t, Action.FINISH)

    def _enter(self, phase, t, action):
        self.phase, self._since = phase, t
        return action
