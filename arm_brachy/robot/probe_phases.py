"""What the probe's arm is doing, and what makes it do something else. No geometry, no time steps.

    IDLE      stands still                        follow -> APPROACH
    APPROACH  to a point over the skin, then along the axis until touch -> FOLLOW
    FOLLOW    in contact, the image plane on the tip
    HOLD      stands still; the contact force is kept where there is contact
    RETRACT   along the axis off the skin, then home -> IDLE, after a stop -> STOPPED
    STOPPED   brakes, then retracts, then waits for release; so after a limit passed in the air
A fault names its outcome, which stays until the next `follow` or `release`.
"""

from dataclasses import dataclass

from arm_brachy.core.errors import CommandRefused
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.probe_phase import ProbePhase as Phase
from arm_brachy.core.session import RUN_AGAIN

_LONGEST_WAY = 3.0               # s off the skin, where the end of the way cannot be reached
RUN, HELD, STOP = range(3)       # values of SafetyState.state
NOT_A_NUMBER = 5                 # code of a trip, after those of arm_loop
_TRIPS = {1: 'limit of force passed', 2: 'limit of speed passed', 3: 'limit of place passed',
          4: 'limit of angle or speed of a joint passed',
          NOT_A_NUMBER: 'the contact wrench is not a number'}


@dataclass(frozen=True)
class Situation:
    """What the arm knows at the beginning of a tick.

    t : [s];  tip_age : [s] since the tip was heard of, None = never
    in_contact : bool
    clear : the way off the skin is done;  arrived : the arm is at home
    below : [m] that the probe is below the skin as planned;  plan : probe_planner.Plan or None
    depth_fault : why the tip is not in the image, '' if it is
    """

    t: float
    tip_age: float | None
    in_contact: bool
    clear: bool
    arrived: bool
    below: float
    plan: object
    depth_fault: str


class Phases:
    """The state machine; `advance` once a tick, the rest when asked."""

    def __init__(self, params):
        """params : ProbeArmParams"""
        self._params = params
        self.phase = Phase.IDLE
        self.outcome, self.message = Outcome.OK, ''
        self.clear = True                # off the skin: RETRACT goes home now
        self._permission, self._reason = HELD, 'no word from the supervisor yet'
        self._since = {}                 # when something began, by name
        self._stopping = False           # RETRACT ends in STOPPED
        self._t = 0.0

    def permit(self, permission, reason):
        """Take what the supervisor allows: RUN, HELD or STOP, and why."""
        self._permission, self._reason = int(permission), reason
        if self._permission == STOP and not self._stopping:
            self._stop(reason)
        elif self._permission == HELD and self.phase in (Phase.APPROACH, Phase.FOLLOW):
            self._enter(Phase.HOLD, Outcome.HELD, reason)

    def follow(self):
        """Begin to follow the tip. Raises CommandRefused where that is not allowed."""
        self._refuse_unless_running('follow')
        if self.phase not in (Phase.APPROACH, Phase.FOLLOW):
            if self.phase not in (Phase.IDLE, Phase.HOLD):
                raise CommandRefused(f'probe: {self.phase.name}; must be IDLE or HOLD to follow: '
                                     'wait, or release it after a stop')
            self._enter(Phase.APPROACH, Outcome.OK, '')

    def hold(self):
        """Stand still where the probe is."""
        if self.phase in (Phase.APPROACH, Phase.FOLLOW):
            self._enter(Phase.HOLD, Outcome.HELD, 'held on request')

    def retract(self):
        """Leave the skin and go home. Raises CommandRefused after a stop."""
        if self.phase is Phase.STOPPED:
            raise CommandRefused('probe: STOPPED; release it first')
        if self.phase is not Phase.RETRACT:
            self._enter(Phase.RETRACT, Outcome.OK, '')

    def release(self):
        """End a stop. Raises CommandRefused while the supervisor does not let it run."""
        self._refuse_unless_running('release')
        if self._stopping and not (self.phase is Phase.STOPPED and self.clear):
            raise CommandRefused('probe: still on its way off the skin; release it then')
        self._stopping = False
        if self.phase is Phase.STOPPED:
            self._enter(Phase.IDLE, Outcome.OK, '')
        self.outcome, self.message = Outcome.OK, ''

    def _refuse_unless_running(self, what):
        if self._permission != RUN:
            raise CommandRefused(f'probe: {what} while the safety state is not RUN '
                                 f'({self._reason}); to run again: {RUN_AGAIN}')

    def advance(self, now):
        """Take a Situation; phase, outcome and message follow."""
        self._t = now.t
        step = getattr(self, f'_in_{self.phase.name.lower()}', None)
        if step is not None:
            step(now)

    def trip(self, code):
        """A limit was passed within the tick; code as in arm_loop, or NOT_A_NUMBER.

        At home or on the way there nothing is left to retract from: something else pushes.
        """
        outcome = Outcome.REJECTED if code == NOT_A_NUMBER else Outcome.LIMIT_PASSED
        if self.phase in (Phase.APPROACH, Phase.FOLLOW, Phase.HOLD):
            self._enter(Phase.RETRACT, outcome, f'{_TRIPS[code]}; the probe retracts')
        elif self.phase is Phase.IDLE or (self.phase is Phase.RETRACT and self.clear):
            self._stopping, self.clear = True, True
            self._enter(Phase.STOPPED, outcome, f'{_TRIPS[code]}; the arm brakes; look what '
                        'pushes it, then release it')

    def _in_approach(self, now):
        if self._lost_sight(now) or self._too_deep(now):
            return
        if self._lasts('touch', now.in_contact, now.t, self._params.rise):
            self._enter(Phase.FOLLOW, self.outcome, self.message)

    def _in_follow(self, now):
        if self._lost_sight(now) or self._too_deep(now):
            return
        if self._lasts('lost', not now.in_contact, now.t, self._params.lost_patience):
            self._enter(Phase.RETRACT, Outcome.NO_CONTACT, 'contact was lost and not found again')
        elif now.depth_fault and not now.plan.waiting:
            self.outcome, self.message = Outcome.OUT_OF_IMAGE, now.depth_fault
        elif self.outcome is Outcome.OUT_OF_IMAGE:
            self.outcome, self.message = Outcome.OK, ''

    def _lost_sight(self, now):
        """Faults of the tip and of the plan; True if the phase has ended."""
        if now.tip_age is None or now.tip_age > self._params.tip_patience:
            heard = ('never heard of' if now.tip_age is None
                     else f'last heard of {now.tip_age:.1f} s ago')
            self._enter(Phase.RETRACT, Outcome.STALE_INPUT, f'needle/tip: {heard}; must be within '
                        f'{self._params.tip_patience:g} s: look at needle_driver')
        elif now.plan is not None and not now.plan.outcome.ok:
            self._enter(Phase.HOLD, now.plan.outcome, now.plan.message)
        return self.phase not in (Phase.APPROACH, Phase.FOLLOW)

    def _too_deep(self, now):
        """No skin where it was expected, or too soft a one; True if the phase has ended."""
        params = self._params
        if not now.in_contact and now.below > params.search:
            self._enter(Phase.RETRACT, Outcome.NO_CONTACT, f'no skin within '
                        f'{1e3 * params.search:g} mm below where it was expected')
        elif now.in_contact and now.below > params.deepest:
            self._enter(Phase.RETRACT, Outcome.LIMIT_PASSED, f'{1e3 * now.below:.0f} mm into the '
                        f'skin; must be at most {1e3 * params.deepest:g} mm')
        return self.phase is Phase.RETRACT

    def _in_hold(self, now):
        if self._too_deep(now):
            return
        if self._lasts('held', self._permission == HELD, now.t, self._params.hold_patience):
            self._enter(Phase.RETRACT, Outcome.HELD, f'held for {self._params.hold_patience:g} s '
                        f'({self._reason}); the probe retracts')

    def _in_retract(self, now):
        if now.clear or self._lasts('way', not now.in_contact, now.t, _LONGEST_WAY):
            self.clear = True
        if self.clear and self._stopping:
            self._enter(Phase.STOPPED, self.outcome, self.message)
        elif self.clear and now.arrived:
            self._enter(Phase.IDLE, self.outcome, self.message)

    def _in_stopped(self, now):
        if not self.clear and self._lasts('braking', True, now.t, self._params.brake_time):
            self._enter(Phase.RETRACT, self.outcome, self.message)

    def _stop(self, reason):
        self._stopping = True
        if self.phase is Phase.IDLE:
            self.clear = True
        self._enter(Phase.STOPPED, Outcome.HELD, reason)

    def _enter(self, phase, outcome, message):
        if phase in (Phase.APPROACH, Phase.FOLLOW):
            self.clear = False
        elif phase is Phase.RETRACT and self.phase is Phase.IDLE:
            self.clear = True
        self.phase, self.outcome, self.message = phase, outcome, message
        self._since = {}

    def _lasts(self, name, there, t, patience):
        """True once `there` has been true for longer than `patience` [s]."""
        if not there:
            self._since.pop(name, None)
            return False
        return t - self._since.setdefault(name, t) > patience
