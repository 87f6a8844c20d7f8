"""A procedure: bring the target onto the needle's path, insert under the probe, withdraw.

    SETTLING     rest
    REGISTERING  until the estimator says where the target is, then plan: hole, roll, depth, goal
    MOVING       the pads bring the target to its goal, and keep it there from now on; where they
                 moved it along other axes too, the path is planned anew
    SCANNING     the skin anew: the pads have moved it
    PLACING      needle to where the probe can see its tip, turned over on the way as planned;
                 from here to INSERTING the pads let it drag the target along, since a breast that
                 is squeezed against that lifts the target, and hold it across
    APPROACHING  probe onto the skin over the tip
    MEETING      needle on to where the image plane waits, if the probe cannot reach back to it
    INSERTING    needle to its depth, which follows the target: as estimated, and as seen once the
                 images show it; it waits while the probe has lost skin or tip, the images do not
                 show the tip, or nothing says where the target is; the person who sees the
                 overlay turns it towards the target; the pads may take the target onto where
                 the tip will be, as the images show both (Mallapragada, Sarkar, Podder 2009,
                 IEEE Trans Robot 25:316)
    DWELLING     at the target
    WITHDRAWING  needle out, pads at rest; the probe follows it back over half of the way that it
                 has seen, then goes off the skin
    RETRACTING   probe off, HOMING pads home, FINISHED
Each step has a time limit. A failure names its outcome once; then needle, probe and pads go back
in that order, each within its own limit, and what does not move any more is left where it is.
Nothing is ordered while the safety state is not RUN. No ROS, no clock: time is an argument.
"""

from collections import deque

import numpy as np

from arm_brachy.control.needle_curvature import NeedleCurvature
from arm_brachy.control.needle_plan import NoPlan, plan
from arm_brachy.control.needle_sight import probe_fault, target_fault, tip_fault
from arm_brachy.control.overlay_reader import OverlayReader
from arm_brachy.control.procedure_steps import (
    SLOW,
    WAY_BACK,
    Kind,
    NeedleSeen,
    Order,
    Phase,
    ProbeSeen,
)
from arm_brachy.control.safety import Permission
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.probe_phase import ProbePhase

AVERAGED = 1.0      # s of estimates whose mean is where the target is
_FRESH = 0.5        # s, age from which on an estimate says nothing any more
_STEP = 0.2e-3      # m by which a wanted depth has to change before it is ordered
_REPLANS = 3        # of the path, while the pads bring the target
_AGREED = 1e-3      # m between places of the target by the images of _FRESH, at most
_WAY = 0.2          # s from one goal to the next while the needle drags the target along
_DRAG = 0.05e-3     # m by which it has to: less than what pads answer to
_SHIFT = 0.3e-3     # m by which a wanted goal has to: three errors of what the images show
_ARRIVED = 0.5e-3   # m from its depth at which the needle counts as there: depth sensor's error
_ASTRAY = 1e-3      # m, the same of a needle that stands: what a depth sensor may be off by
_LEAD = 1.0         # s by which a stamp may be ahead of the last step
_STANDS = 0.25e-3   # m by which the told depth of a needle that stands may change: noise
_BENT = 0.02        # of the curvature that was told, a change that is told again: the probe
                    # turns with it, in small steps
_ASIDE = 0.05e-3    # m by which the told offset of the path has to change: the same
_MET = 0.3e-3       # m of the tip from the image plane, as told, that counts as in it
_OUT = 1.5e-3       # m of told depth below which the needle is out
_SLOWING = 6        # steps in which the needle comes to its speed before the target
# Steps in which the pads let the needle drag the target along. Not while it goes on to the target,
# which the images find by planes of different times: meanwhile it has to stay.
_DRAGGED = (Phase.PLACING, Phase.APPROACHING, Phase.MEETING)
_DRIVEN = (Phase.PLACING, Phase.MEETING, Phase.INSERTING)   # steps in which the needle goes in


class Procedure:
    """Hear, then `step` once a tick.

    phase : Phase;  outcome, message : of the procedure, OK while nothing has failed
    plan : NeedlePlan, None before there is one
    params : ProcedureParams;  holes : (columns, rows, 3) [m];  needle : NeedleCourse
    press : (3,) [m] by which the probe will move the target, as foretold
    Test: control/test_procedure.py
    """

    def __init__(self, params, holes, needle, settle, press=(0.0, 0.0, 0.0)):
        """settle : [s] rest at the beginning; the rest see the class."""
        self.params = params
        self._holes, self._course, self._settle = holes, needle, settle
        self._axes = np.array([a in params.axes for a in 'xyz'])
        # Along these the pads follow the target under the probe.
        self._press = np.where(self._axes, 0.0, press)
        self.phase, self.outcome, self.message, self.plan = Phase.SETTLING, Outcome.OK, '', None
        self._since, self._t = None, 0.0
        self._target, self._at_home = deque(), False
        self._seen = deque()        # (s, (3,) [m]) where the images show the target
        self._goal, self._next_shift, self._next_way = None, 0.0, 0.0
        self._told = None           # curvature [1/m] of the needle, and its offset (3,) [m]
        self._tip_seen = -np.inf    # s, of the last image in which the tip was found
        self._estimated = self._imaged = -np.inf    # s, of the target, the last of each
        self._shown = -np.inf       # s, of the last one that was answered by what is foretold
        self._needle, self._probe = NeedleSeen(0.0), ProbeSeen()
        self._stood = 0.0, 0.0      # told depth [m] that has not changed since [s]
        self._sent = 0.0            # s, of the last order to go to a depth
        self._away_since = None     # s, while the needle is not where it was sent
        self._error, self._calm_since = np.inf, None
        self._surfaces, self._scanned = 0, 0
        self._depth, self._waits, self._permission, self._reason = None, None, Permission.HOLD, ''
        self._stopped = False       # the needle was told to stay, and not to go on since
        self._reader, self._curvature = OverlayReader(params.steering), None
        self._roll = None   # rad that the base of the needle was turned to last
        self._held_since, self._ordered, self._pursued = None, False, False
        self._start = None       # where the target was when it was planned for first
        self._replans = 0        # how often the path was planned anew for where the pads led
        self._kept = None        # plan and goal before that
        self._speed_back = None  # m/s that was ordered for the way out
        self._speed = None       # m/s that was ordered last of the insertion
        self._begun = None       # m of depth at which the insertion began
        self._deepest = None     # m of depth at the target

    # What is heard. Times in s, positions (3,) in m.

    def hear_target(self, t, p):
        """Where the feedback has the target."""
        if self._sound(t, p):
            self._target.append((t, np.array(p, dtype=float)))
            self._estimated = t

    def hear_needle(self, seen):
        """Take a NeedleSeen."""
        self._needle = seen
        if abs(seen.depth - self._stood[0]) > _STANDS:
            self._stood = seen.depth, self._t

    def hear_probe(self, seen):
        """Take a ProbeSeen."""
        self._probe = seen

    def hear_image(self, t, p):
        """Where the tip was found in the image."""
        if self._sound(t, p):
            self._tip_seen = t
            if self.phase is Phase.INSERTING:
                self._curvature.seen(t, self._needle.depth, p)

    def hear_target_image(self, t, p):
        """Where the images show the target; farther off than it can be moved it is another."""
        if self._sound(t, p) and not (
                self.plan is not None
                and np.linalg.norm(p - self.plan.goal) > 2.0 * self.params.reach):
            self._seen.append((t, np.array(p, dtype=float)))
            self._imaged = t

    def _sound(self, t, p):
        """True for a place that is one, and whose stamp [s] is not of the future."""
        return t <= self._t + _LEAD and bool(np.all(np.isfinite(p)))

    def hear_surface(self):
        """Note that the skin was scanned."""
        self._surfaces += 1

    def hear_pads(self, at_home):
        """True while all pads are home and at rest."""
        self._at_home = at_home

    def permit(self, permission, reason=''):
        """Take the supervisor's word."""
        self._permission, self._reason = permission, reason

    def refused(self, message, kind):
        """An order of some Kind was refused: the step fails, of the way back the next one begins.

        A goal that a better plan asked for is no failure: the plan before it holds. Neither is
        one by the images, or by how the needle drags the target: the last one holds until the end.
        """
        if self.phase in WAY_BACK:
            if self.outcome.ok:
                self.outcome, self.message = Outcome.REJECTED, f'{self.phase.value}: {message}'
            if self.phase is not Phase.FINISHED:
                self._next_back()
        elif kind is Kind.SHIFT and self.phase is not Phase.MOVING:
            self._next_shift = self._next_way = np.inf
        elif kind is Kind.SHIFT and self._kept is not None:
            (self.plan, self._goal), self._kept = self._kept, None
            self._replans = _REPLANS
        else:
            self._fail(Outcome.REJECTED, message)

    @property
    def target(self):
        """Mean (3,) [m] of the last second of estimates; None without a fresh one."""
        while self._target and self._target[0][0] < self._t - AVERAGED:
            self._target.popleft()
        if not self._target or self._target[-1][0] < self._t - _FRESH:
            return None
        return np.mean([p for _, p in self._target], axis=0)

    def step(self, t):
        """Return the list of Orders at time t [s]."""
        self._t = t
        if self._since is None:
            self._enter(Phase.SETTLING)
        if self._permission is not Permission.RUN:
            return self._forbidden()
        self._held_since = None
        before = None
        orders = []
        self._notice_standing()
        while before is not self.phase:     # a step may end at once
            before = self.phase
            orders += getattr(self, f'_{self.phase.value}')() or []
            orders += self._give_way()
            limit = getattr(self.params.limits, self.phase.value, None)
            if limit is not None and self._elapsed > limit:
                orders += self._timed_out(limit)
        return orders

    def figures(self):
        """What a recording keeps of the step and of the plan: name -> text, SI."""
        out = {'phase': self.phase.value, 'outcome': self.outcome.name}
        if self.message:
            out['message'] = self.message
        if self.plan is not None:
            out |= {'hole': f'{self.plan.column} {self.plan.row}',
                    'hole_m': _numbers(self.plan.hole), 'roll_rad': f'{self.plan.roll:.6g}',
                    'turn_m': f'{self.plan.turn:.6g}', 'depth_m': f'{self.plan.depth:.6g}',
                    'tip_m': _numbers(self.plan.tip), 'goal_m': _numbers(self.plan.goal),
                    'left_m': f'{self.plan.left:.6g}', 'spread_m': f'{self.plan.spread:.6g}',
                    'path_m': _numbers(self.plan.path.ravel()), 'press_m': _numbers(self._press)}
        return out

    # Steps. Each returns the orders it has now, None = none.

    def _settling(self):
        if self._elapsed >= self._settle:
            self._enter(Phase.REGISTERING)

    def _registering(self):
        here = self.target
        if here is None or self._target[-1][0] - self._target[0][0] < 0.5 * AVERAGED:
            return None
        try:
            self.plan = self._planned(here)
        except NoPlan as why:
            self._fail(why.outcome, str(why))
            return None
        self._enter(Phase.MOVING)
        self._pursued, self._goal = True, self.plan.goal
        return [Order(Kind.SET_GOAL, tuple(self.plan.goal))]

    def _planned(self, here):
        """The NeedlePlan to a target that is `here` (3,) now. Raises NoPlan."""
        if self._start is None:
            self._start = here
        return plan(self._holes, self._course, here + self._press, axes=self._axes,
                    reach=self.params.reach, miss=self.params.miss, hole=self.params.hole,
                    start=self._start + self._press,
                    unturned=self.params.view if self.params.turn else None)

    def _moving(self):
        here = self.target
        self._error = np.inf if here is None else float(np.linalg.norm(
            (here - self.plan.goal)[self._axes]))
        if not self._lasts_calm(self._error <= self.params.tolerance):
            return None
        better = self._better_plan(here)
        if better is not None:
            self._kept = self.plan, self._goal
            self.plan, self._goal, self._calm_since = better, better.goal, None
            return [Order(Kind.SHIFT, tuple(better.goal))]
        passes = self._passes(here)
        if passes > self.params.miss:
            self._fail(Outcome.INFEASIBLE, f'the needle would pass the target by '
                       f'{1e3 * passes:.1f} mm where the pads have brought it; allowed '
                       f'{1e3 * self.params.miss:g} mm: choose another hole')
            return None
        self._enter(Phase.SCANNING)
        return [Order(Kind.ARRIVED)]

    def _passes(self, here):
        """[m] by which the planned path passes a target that is `here`, where no pad moves it."""
        off = np.where(self._axes, 0.0, self.plan.tip - here - self._press)
        return float(np.linalg.norm(off - self._course.axis * (self._course.axis @ off)))

    def _better_plan(self, here):
        """A NeedlePlan that ends nearer to a target that the pads have brought `here`, or None.

        Tissue keeps its volume: what is pushed aside rises as well, where no pad controls it.
        """
        if self._replans == _REPLANS:
            return None
        try:
            better = self._planned(here)
        except NoPlan:      # the one that there is holds
            return None
        self._replans += 1
        return better if self._passes(here) - better.left > _SHIFT else None

    def _scanning(self):
        if not self._ordered:
            self._ordered, self._scanned = True, self._surfaces
            return [Order(Kind.SCAN)]
        if self._surfaces > self._scanned:
            self._enter(Phase.PLACING)
        return None

    def _placing(self):
        view, turn = max(0.0, self.plan.depth - self.params.view), self.plan.turn
        if np.isfinite(turn):       # the pads may have brought the target nearer since
            view = max(view, turn)
        if not self._ordered:
            self._ordered, course = True, self._course
            self._curvature = NeedleCurvature(self.plan.hole, course.axis, course.side,
                                              course.curvature, self.plan.roll, course.skin)
            self._told, self._roll = (course.curvature, np.zeros(3)), self.plan.roll
            return [Order(Kind.PLACE, (*self.plan.hole, self.plan.roll)),
                    self._drive(min(turn, view), self.params.entry)]
        over = self._roll != self.plan.roll
        if not over and self._depth == turn:
            if self._lasts_calm(self._there(turn)):     # at rest: what is told is not late
                return [self._turn(self.plan.roll + np.pi),
                        self._drive(view, self.params.entry)]
        elif self._there(view):
            self._enter(Phase.APPROACHING)
        return None

    def _approaching(self):
        probe = self._probe
        if not self._ordered:
            self._ordered = True
            return [Order(Kind.FOLLOW)]
        if probe.phase == ProbePhase.FOLLOW and probe.in_contact:
            if self._lasts_calm(True):
                self._enter(Phase.MEETING)
        elif not self._lasts_calm(False) and self._elapsed > _FRESH:
            self._probe_well()
        return None

    def _meeting(self):
        if not self._probe_well():
            return None
        fault = probe_fault(self._probe, self.params.lost)
        if fault is not None:
            return self._wait(*fault)
        self._waits = None
        behind = -self._probe.out_of_plane
        met = abs(behind) <= _MET
        # In contact for a while, the probe has turned as far as it can: a needle that has not
        # moved since stays in the plane.
        if self._lasts_calm(met) or (met and not self._ordered):
            self._enter(Phase.INSERTING)
        elif behind > _MET and self._elapsed > self.params.calm:    # the probe had time to turn
            self._ordered = True
            depth = min(self._needle.depth + behind, self.plan.depth)
            if self._stopped or abs(depth - self._depth) > _STEP:
                return [self._drive(depth, self.params.speed)]
        return None

    def _inserting(self):
        if self._elapsed > _FRESH and not self._probe_well():
            return None
        fault = self._fault()
        if fault is not None:
            return self._wait(*fault)
        self._waits = None
        try:
            depth = self._depth_wanted()
        except NoPlan as why:
            self._fail(why.outcome, str(why))
            return None
        orders = (self._steer(depth) + self._show(depth) + self._shift(depth)
                  + self._tell_path())
        # Not at once: the tip has to be there for the images to show where the target is.
        if self._lasts_calm(self._there(depth)):
            self._enter(Phase.DWELLING)
            return [*orders, Order(Kind.STAY)]
        self._begun = self._needle.depth if self._begun is None else self._begun
        speed = self._speed_at(self._needle.depth - self._begun, depth - self._needle.depth)
        if self._stopped or abs(depth - self._depth) > _STEP or speed != self._speed:
            self._speed = speed
            orders.append(self._drive(depth, speed))
        return orders

    def _speed_at(self, gone, left):
        """Speed [m/s] of the insertion, `gone` [m] from its start and with `left` [m] to go.

        Step by step up and down: a probe that follows the tip stays behind a needle that sets out
        at once, and goes on for a while when it slows down at once.
        """
        p = self.params
        way = min(gone, left - p.near)
        share = np.clip(way / p.near, 0.0, 1.0) if p.near > 0.0 else 1.0
        share, slow = float(np.ceil(_SLOWING * share)) / _SLOWING, min(p.near_speed, p.speed)
        return slow + share * (p.speed - slow)

    @property
    def _left_at(self):
        """[m] of depth at which the probe leaves a needle on its way out: half of the way that it
        has seen. Tissue that the needle drags back is nearer to its rim than on the way in.
        """
        deepest = self.plan.depth if self._deepest is None else self._deepest
        return deepest - 0.5 * self.params.view

    def _dwelling(self):
        self._deepest = self._needle.depth
        if self._probe_well() and self._elapsed >= self.params.dwell:
            self._enter(Phase.WITHDRAWING)

    def _withdrawing(self):
        """The probe follows back over half of what it has seen, as slowly, then goes off.

        The pads stay: a needle on its way out drags the tissue, and pads that only push would
        squeeze it more and more to hold the target against that.
        """
        orders = [] if self._ordered else [Order(Kind.REST)]
        self._ordered = True
        seen = self.plan is not None and self._needle.depth >= self._left_at
        following = self._probe.phase in (ProbePhase.APPROACH, ProbePhase.FOLLOW)
        speed = self.params.speed if seen and following else self.params.withdrawal
        # Also where it seems to be out: it may be under way in. Again where it does not move.
        stands = self._stands >= self.params.calm and self._needle.depth > _OUT
        driven = self._depth is not None or self._needle.depth > _OUT
        if driven and (speed != self._speed_back or stands):
            self._speed_back = speed
            orders.append(self._drive(0.0, speed))
        if following and not seen:
            orders.append(Order(Kind.RETRACT))
        if self._needle.depth < _OUT:
            self._enter(Phase.RETRACTING)
        return orders

    def _retracting(self):
        off = self._probe.phase == ProbePhase.STOPPED and not self._probe.in_contact
        if self._probe.phase == ProbePhase.IDLE or off:
            self._enter(Phase.HOMING)
        elif not self._ordered:
            self._ordered = True
            if self._probe.phase != ProbePhase.RETRACT:
                return [Order(Kind.RETRACT)]
        return None

    def _homing(self):
        if not self._ordered:
            self._ordered = True
            self._at_home = False       # what was heard so far is of before
            return [Order(Kind.RELEASE)]
        if self._at_home and self._elapsed > 0.0:
            self._enter(Phase.FINISHED)
        return None

    def _finished(self):
        return [Order(Kind.FINISH)]

    # What steps share.

    def _drive(self, depth, speed):
        self._depth, self._stopped, self._sent = depth, False, self._t
        return Order(Kind.DRIVE, (depth, speed))

    @property
    def _stands(self):
        """[s] since the needle has moved, or was ordered to, last."""
        return self._t - max(self._stood[1], self._sent)

    def _notice_standing(self):
        """A needle that was sent in and does not go there fails the step.

        Orders that follow a target that moves are no reason to wait again.
        """
        away = (self.phase in _DRIVEN and self._depth is not None and not self._stopped
                and abs(self._needle.depth - self._depth) > _ASTRAY)
        if not away:
            self._away_since = None
            return
        if self._away_since is None:
            self._away_since = self._t
        since = max(self._stood[1], self._away_since)
        if self._t - since > self.params.limits.standing:
            needle = self._needle
            self._fail(Outcome.NEEDLE_STANDS, (
                f'the needle has stood at {1e3 * needle.depth:.1f} mm for {self._t - since:.1f} s '
                f'on its way to {1e3 * self._depth:.1f} mm, under {needle.force:.1f} N: look at '
                'its drive; above needle.force_limit_N, withdraw it or insert more slowly'))

    def _there(self, depth):
        """True at a depth [m]; where drive and sensor differ, near it if the needle stands."""
        off = abs(self._needle.depth - depth)
        stands = self._stands >= max(self.params.calm, _FRESH)
        return off < (_ASTRAY if stands else _ARRIVED)

    def _lasts_calm(self, good):
        """True once something has been good for as long as `params.calm` says."""
        if not good:
            self._calm_since = None
        elif self._calm_since is None:
            self._calm_since = self._t
        return good and self._t - self._calm_since >= self.params.calm

    def _depth_wanted(self):
        """Depth (m) at which the tip is level with the target, as it is now.

        What the images show counts before the estimate. One of them has to be fresh, see `_fault`.
        """
        here = self.target if self._target_seen is None else self._target_seen
        depth = self._course.depth_at(self.plan.hole, here, self.plan.turn)
        near = self.plan.depth + np.array([-1.0, 1.0]) * self.params.reach
        return float(np.clip(depth, max(0.0, near[0]), min(self._course.length, near[1])))

    @property
    def _target_seen(self):
        """(3,) [m] where the images show the target, None if they do not now, or do not agree.

        The first ones, by outlines of a few planes near each other, may be millimetres off.
        """
        while self._seen and self._seen[0][0] < self._t - _FRESH:
            self._seen.popleft()
        if not self._seen or self._t - self._seen[0][0] < 0.5 * _FRESH:
            return None
        places = np.array([p for _, p in self._seen])
        if np.ptp(places, axis=0).max() > _AGREED:
            return None
        return places[-1]

    def _give_way(self):
        """The target's goal anew, where the needle has dragged it along itself.

        Pads that hold it against that squeeze it out across the needle, where no pad controls it;
        along the needle its depth follows.
        """
        if self.phase not in _DRAGGED or not self._target or self._t < self._next_way:
            return []
        axis = self._course.axis
        change = axis * (axis @ (self._target[-1][1] - self._goal))
        far = np.linalg.norm(np.where(self._axes, self._goal + change - self._start, 0.0))
        if np.linalg.norm(change) <= _DRAG or far > self.params.reach:
            return []
        self._goal, self._next_way = self._goal + change, self._t + _WAY
        return [Order(Kind.SHIFT, tuple(self._goal))]

    def _shift(self, depth):
        """The target's goal anew, by how far the tip will pass by it as the images show both.

        depth : [m] at which they are level. The pads hear the estimate: its goal is where it is
        now, and as much further as the images say.
        """
        target = self._target_seen
        if not self.params.recentre or target is None or self.target is None:
            return []
        axis, there = self._course.axis, self.plan.hole + self._curvature.ahead(depth)
        change = self._target[-1][1] + there - target - self._goal
        change = np.where(self._axes, change - axis * (axis @ change), 0.0)
        far = np.linalg.norm(np.where(self._axes, self._goal + change - self._start, 0.0))
        if (self._t < self._next_shift or np.linalg.norm(change) <= _SHIFT
                or far > self.params.reach):
            return []
        self._goal, self._next_shift = self._goal + change, self._t + self.params.calm
        return [Order(Kind.SHIFT, tuple(self._goal))]

    def _fault(self):
        """Why the needle must not go on to the target: (Outcome, text), None if it may.

        The insertion begins with the tip in the image plane: from then on it must be seen.
        """
        return (probe_fault(self._probe, self.params.lost)
                or tip_fault(self._t - self._tip_seen, self.params.tip_patience)
                or target_fault(self._target_seen is not None or self.target is not None,
                                self._t - self._estimated, self._t - self._imaged, _FRESH))

    def _wait(self, outcome, why):
        """The needle stays; after a while the procedure fails by what it waits for then."""
        self._calm_since = None
        if self._waits is None:
            self._waits = self._t
        if self._t - self._waits > self.params.limits.waiting:
            self._fail(outcome, f'the needle has waited {self.params.limits.waiting:g} s: {why}')
            return None
        if self._stopped:
            return None
        self._stopped = True
        return [Order(Kind.STAY)]

    @property
    def _aim(self):
        """(3,) [m] where the tip is to be in the end."""
        return self.plan.goal if self._target_seen is None else self._target_seen

    def _steer(self, end):
        """What the person who sees the overlay does: orders to turn the needle, often none."""
        if not self.params.overlay:
            return []
        roll = self._reader.look(self._t, self._aim - self.plan.hole, self._curvature,
                                 self._needle.depth, end, self._roll)
        return [] if roll is None else [self._turn(roll)]

    def _turn(self, roll):
        self._curvature.turned(self._needle.depth, roll)
        self._roll = roll
        return Order(Kind.TURN, (roll,))

    def _show(self, end):
        """After each image of the tip, where it will be at a depth `end` [m], for the next."""
        if self._shown == self._tip_seen:
            return []
        self._shown, axis = self._tip_seen, self._course.axis
        there = self.plan.hole + self._curvature.ahead(end)
        there = there + axis * (axis @ (self._aim - there))     # level with the target
        return [Order(Kind.SHOW, (*there, *self._aim))]

    def _tell_path(self):
        """Of this needle, once images have shown it: the probe follows the tip as told."""
        kappa, offset = max(self._curvature.kappa, 0.0), self._curvature.offset
        before, aside = self._told
        if (abs(kappa - before) <= _BENT * before
                and np.linalg.norm(offset - aside) <= _ASIDE):
            return []
        self._told = kappa, offset
        return [Order(Kind.BEND, (kappa, *offset))]

    def _probe_well(self):
        """False, and the procedure has failed, once the probe has given up."""
        probe = self._probe
        if probe.outcome.ok or probe.phase in (ProbePhase.APPROACH, ProbePhase.FOLLOW):
            return True
        self._fail(probe.outcome, probe.message)
        return False

    @property
    def _elapsed(self):
        return self._t - self._since

    def _enter(self, phase):
        self.phase, self._since, self._ordered, self._waits = phase, self._t, False, None
        self._calm_since = None

    def _fail(self, outcome, message):
        self.outcome, self.message = outcome, f'{self.phase.value}: {message}'
        self._enter(Phase.WITHDRAWING)

    def _timed_out(self, limit):
        """A step lasted too long; on the way back the next step begins."""
        said = SLOW.get(self.phase, '')
        said = said.format(error=f'{1e3 * self._error:.2f}',
                           depth=f'{1e3 * self._needle.depth:.1f}')
        if self.phase in WAY_BACK:
            if self.outcome.ok:
                self.outcome = Outcome.TIMED_OUT
                self.message = f'{self.phase.value}: not over within {limit:g} s: {said}'
            self._next_back()
        else:
            self._fail(Outcome.TIMED_OUT, f'not over within {limit:g} s: {said}')
        return []

    def _next_back(self):
        self._enter(WAY_BACK[WAY_BACK.index(self.phase) + 1])

    def _forbidden(self):
        """Everybody stands still by the supervisor's word; a step under way has failed.

        After a while without RUN the procedure ends where it is: after a STOP the arm retracts by
        itself, the needle and the pads stay.
        """
        if self.phase in (Phase.SETTLING, Phase.REGISTERING):
            if self._permission is Permission.HOLD:     # nothing has moved: wait
                self._since = self._t
                return []
        if self.phase is Phase.FINISHED:
            return [Order(Kind.FINISH)]
        # What was ordered was stopped: order it anew afterwards.
        self._speed_back, self._ordered = None, False
        if self._held_since is None:
            self._held_since = self._t
            if self.outcome.ok:
                self._fail(Outcome.HELD, f'{self._permission.name} by the supervisor: '
                           f'{self._reason}')
        if self._t - self._held_since > self.params.limits.waiting:
            self._enter(Phase.FINISHED)
        return []


def _numbers(values):
    return ' '.join(f'{v:.6g}' for v in values)
