"""Time-optimal motion under a speed and an acceleration limit, in closed form."""

from typing import NamedTuple

import numpy as np


class Phase(NamedTuple):
    """Constant acceleration for a while.  duration : s;  acceleration : m/s^2."""

    duration: float
    acceleration: float


class Motion(NamedTuple):
    """Where something is and how it moves.  position : m;  velocity : m/s."""

    position: float
    velocity: float

    def after(self, duration, acceleration):
        """The motion after `duration` [s] of constant acceleration [m/s^2]."""
        return Motion(self.position + (self.velocity + 0.5 * acceleration * duration) * duration,
                      self.velocity + acceleration * duration)


def stopping_point(motion, acceleration):
    """Return where `motion` comes to rest under full braking [m]."""
    return motion.position + motion.velocity * abs(motion.velocity) / (2.0 * acceleration)


def plan(motion, target, speed, acceleration):
    """Return the phases that bring `motion` to rest at `target` [m] in least time.

    speed, acceleration : limits [m/s], [m/s^2], > 0; a motion that is faster than `speed` first
        slows down to it
    From rest the target is never passed. A motion that can no longer stop before the target brakes
    to rest, then comes back.
    Source: trapezoidal profile, Biagiotti & Melchiorri 2008, Trajectory Planning for Automatic
    Machines and Robots.
    Test: devices/test_motion_profile.py
    """
    distance = target - motion.position
    direction = 1.0 if distance >= 0.0 else -1.0
    forward = direction * motion.velocity
    braking = motion.velocity**2 / (2.0 * acceleration)
    if forward < 0.0 or braking > abs(distance) * (1.0 + 1e-12):
        stop = Phase(abs(motion.velocity) / acceleration,
                     -np.sign(motion.velocity) * acceleration)
        rest = Motion(stopping_point(motion, acceleration), 0.0)
        return [stop, *plan(rest, target, speed, acceleration)]
    return _forward_plan(abs(distance), forward, speed, direction * acceleration)


def _forward_plan(distance, velocity, speed, acceleration):
    """Change speed, cruise, brake; `velocity` >= 0 points at the target, which is in reach."""
    a = abs(acceleration)
    reachable = np.sqrt(a * distance + 0.5 * velocity**2)
    peak = speed if velocity > speed else max(min(speed, reachable), velocity)
    change = abs(peak**2 - velocity**2) / (2.0 * a)
    cruise = max(distance - change - peak**2 / (2.0 * a), 0.0)
    first = acceleration if peak >= velocity else -acceleration
    phases = [Phase(abs(peak - velocity) / a, first),
              Phase(cruise / peak if peak > 0.0 else 0.0, 0.0),
              Phase(peak / a, -acceleration)]
    return [phase for phase in phases if phase.duration > 0.0]


class Profile:
    """A motion being carried out: phases, consumed as time passes.

    motion : Motion at the start;  target : m, taken exactly once the last phase has ended
    """

    def __init__(self, motion, target, speed, acceleration):
        self.motion = motion
        self.target = target
        self._phases = plan(motion, target, speed, acceleration)

    @property
    def done(self):
        """True once at rest at the target."""
        return not self._phases

    def advance(self, dt):
        """Move on by dt [s].

        Returns the pieces of constant acceleration that make it up, in order, as
        (Motion at the start of the piece, Phase); their durations add up to dt.
        """
        pieces = []
        while dt > 0.0 and self._phases:
            phase = self._phases[0]
            used = Phase(min(phase.duration, dt), phase.acceleration)
            pieces.append((self.motion, used))
            self.motion = self.motion.after(*used)
            dt -= used.duration
            self._consume(phase, used)
        if dt > 0.0:
            pieces.append((self.motion, Phase(dt, 0.0)))
        return pieces

    def _consume(self, phase, used):
        if used.duration < phase.duration:
            self._phases[0] = Phase(phase.duration - used.duration, phase.acceleration)
            return
        del self._phases[0]
        if not self._phases:
            self.motion = Motion(self.target, 0.0)


def lag_behind(y, pieces, time_constant):
    """Response of tau y' + y = u, where u is made of `pieces`; exact.

    y : output at the start [m];  pieces : as from `Profile.advance`;  time_constant : tau [s]
    Returns the output at the end. With u = p + v s + a s^2 / 2 the response is
    u - tau u' + tau^2 u'' plus a decaying exponential. It never passes an input that does not turn
    back, nor exceeds the input's speed and acceleration once it has settled.
    """
    tau = time_constant
    for start, phase in pieces:
        end = start.after(*phase)
        a = phase.acceleration
        if tau == 0.0:
            y = end.position
            continue
        gap = y - (start.position - tau * start.velocity + tau**2 * a)
        y = (end.position - tau * end.velocity + tau**2 * a
             + gap * np.exp(-phase.duration / tau))
    return y
