"""A probing protocol: prescribed moves of the pads one after another, without feedback."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from arm_brachy.control.move_events import Event, Phase, Status
from arm_brachy.control.moves import legs_of
from arm_brachy.control.safety import Permission
from arm_brachy.control.sequencer import at_home
from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.session import RESUME_OR_CALL, RUN_AGAIN

# A pad further than this [m] from where a leg ended was refused or blocked, and its move is not
# made. Own choice: play, lost steps and lag of a working drive stay below it.
ARRIVED = 1e-3
_SLACK = 1e-9  # s; a tick that falls on the end of a leg is after it, whatever the rounding


class Action(Enum):
    """What is to be done at this step, beside publishing the command if there is one."""

    GO_ON = 'go on'
    HOME = 'home'
    FINISH = 'finish'


class Stage(Enum):
    """Where the protocol stands."""

    AWAITING_HOME = 'awaiting home'
    RESTING_BEFORE = 'resting before'
    MOVING = 'moving'
    HOMING = 'homing'
    RESTING_AFTER = 'resting after'
    FINISHED = 'finished'


@dataclass(frozen=True)
class ProtocolStep:
    """What one step came to.

    command : (p,) [m] where the pads shall be now, None while nothing is commanded
    speed : (p,) [m/s] that each is allowed, the slope of its ramp
    events : Event each;  outcome, message : how it went, for a person
    """

    action: Action
    command: np.ndarray | None
    speed: np.ndarray | None
    events: tuple
    outcome: Outcome
    message: str


class PushProtocol:
    """Walks through moves by the clock of the data; time is explicit.

    It waits until the pads are at home, rests for `settle`, makes the moves, sends the pads home
    and rests as long again: the stretches at both ends show the noise of the sensors.

    A permission that is withdrawn interrupts: nothing is commanded, and what was under way goes on
    only after `resume`, with a straight line from where the pads then are to the end of the leg
    that was interrupted, and its hold in full. Before the first move there is nothing to resume;
    the rest begins anew. Whatever it waits for, after `patience` it gives up; `verdict` says so.

    A ramp that is shorter than a tick is commanded at once, with the speed of the ramp, and only
    its hold is an event.
    Test: control/test_push_protocol.py
    """

    def __init__(self, moves, names, settle, patience=120.0):
        """Start, not yet permitted to move.

        moves : Move each;  names : p pad names;  settle, patience : [s]
        """
        self._moves, self._legs = tuple(moves), legs_of(moves, names)
        self._settle, self._patience = settle, patience
        self._permission, self._reason = Permission.HOLD, 'no word from the supervisor yet'
        self.stage, self.made, self.verdict = Stage.AWAITING_HOME, 0, ''
        self._leg, self._start = 0, np.zeros(len(names))
        self._since, self._waits_since, self._now = None, None, None
        self._held = self._due = False
        self._missed, self._said, self._events = '', None, []

    @property
    def moves_over(self):
        """True once the last move is over."""
        return self.stage in (Stage.HOMING, Stage.RESTING_AFTER, Stage.FINISHED)

    def permit(self, permission, reason=''):
        """Take the supervisor's word; nothing moves unless it is RUN."""
        self._permission, self._reason = permission, reason

    def resume(self):
        """Go on with what was interrupted, from where the pads are.

        Raises CommandRefused if nothing was interrupted, and while nothing may move.
        """
        if not self._held:
            raise CommandRefused('resume: nothing was interrupted')
        if self._permission is not Permission.RUN:
            raise CommandRefused(f'resume: the safety state is {self._permission.name} '
                                 f'({self._reason}); when its cause is gone, to run '
                                 f'again: {RUN_AGAIN}')
        self._held, self._due = False, True

    def step(self, t, q, velocity):
        """Advance to time t [s]; q (p,) [m], velocity (p,) [m/s] : what the encoders say now.

        Returns ProtocolStep. Time must not run backwards.
        """
        self._now, self._events = t, []
        if obstacle := self._obstacle(at_home(q, velocity)):
            return self._wait(obstacle)
        self._waits_since = None
        if self.stage is Stage.HOMING and self._due:
            return self._send_home()
        if self.stage in (Stage.AWAITING_HOME, Stage.HOMING):
            self._arrive_home()
        if self.stage in (Stage.RESTING_BEFORE, Stage.RESTING_AFTER):
            self._rest()
        if self.stage is Stage.MOVING:
            return self._move(np.asarray(q, dtype=float))
        return self._reply()

    def _obstacle(self, home):
        """Why nothing can go on now, in one line; '' if it can."""
        if self.stage in (Stage.RESTING_AFTER, Stage.FINISHED):
            return ''
        if self._permission is not Permission.RUN:
            self._held |= self.stage in (Stage.MOVING, Stage.HOMING)
            return f'the safety state is {self._permission.name} ({self._reason})'
        if self._held:
            return f'interrupted; to go on: {RESUME_OR_CALL}'
        if self.stage in (Stage.AWAITING_HOME, Stage.HOMING) and not (home or self._due):
            return 'the pads are not at home'
        return ''

    def _wait(self, why):
        """Command nothing; give up when it has lasted too long."""
        if self._waits_since is None:
            self._waits_since = self._now
        if self.stage is Stage.RESTING_BEFORE:
            self._since = self._now
        if self._held:
            self._say(Status.IDLE, *self._place(), Phase.HELD.value)
        if self._now - self._waits_since > self._patience:
            left = len(self._moves) - self.made
            self._finish(f'cut short after {self._patience:g} s of waiting: {why}; {left} of '
                         f'{len(self._moves)} moves not made')
        return self._reply(Outcome.HELD if self._held else Outcome.OK, why if self._held else '')

    def _arrive_home(self):
        before = self.stage is Stage.AWAITING_HOME
        self.stage = Stage.RESTING_BEFORE if before else Stage.RESTING_AFTER
        self._since = self._now
        self._say(Status.IDLE, 0 if before else len(self._moves) - 1, '', Phase.REST.value)

    def _rest(self):
        if self._now - self._since < self._settle - _SLACK:
            return
        if self.stage is Stage.RESTING_BEFORE:
            self.stage, self._since = Stage.MOVING, self._now
        else:
            left = len(self._moves) - self.made
            self._finish(f'{left} of {len(self._moves)} moves not made' if left else '')

    def _move(self, q):
        if self._due:
            self._due, self._start, self._since = False, q, self._now
        while self._leg < len(self._legs) and self._now >= self._leg_ends() - _SLACK:
            self._end_leg(q)
        if self._leg == len(self._legs):
            self.stage = Stage.HOMING
            return self._send_home()
        leg, elapsed = self._legs[self._leg], self._now - self._since
        self._say(Status.ACTIVE, *self._place(), self._phase(leg, elapsed).value)
        return self._reply(command=leg.at(self._start, elapsed), speed=leg.speeds(self._start))

    def _leg_ends(self):
        leg = self._legs[self._leg]
        return self._since + leg.lasts(self._start) + leg.hold

    def _place(self):
        """Index and name of the move under way; no name between moves."""
        if self._leg == len(self._legs):
            return len(self._moves) - 1, ''
        return self._legs[self._leg].move, self._legs[self._leg].name

    def _phase(self, leg, elapsed):
        if elapsed >= leg.lasts(self._start) - _SLACK:
            return Phase.HOLD if (leg.target > 0.0).any() else Phase.REST
        inward, outward = (leg.target > self._start).any(), (leg.target < self._start).any()
        if inward and outward:
            return Phase.EXCHANGE
        return Phase.LOAD if inward else Phase.UNLOAD

    def _end_leg(self, q):
        leg = self._legs[self._leg]
        short = np.abs(q - leg.target).max()
        if short > ARRIVED and not self._missed:
            self._missed = (f'a pad stands {1e3 * short:.1f} mm from where it was sent; see what '
                            'actuator_driver reported')
        if leg.last:
            self.made += not self._missed
            self._say(Status.REFUSED if self._missed else Status.DONE, leg.move, leg.name,
                      self._missed)
            self._missed = ''
        self._since, self._start, self._leg = self._leg_ends(), leg.target, self._leg + 1

    def _send_home(self):
        self._due = False
        self._say(Status.HOMING, len(self._moves) - 1)
        return self._reply(action=Action.HOME)

    def _finish(self, verdict):
        self.stage, self.verdict, self._held = Stage.FINISHED, verdict, False
        self._say(Status.FINISHED, len(self._moves) - 1, '', verdict)

    def _say(self, status, index, name='', message=''):
        """Note an event, once for as long as it lasts."""
        what = (status, index, name, message, self._leg)
        if what != self._said:
            self._said = what
            self._events.append(Event(self._now, status, index, name, message))

    def _reply(self, outcome=Outcome.OK, message='', *, command=None, speed=None,
               action=Action.GO_ON):
        if self.stage is Stage.FINISHED:
            action = Action.FINISH
        return ProtocolStep(action, command, speed, tuple(self._events), outcome, message)
