"""Between the manipulator and whoever asks: control period, running means, relative goals."""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.control.goal import GoalKind
from arm_brachy.control.loop import Mode
from arm_brachy.control.reach import closest_reachable
from arm_brachy.control.safety import Permission
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.session import RUN_AGAIN

AVERAGED = 1.0  # s of samples whose mean is where a target is taken to be when a goal is set


@dataclass(frozen=True)
class Answer:
    """What is said to who set a goal. World frame [m].

    start : where the target is believed to be;  reference : the goal as understood
    closest : nearest point that pushing can reach;  feasible : it is the goal itself
    """

    start: np.ndarray
    reference: np.ndarray
    closest: np.ndarray
    feasible: bool
    message: str


class Pursuit:
    """Feeds a Manipulator at its control period and turns relative goals into absolute ones.

    A displacement is counted from the mean of the last second of samples of the target, so that
    an offset between tracker and model frame does not enter; in open loop, where nothing measured
    may enter, from the model's rest position.
    """

    def __init__(self, manipulator, model, tools, strokes, names):
        """Start without a goal.

        manipulator, model : Manipulator and the TargetModel it uses
        tools : names of targets that carry a sensor;  strokes : (p,) [m];  names : p pad names
        """
        self._manipulator, self._model = manipulator, model
        self._period = manipulator.params.mpc.period
        self._stale_after = manipulator.params.stale_after
        self._open_loop = manipulator.params.loop == 'open'
        self._strokes, self._names = strokes, names
        self._recent = {tool: deque() for tool in tools}
        self._fresh = {tool: [] for tool in tools}
        self._q, self._due, self._now, self.active = None, None, -np.inf, False
        self._permission, self._reason = Permission.RUN, ''

    @property
    def target(self):
        """Name of the target that is tracked."""
        return self._manipulator.target

    @property
    def gated(self):
        """How many samples of targets were not believed; see pose_gate."""
        return self._manipulator.gate.gated

    def hear(self, tool, t, position):
        """Take one sample of a tool at time t [s]: position (3,) [m]."""
        recent = self._recent[tool]
        if np.all(np.isfinite(position)):
            recent.append((t, position))
            while recent[0][0] < t - AVERAGED:
                recent.popleft()
        self._fresh[tool].append((t, position))

    def feel(self, q):
        """Take the encoder positions (p,) [m]."""
        self._q = np.array(q, dtype=float)

    def permit(self, permission, reason=''):
        """Take the supervisor's word: whatever is not RUN drops the goal and refuses the next."""
        self._permission, self._reason = permission, reason
        if permission is not Permission.RUN and self.active:
            self._manipulator.abort(Mode.FORBIDDEN, reason)
            self.active = False

    def step(self, t):
        """Return a ManipulatorStep if a control period has passed by t [s], else None."""
        self._now = t
        if self._q is None or (self._due is not None and t < self._due - 1e-6):
            return None
        self._due = (t if self._due is None else self._due) + self._period
        samples = self._fresh[self.target] if self.target in self._fresh else []
        step = self._manipulator.step(t, self._q, samples)
        self._fresh = {tool: [] for tool in self._fresh}
        return step

    def pursue(self, goal):
        """Take a goal and go. Returns Answer.

        Raises CommandRefused for an unknown target, one whose position is not known or no longer,
        and while nothing may move.
        """
        if self._permission is not Permission.RUN:
            raise CommandRefused(f'goal for {goal.target}: the safety state is '
                                 f'{self._permission.name} ({self._reason}); when its cause is '
                                 f'gone, to run again: {RUN_AGAIN}')
        if self._q is None:
            raise CommandRefused(f'goal for {goal.target}: no encoder reading has come yet; '
                                 'start the actuator driver')
        start = self._start(goal.target)
        if goal.kind is GoalKind.DISPLACEMENT and not self._open_loop:
            value = tuple(np.where(goal.mask, start + np.array(goal.value), 0.0))
            goal = replace(goal, value=value, kind=GoalKind.POSITION)
        reference = np.where(goal.mask, goal.position(self._model.rest(goal.target)), start)
        reach = self._reach(goal, reference - start)
        self._manipulator.set_goal(goal)
        self.active = True
        closest = start.copy()
        closest[goal.mask] += reach.displacement
        return Answer(start, reference, closest, reach.feasible,
                      '' if reach.feasible else reach.explanation)

    def _reach(self, goal, displacement):
        """How far pushing from here gets towards a displacement (3,) [m], by the model."""
        state = self._model.evaluate(self._q, goal.target)
        if not state.outcome.ok:
            raise CommandRefused(f'goal for {goal.target}: tissue model: {state.outcome.advice}')
        params = self._manipulator.params
        return closest_reachable(
            state.jacobian[goal.mask], displacement[goal.mask], self._q, self._strokes,
            self._names, retraction=params.mpc.retraction, tolerance=params.tolerance)

    def _start(self, target):
        if self._open_loop:
            return self._model.rest(target)
        recent = self._recent.get(target)
        if recent is None:
            raise CommandRefused(f'goal for {target}: it carries no sensor; those that do: '
                                 + ', '.join(self._recent))
        if not recent:
            raise CommandRefused(f'goal for {target}: its sensor has not been seen yet; '
                                 'start the tracker or bring it into its volume')
        if target == self.target and self._manipulator.gate.contradicted(self._now):
            raise CommandRefused(f'goal for {target}: its samples contradict each other or the '
                                 'pads; look for a second publisher, a swapped or a torn sensor, '
                                 'then call mpc_manipulator/abort')
        age = self._now - recent[-1][0]
        if age > self._stale_after:
            raise CommandRefused(f'goal for {target}: its sensor was last seen {age:.2f} s ago, '
                                 f'allowed {self._stale_after:g} s; bring it back into the volume')
        return np.mean([p for _, p in recent], axis=0)

    def hold(self):
        """Keep the present command and the goal."""
        self._manipulator.hold()

    def abort(self):
        """Drop the goal; no command is given until the next."""
        self._manipulator.abort()
        self.active = False
