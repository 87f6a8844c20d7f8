"""Drives a needle through a hole of the template, and says where it measures the tip to be.

What is true: the needle's depth along its path (`insertion`), its tip on the arc of its bevel
(`needle.NeedlePath`). What is told: the depth as a tracker of the needle's base measures it in
one direction, as in the thesis' set-up (sec. 6.5, MicronTracker), and the tip that follows from
hole, depth, and the arc and offset that the driver is told (`bends`); until then, if `told` is
'arc', the nominal arc of such needles. The true arc differs by `radius_spread`, so that the told
tip is wrong by some tenths of a millimetre at depth; if `told` is 'straight' it is wrong by the
whole deflection, depth^2 / (2 radius) across the axis.
Both are the path that the tip cuts in tissue that stands still. How the shaft bends off it where
tissue moves is the tissue's to say (`tissue.needle_beam`); nothing here measures that.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from arm_brachy.core.errors import CommandRefused, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity, whole, word
from arm_brachy.devices.insertion import HandMotion, InsertionProfile
from arm_brachy.devices.motion_profile import Motion, Profile, stopping_point
from arm_brachy.devices.needle import NeedleParams, NeedlePath
from arm_brachy.devices.sampling import DelayLine, SampleTimes, fraction

_REST_SPEED = 1e-5   # m/s, below which the needle counts as at rest
_SAME_HOLE = 1e-4    # m from a hole, within which it is meant
_STRONGEST = 20.0    # 1/m, more than any needle bends
_FARTHEST = 10e-3    # m, more than tissue that is pushed takes a shaft off its path
_ROUNDING = 1e-9     # m, over a limit that is no command but a conversion of units


@dataclass(frozen=True)
class NeedleDriverParams:
    """Needle, hole, drive and what measures them."""

    needle: NeedleParams = field(default_factory=NeedleParams)
    insertion: InsertionProfile = field(default_factory=InsertionProfile)
    column: int = whole(6, 'of the hole at the start, the first is 0', low=0)
    row: int = whole(6, 'of that hole', low=0)
    points: int = whole(41, 'of the true shaft, template to tip', low=2, high=1000)
    told: Literal['arc', 'straight'] = word(
        'whether the tip as told follows the nominal arc or the axis of the hole', default='arc')
    roll: float = quantity(0.0, 'deg', "turn of the needle about its axis; at 0 it bends towards "
                           "the template's x", low=-360.0, high=360.0)
    radius_spread: float = quantity(0.1, '', "standard deviation of the true arc's radius from "
                                    'the nominal one, as a share, from needle to needle', low=0.0,
                                    high=0.5, source='engineering judgement: 200 to 650 mm are '
                                                     'reported over tissues and needles')
    max_speed: float = quantity(200.0, 'mm_s', 'largest speed that a command may ask for',
                                low=0.1, high=1000.0, source='above the 123 mm/s of clinical '
                                                             'hands')
    force_limit: float = quantity(5.0, 'N', 'force along the needle at which it stops', low=0.1,
                                  high=100.0, source='engineering judgement: five times what a '
                                                     'soft phantom returns at full depth')
    force_noise: float = quantity(0.02, 'N', 'standard deviation of the force sensor', low=0.0,
                                  high=10.0, source='engineering judgement: 0.1 % of a range of '
                                                    '20 N')
    depth_rate: float = quantity(48.0, 'Hz', 'measurements of depth per second', low=1.0,
                                 high=1000.0, source='MicronTracker Sx60 (data sheet, from '
                                                     'memory)')
    depth_latency: float = quantity(21.0, 'ms', 'from measurement to delivery', low=0.0,
                                    high=1000.0, source='one frame (engineering judgement)')
    depth_noise: float = quantity(0.05, 'mm', 'standard deviation from one measurement to the '
                                  'next', low=0.0, high=10.0, source='engineering judgement: a '
                                                                     'tenth of a pixel')
    depth_error: float = quantity(0.2, 'mm', 'standard deviation of the constant error of a run',
                                  low=0.0, high=10.0, source='MicronTracker: 0.25 mm rms, all '
                                                             'axes (data sheet, from memory)')
    shown: float = quantity(1.0, 'mm', 'told depth from which on the tip counts as outside the '
                            'hole', low=0.0, high=20.0, source='five standard deviations of the '
                                                               'constant error')


@dataclass(frozen=True)
class NeedleState:
    """A needle at time t [s]. World frame.

    measured_t : s, when the depth was measured
    depth, velocity : m, m/s, as measured;  force : N, measured, positive against insertion
    tip_p, tip_R : (3,) [m], (3, 3) of the tip as told, z along the needle, x to the bevel's side;
        None within the hole;  roll : [rad] of the needle's base
    true_depth : m;  shaft, axes : (k, 3) [m] and unit tangents of its true path, template to tip
    """

    t: float
    measured_t: float
    depth: float
    velocity: float
    force: float
    tip_p: np.ndarray | None
    tip_R: np.ndarray | None
    roll: float
    true_depth: float
    shaft: np.ndarray
    axes: np.ndarray
    moving: bool
    outcome: Outcome
    message: str = ''


def check_depth(params, depth):
    """Raise CommandRefused for a depth [m] that the needle does not reach.

    params : NeedleDriverParams
    """
    longest = params.needle.length
    if not -_ROUNDING <= depth <= longest + _ROUNDING:
        raise CommandRefused(f'needle: depth = {1e3 * depth:.6g} mm; must be 0 to '
                             f'{1e3 * longest:.6g} mm, the length of the needle: take a longer '
                             'needle or a nearer target')


def nominal_offset(params, axis, side):
    """Return the function (roll [rad], depth [m], turn [m]) -> (3,) [m] of the told tip.

    From its hole; half a turn of the base at a depth `turn`, which may be left out.
    params : NeedleDriverParams;  axis, side : (3,) along the holes, and to where roll 0 bends
    """
    def offset(roll, depth, turn=np.inf):
        path = NeedlePath(replace(params.needle, radius=_told_radius(params)), np.zeros(3), axis,
                          side)
        path.turn(roll)
        path.advance(min(depth, turn))
        if turn < depth:
            path.turn(np.pi)
            path.advance(depth - turn)
        return path.p
    return offset


def _told_radius(params):
    return params.needle.radius if params.told == 'arc' else np.inf


class DepthSensor:
    """Measures a depth at its own rate: noise, a constant error, and delivery some time later."""

    def __init__(self, params, rng):
        """params : NeedleDriverParams;  rng : numpy Generator"""
        self._noise, self._rng = params.depth_noise, rng
        self._error = params.depth_error * rng.standard_normal()
        self._times = SampleTimes(params.depth_rate)
        self._line = DelayLine(self._times, params.depth_latency)

    def advance(self, t0, depth0, t1, depth1):
        """Return what is delivered in (t0, t1] [s] as [(t, depth)], oldest first."""
        taken = []
        for instant in self._times.between(t0, t1):
            depth = depth0 + fraction(instant, t0, t1) * (depth1 - depth0)
            noise = self._noise * self._rng.standard_normal()
            taken.append((instant.number, (instant.t, depth + self._error + noise)))
        return self._line.exchange(taken, t0, t1)


class NeedleDriver:
    """One needle in one hole. Time passes in `read` only, as with the actuators.

    params : NeedleDriverParams;  holes : (columns, rows, 3) [m] where needles leave the template
    axis : (3,) along them;  side : (3,) the template's x, to which roll 0 bends the needle
    rng : numpy Generator
    Raises InputError for a hole outside the grid.
    Test: devices/test_needle_driver.py
    """

    def __init__(self, params, holes, axis, side, rng):
        """At depth zero, at rest, in the hole of the parameters."""
        self.params, self._holes = params, np.asarray(holes, dtype=float)
        self._axis, self._side = (np.asarray(v, dtype=float) for v in (axis, side))
        for name, value, count in (('column', params.column, self._holes.shape[0]),
                                   ('row', params.row, self._holes.shape[1])):
            if not 0 <= value < count:
                raise InputError(f'needle: {name} = {value}; must be 0 to {count - 1}, a hole of '
                                 'the template')
        self._hand_rng, depth_rng, self._force_rng, radius_rng = rng.spawn(4)
        spread = np.exp(params.radius_spread * radius_rng.standard_normal())
        self._true = replace(params.needle, radius=params.needle.radius * spread)
        self._radius = _told_radius(params)
        self._sensor = DepthSensor(params, depth_rng)
        self._insert_into(self._holes[params.column, params.row], params.roll)
        self._t, self._measured, self._speed = None, (0.0, 0.0), 0.0
        self._move = self._rest()
        self._stopped = self._held = self._blocked = False
        self._refusal = ''

    @property
    def true_radius(self):
        """[m] of the arc that this needle takes; evaluations may know it, the cell does not."""
        return self._true.radius

    def _insert_into(self, hole, roll):
        self.path = NeedlePath(self._true, hole, self._axis, self._side)
        self.path.turn(roll)
        self._hole, self._turns, self._offset = hole, [(0.0, roll)], np.zeros(3)
        self._told = self._told_again(0.0)

    def _told_again(self, depth):
        """The told path to a depth [m], with the turns of the base on the way."""
        path = NeedlePath(replace(self.params.needle, radius=self._radius), self._hole,
                          self._axis, self._side)
        for at, roll in self._turns:
            path.advance(max(at - path.depth, 0.0))
            path.turn(roll - path.roll)
        path.advance(depth - path.depth)
        return path

    def _forget_turns(self):
        """What is cut again after a withdrawal bends to where the bevel is now."""
        depth = self._told.depth
        if self._turns[-1][0] > depth:
            kept = [one for one in self._turns if one[0] <= depth]
            self._turns = [*kept, (depth, self._turns[-1][1])]

    def bends(self, curvature, offset=(0.0, 0.0, 0.0)):
        """Tell that this needle bends by a curvature [1/m]: the told tip follows that arc.

        offset : (3,) [m] from there to where it is: the tissue has bent the shaft off its path;
            until the needle is placed again
        Raises CommandRefused for what no needle does.
        """
        if not 0.0 <= curvature <= _STRONGEST:
            self._refuse(f'needle: curvature = {curvature:.6g} 1/m; must be 0 to '
                         f'{_STRONGEST:g}')
        if not np.linalg.norm(offset) <= _FARTHEST:
            place = ', '.join(f'{1e3 * c:.1f}' for c in offset)
            self._refuse(f'needle: offset = ({place}) mm; must be finite, at most '
                         f'{1e3 * _FARTHEST:g} mm long')
        self._offset = np.array(offset, dtype=float)
        self._radius = 1.0 / curvature if curvature > 0.0 else np.inf
        self._told = self._told_again(self._told.depth)

    def place(self, hole, roll):
        """Take the needle to another hole (3,) [m], turned by `roll` [rad] about its axis.

        Raises CommandRefused unless the needle is at rest within the template, and for a place
        where the template has no hole.
        """
        self._permit('place')
        if self.path.depth > self.params.shown or not self._move.done:
            self._refuse(f'needle: place at a depth of {1e3 * self.path.depth:.1f} mm; must be at '
                         f'rest, at most {1e3 * self.params.shown:g} mm deep: withdraw it first')
        if not np.isfinite(roll):
            self._refuse(f'needle: roll = {roll} rad; must be a finite number')
        far = np.linalg.norm(self._holes - np.asarray(hole, dtype=float), axis=-1)
        if not far.min() < _SAME_HOLE:
            place = ', '.join(f'{1e3 * c:.1f}' for c in hole)
            self._refuse(f'needle: no hole at ({place}) mm; must be one of the '
                         f'{self._holes.shape[0]} x {self._holes.shape[1]} of the template')
        self._insert_into(self._holes[np.unravel_index(far.argmin(), far.shape)], roll)
        self._move = self._rest()

    def turn(self, roll):
        """Turn the needle's base to `roll` [rad]; the tip follows at once, torsion is left out.

        Raises CommandRefused during an emergency stop or if roll is no number.
        """
        self._permit('turn')
        if not np.isfinite(roll):
            self._refuse(f'needle: roll = {roll} rad; must be a finite number')
        for path in (self.path, self._told):
            path.turn(roll - path.roll)
        self._turns.append((self._told.depth, roll))

    def _permit(self, what):
        if self._stopped:
            self._refuse(f'needle: {what} during an emergency stop; call release first')

    def _refuse(self, message):
        self._refusal = message
        raise CommandRefused(message)

    def command(self, depth, speed=None):
        """Start moving to `depth` [m] at `speed` [m/s] (None = the profile's).

        Raises CommandRefused, and keeps what is under way, for a depth that the needle does not
        reach, a speed out of range, or while stopped; the next NeedleState says so too.
        """
        self._permit('move')
        try:
            check_depth(self.params, depth)
            self._check_speed(speed)
        except CommandRefused as error:
            self._refusal = str(error)
            raise
        profile = self.params.insertion
        self._move = self._planned(float(np.clip(depth, 0.0, self.params.needle.length)),
                                   profile.speed if speed is None else speed, profile)
        self._held = self._blocked = False

    def _check_speed(self, speed):
        if speed is not None and not 0.0 < speed <= self.params.max_speed + _ROUNDING:
            raise CommandRefused(f'needle: speed = {1e3 * speed:.6g} mm/s; must be above 0, at '
                                 f'most {1e3 * self.params.max_speed:.6g}')

    def _planned(self, depth, speed, profile):
        """By hand strokes begin at rest: a needle under way goes on in one trapezoid."""
        motion = self._move.motion
        if profile.by == 'motor' or abs(motion.velocity) > _REST_SPEED:
            return Profile(motion, depth, speed, profile.acceleration)
        return HandMotion(Motion(motion.position, 0.0), depth, speed, profile, self._hand_rng)

    def hold(self):
        """Brake to rest and stay; the next command is obeyed. Ends no emergency stop."""
        braking = self.params.insertion.braking
        stop = np.clip(stopping_point(self._move.motion, braking), 0.0, self.params.needle.length)
        self._move = Profile(self._move.motion, float(stop), self.params.max_speed, braking)
        self._held = True

    def stop(self):
        """Emergency: stand still at once and refuse every motion until `release`."""
        self._move, self._stopped = self._rest(), True

    def release(self):
        """End the emergency stop; nothing moves until the next command."""
        self._stopped = False

    def read(self, t, force=0.0):
        """Advance to t [s] under `force` [N] of the tissue along the needle; returns NeedleState.

        The first read sets the clock and moves nothing.
        A force above params.force_limit ends a motion that pushes (or pulls) on against it: HELD
        until the next command. Raises CommandRefused if t lies before the last read.
        """
        if self._t is None:
            self._t, self._measured = t, (t, 0.0)
        if t < self._t:
            raise CommandRefused(f'needle: read at t = {t} s after t = {self._t} s; time must '
                                 'not run backwards')
        if t > self._t:
            self._yield_to(force)
            self._advance(t)
        return self._state(force)

    def _rest(self):
        profile = self.params.insertion
        return Profile(Motion(self.path.depth, 0.0), self.path.depth, profile.speed,
                       profile.acceleration)

    def _yield_to(self, force):
        onward = np.sign(self._move.target - self.path.depth)
        if abs(force) > self.params.force_limit and onward == np.sign(force):
            self._move, self._blocked = self._rest(), True

    def _advance(self, t):
        before = self.path.depth
        self._move.advance(t - self._t)
        depth = np.clip(self._move.motion.position, 0.0, self.params.needle.length)
        self.path.advance(depth - before)
        for measured in self._sensor.advance(self._t, before, t, self.path.depth):
            (t0, d0), (t1, d1) = self._measured, measured
            if t1 > t0:
                self._speed = (d1 - d0) / (t1 - t0)
            self._measured = measured
            self._told.advance(max(d1, 0.0) - self._told.depth)
            self._forget_turns()
        self._t = t

    def _state(self, force):
        p = self.params
        measured_t, depth = self._measured
        tip_R, tip_p = self._told_tip() if depth > p.shown else (None, None)
        outcome, message = self._outcome()
        shaft, axes = self.path.shaft(p.points), self.path.tangents(p.points)
        return NeedleState(
            self._t, measured_t, float(depth), float(self._speed),
            float(force + p.force_noise * self._force_rng.standard_normal()), tip_p, tip_R,
            self.path.roll, float(self.path.depth), shaft, axes,
            not self._move.done or abs(self._move.motion.velocity) > _REST_SPEED, outcome, message)

    def _told_tip(self):
        t, n = self._told.t, self._told.n
        return np.column_stack([n, np.cross(t, n), t]), self._told.p + self._offset

    def _outcome(self):
        if self._refusal:
            message, self._refusal = self._refusal, ''
            return Outcome.REJECTED, message
        if self._stopped:
            return Outcome.HELD, 'needle: emergency stop; call needle_driver/release, then move'
        if self._blocked:
            return Outcome.HELD, ('needle: force above force_limit_N = '
                                  f'{self.params.force_limit:g}; withdraw or move slower')
        if self._held:
            return Outcome.HELD, 'needle: held on request; the next command is obeyed'
        return Outcome.OK, ''
