"""Target manipulation: goals in, pad commands out; the loop of fig. 3.3."""

from collections import deque
from dataclasses import replace

import numpy as np

from arm_brachy.control.command_log import CommandLog
from arm_brachy.control.loop import ManipulatorParams, ManipulatorStep, Mode
from arm_brachy.control.mpc import Mpc
from arm_brachy.control.observer import DisturbanceObserver
from arm_brachy.control.pose_gate import PoseGate
from arm_brachy.control.reach import closest_reachable
from arm_brachy.control.stillness import Stillness
from arm_brachy.core.errors import CommandRefused, NotConverged
from arm_brachy.core.outcome import Outcome

__all__ = ['Manipulator', 'ManipulatorParams', 'ManipulatorStep', 'Mode']

# Encoder differences below a micrometre move no target: the model's answer is kept.
_SAME_TRAVEL = 1e-6
# Model positions kept to compare late samples with: more than a second at any sensible period.
_TRACK_LENGTH = 128


class Manipulator:
    """Observer, model and MPC as one object with explicit time; no thread, no clock of its own."""

    def __init__(self, params, model, strokes, max_speed, names):
        """Start idle, at whatever travel the first step reports.

        params : ManipulatorParams;  model : TargetModel;  strokes : (p,) [m]
        max_speed : (p,) or scalar [m/s];  names : p pad names
        """
        self.params = params
        self.mpc = Mpc(params.mpc, strokes, max_speed)
        self.observer = DisturbanceObserver(params.observer)
        self.gate = PoseGate(params.gate)
        self.stillness = Stillness(params.stillness)
        self._model, self._names = model, tuple(names)
        self._strokes = np.asarray(strokes, dtype=float)
        self._lead = self._largest_lead(params, max_speed)
        self._target, self._goal, self._mode = model.targets[0], None, Mode.IDLE
        self._command, self._restart, self._why = None, False, ''
        self._forget_motion()

    @staticmethod
    def _largest_lead(params, max_speed):
        """Travel [m] by which a command may lead the encoders: all that can be under way.

        Beyond it the pads do not follow (held, blocked, refused), and a command that went on
        growing would be made up for in one jump. In open loop nothing measured may enter.
        """
        if params.loop == 'open':
            return np.inf
        return np.asarray(max_speed) * (params.actuator_delay + params.mpc.period)

    @property
    def target(self):
        """Name of the target that is tracked, the first of the model before any goal."""
        return self._target

    @property
    def goal(self):
        """The goal in force, or None."""
        return self._goal

    @property
    def is_open_loop(self):
        """True if the model's prediction stands for the measurement."""
        return self.params.loop == 'open'

    def rest(self, target):
        """Position (3,) [m] where the model has a target with no pad pushing.

        target : name.  Raises CommandRefused if the model does not have it.
        """
        self._check(target)
        return self._model.rest(target)

    def preview(self, goal, q, start):
        """Return the Reach of a goal from here, linearised, without going there.

        goal : Goal;  q : (p,) [m] pad travel now;  start : (3,) [m] where its target is believed
        to be. Raises CommandRefused for an unknown target, NotConverged if the model fails at q.
        """
        rest = self.rest(goal.target)
        state = self._model.evaluate(np.asarray(q, dtype=float), goal.target)
        if not state.outcome.ok:
            raise NotConverged(f'tissue model at pad travel {q}: {state.outcome.advice}')
        error = (goal.position(rest) - start)[goal.mask]
        return self._reach(state.jacobian[goal.mask], error, q)

    def set_goal(self, goal):
        """Take a new goal and go. Raises CommandRefused for a target the model does not have."""
        self._check(goal.target)
        if goal.target != self._target:
            self._target = goal.target
            self.observer.reset()
            self.gate.reset()
            self._forget_motion()
        # Whatever moved the pads in the meantime, the new goal starts from where they are.
        self._restart |= self._mode in (Mode.IDLE, Mode.ABORTED, Mode.FORBIDDEN)
        self._goal, self._mode = goal, Mode.ACTIVE
        self.stillness.reset()
        self.mpc.reset()

    def hold(self):
        """Keep the present command; `resume` goes on with the same goal."""
        self._mode = Mode.HOLD

    def resume(self):
        """Go on after `hold`. Raises CommandRefused if there is no goal to go on with."""
        if self._goal is None:
            raise CommandRefused('resume: there is no goal to go on with; set one')
        self._mode = Mode.ACTIVE

    def abort(self, why=Mode.ABORTED, reason=''):
        """Drop the goal and stop the pads where the next step finds them.

        why : Mode.ABORTED, which is what was asked for and no trouble, or Mode.FORBIDDEN
        reason : of who forbids, in one line
        """
        self._goal, self._mode, self._restart, self._why = None, why, True, reason
        if self.gate.suspicious:    # who aborts has looked: the next sample is taken as it is
            self.observer.reset()
            self.gate.reset()

    def step(self, t, q_measured, target_samples=()):
        """Advance to time t [s].

        q_measured : (p,) [m] encoder travel along each push direction, at t
        target_samples : (time [s], position (3,) [m]) of the tracked target since the last step;
            a sample that is not finite or not newer than the last is refused and named
        Returns ManipulatorStep. Expected trouble holds the command and says so in `outcome`.
        """
        q = np.asarray(q_measured, dtype=float)
        if q.shape != self._strokes.shape or not np.all(np.isfinite(q)):
            return self._blind(t, Outcome.REJECTED, f'pad travel {q} is not {len(self._strokes)} '
                               'finite numbers; the command is held')
        self._restart_if_asked(t, q)
        state = self._evaluate(q)
        if not state.outcome.ok:
            return self._blind(t, state.outcome, f'tissue model: {state.outcome.advice}')
        self._track.append((t, state.position))
        refused = self._take(target_samples) if not self.is_open_loop else ''
        step = self._decide(self._picture(t, q, state), q)
        self._command = step.command
        self._log.append(t, self._command)
        if refused and step.outcome.ok:
            step = replace(step, outcome=Outcome.REJECTED, message=refused)
        self._last = step
        return step

    def _check(self, target):
        if target not in self._model.targets:
            raise CommandRefused(f'goal: target {target!r}; must be one of '
                                 f'{", ".join(self._model.targets)}')

    def _forget_motion(self):
        """Drop all that belongs to the target tracked so far."""
        self._track = deque(maxlen=_TRACK_LENGTH)
        self._log = CommandLog(self.params.actuator_delay)
        self._evaluated = self._last = None

    def _restart_if_asked(self, t, q):
        """Command what the pads have: at first, after an abort, before a goal after either."""
        if self._command is None or self._restart:
            self._command = np.clip(q, 0.0, self._strokes)
            self._log = CommandLog(self.params.actuator_delay)
            self._log.append(t, self._command)
            self._restart = False

    def _evaluate(self, q):
        """Model at the encoders; in open loop at the commands, for nothing measured may enter."""
        travel = self._command if self.is_open_loop else q
        known = self._evaluated
        if known is None or np.max(np.abs(known[0] - travel)) > _SAME_TRAVEL:
            state = self._model.evaluate(travel, self._target)
            if not state.outcome.ok:
                return state
            self._evaluated = known = (travel.copy(), state)
        return known[1]

    def _take(self, samples):
        """Feed the observer; returns what was refused, in one line ('' = nothing)."""
        times = [t for t, _ in self._track]
        track = np.array([x for _, x in self._track])
        refused = []
        for t, y in samples:
            last = self.observer.last_time
            if not (np.isfinite(t) and np.all(np.isfinite(y))):
                refused.append(f'{t:.3f} s: not finite')
            elif last is not None and t <= last:
                refused.append(f'{t:.3f} s: not newer than {last:.3f} s')
            else:
                model = np.array([np.interp(t, times, axis) for axis in track.T])
                y = np.asarray(y, dtype=float)
                far = self.gate.refusal(t, *self.observer.surprise(t, y, model))
                if far and not self.gate.has_moved(t):
                    refused.append(f'{t:.3f} s: {far}')
                elif far:
                    self._start_anew(t, y, model)
                else:
                    self.observer.update(t, y, model)
        return f'target sample refused ({"; ".join(refused)})' if refused else ''

    def _start_anew(self, t, y, model):
        """One source that jumped and stays is believed again."""
        self.observer.reset()
        self.gate.reset()
        self.observer.update(t, y, model)

    def _picture(self, t, q, state):
        """All that is known before deciding, with the command held."""
        closed = not self.is_open_loop
        d = self.observer.disturbance if closed else np.zeros(3)
        estimate = state.position + d
        reference = self._reference(estimate)
        error = reference - estimate
        pending = self._log.pending(t, q) if closed else np.zeros_like(q)
        reached = self._goal is not None and np.all(np.abs(error) <= self.params.tolerance)
        return ManipulatorStep(
            t=t, command=self._command.copy(), outcome=Outcome.OK, reference=reference,
            estimate=estimate, disturbance=d.copy(), sd=self.observer.sd if closed else 0.0,
            jacobian=state.jacobian.copy(), error=error, pending=pending, reached=bool(reached))

    def _reference(self, estimate):
        """Goal (3,) [m]; on free axes, and without a goal, where the target is anyway."""
        if self._goal is None:
            return estimate
        return np.where(self._goal.mask, self._goal.position(self.rest(self._target)), estimate)

    def _decide(self, now, q):
        """Turn the picture into a command, or hold and say why."""
        if self._mode in (Mode.HOLD, Mode.FORBIDDEN):
            said = self._mode.value + (f': {self._why}' if self._why else '')
            return replace(now, outcome=Outcome.HELD, message=said)
        if self._goal is None:
            return now
        if not self.is_open_loop and self._stale(now.t):
            return replace(now, outcome=Outcome.STALE_INPUT, message=self._age(now.t))
        if self.gate.contradicted(now.t):
            return replace(now, outcome=Outcome.REJECTED, message='samples of target '
                           f'{self._target} contradict each other or the pads, {self.gate.gated} '
                           'gated so far; the pads hold: look for a second publisher, a swapped '
                           'or a torn sensor')
        now = self._with_reach(now)
        if not now.reach.feasible:
            now = replace(now, outcome=Outcome.INFEASIBLE, message=now.reach.explanation)
            if not self.params.go_to_closest:
                return now
        error = self._error_to_act_on(now)
        if error is None:
            return replace(now, settled=self.stillness.resting)
        return self._pushed(now, error, q)

    def _with_reach(self, now):
        on = self._goal.mask
        reach = self._reach(now.jacobian[on], now.error[on], self._command - now.pending)
        closest = now.estimate.copy()
        closest[on] += reach.displacement
        return replace(now, reach=reach, closest=closest)

    def _reach(self, J, error, q):
        return closest_reachable(J, error, q, self._strokes, self._names,
                                 retraction=self.params.mpc.retraction,
                                 tolerance=self.params.tolerance)

    def _stale(self, t):
        last = self.observer.last_time
        return last is None or t - last > self.params.stale_after

    def _age(self, t):
        last = self.observer.last_time
        said = 'none was received yet' if last is None else f'the last is {t - last:.2f} s old'
        return (f'no fresh sample of target {self._target}: {said}; must be within '
                f'{self.params.stale_after:g} s: look at its tracker or estimator')

    def _error_to_act_on(self, now):
        """Error (3,) [m] that merits a push beyond the travel pending, or None to keep still."""
        error = np.where(self._goal.mask, now.error - now.jacobian @ now.pending, 0.0)
        if self.stillness.keeps_still(now.t, self._attainable(now, error), now.sd):
            return None
        error = self.stillness.cautious(error, now.sd)
        return None if self.stillness.pauses(now.t, self._attainable(now, error)) else error

    def _attainable(self, now, error):
        """Largest part [m] of the error on one axis that the pads could still remove."""
        on = self._goal.mask
        return np.abs(self._reach(now.jacobian[on], error[on], self._command).displacement).max()

    def _pushed(self, now, error, q):
        plan = self.mpc.step(error, now.jacobian, self._command, self._goal.mask)
        if not plan.outcome.ok:
            return replace(now, outcome=plan.outcome,
                           message=f'MPC: {plan.outcome.advice}; the command is held')
        command = np.clip(self._command + plan.push, q - self._lead, q + self._lead)
        command = np.clip(command, 0.0, self._strokes)
        return replace(now, command=command)

    def _blind(self, t, outcome, message):
        """Step without a usable model state: everything as it was, the command held."""
        p = len(self._strokes)
        held = np.full(p, np.nan) if self._command is None else self._command.copy()
        if self._last is not None:
            return replace(self._last, t=t, command=held, outcome=outcome, message=message,
                           settled=False)
        unknown = np.full(3, np.nan)
        return ManipulatorStep(
            t=t, command=held, outcome=outcome, reference=unknown, estimate=unknown,
            disturbance=np.zeros(3), sd=np.inf, jacobian=np.full((3, p), np.nan), error=unknown,
            pending=np.zeros(p), message=message)
