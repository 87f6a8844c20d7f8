"""How a needle moves along its hole: by a motor at one speed, or by hand in strokes.

By a motor: trapezoids of `motion_profile`. By hand: strokes with pauses between them; each stroke
is a minimum-jerk motion, whose peak speed is 15/8 of its mean (Flash and Hogan 1985, J Neurosci
5:1688),
    s(u) = L u^3 (10 - 15 u + 6 u^2),  u = t / T,  T = 15 L / (8 v_peak)
and carries the tremor of the hand, a few sines of 8 to 12 Hz (Elble and Koller 1990, Tremor),
under a window sin^2(pi u), so that each stroke begins and ends at rest. Length, peak speed and
pause are drawn from lognormal distributions whose means are the parameters.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from arm_brachy.core.quantity import quantity, word
from arm_brachy.devices.motion_profile import Motion

_PEAK = 15.0 / 8.0           # peak over mean speed of a minimum-jerk motion
_TREMOR = (8.0, 12.0)        # Hz
_SINES = 3                   # that make up the tremor
_LAST = 0.25                 # of a stroke: what would be left shorter is added to the one before


@dataclass(frozen=True)
class InsertionProfile:
    """How a needle is driven."""

    by: Literal['motor', 'hand'] = word('who drives it', default='motor')
    speed: float = quantity(10.0, 'mm_s', 'by a motor the largest speed, by hand the mean of the '
                            "strokes' maxima; a command may give another", low=0.1, high=200.0,
                            source='robotic insertion: 5 to 20 mm/s; clinical hands: 123 mm/s, '
                                   '48 mm/s on average; the thesis prints none')
    acceleration: float = quantity(20.0, 'mm_s2', 'of the motor on a planned way, and at its end',
                                   low=1.0, high=1e5,
                                   source='own choice: 5 mm/s in 0.25 s, which a probe that '
                                          'hears of the tip 70 ms late can follow')
    braking: float = quantity(200.0, 'mm_s2', 'of a hold', low=1.0, high=1e5,
                              source='5 mm/s in 25 ms (engineering judgement)')
    stroke: float = quantity(15.0, 'mm', 'mean length of one stroke by hand', low=1.0, high=100.0,
                             source='engineering judgement')
    pause: float = quantity(0.6, 's', 'mean pause between strokes by hand', low=0.0, high=10.0,
                            source='engineering judgement: a glance at the screen; 0.08 s gives '
                                   "the clinical hands' average of 48 mm/s at 123 mm/s")
    variation: float = quantity(0.2, '', 'standard deviation of length, speed and pause over '
                                'their means', low=0.0, high=1.0, source='engineering judgement')
    tremor: float = quantity(0.05, 'mm', 'rms displacement in the middle of a stroke', low=0.0,
                             high=2.0, source='hands at rest: some hundredths of a millimetre at '
                                              '8 to 12 Hz (engineering judgement)')


class _Stroke(NamedTuple):
    """begin, lasts : s;  start, length : m;  rates : (k,) rad/s, phases : (k,) of the tremor."""

    begin: float
    lasts: float
    start: float
    length: float
    rates: np.ndarray
    phases: np.ndarray


class HandMotion:
    """A needle on its way by hand; has the face of `motion_profile.Profile`.

    motion : Motion at the start, at rest;  target : [m];  speed : [m/s] mean of the maxima
    profile : InsertionProfile;  rng : numpy Generator, drawn from here and never later
    """

    def __init__(self, motion, target, speed, profile, rng):
        self.motion, self.target = motion, target
        self._t, self._profile = 0.0, profile
        self._strokes, self._end = _strokes(motion.position, target, speed, profile, rng)

    @property
    def done(self):
        """True once at rest at the target."""
        return self._t >= self._end

    def advance(self, dt):
        """Move on by dt [s]; how time is cut makes no difference."""
        self._t += dt
        self.motion = Motion(self.target, 0.0) if self.done else self._at(self._t)

    def _at(self, t):
        stroke = next(s for s in reversed(self._strokes) if s.begin <= t)
        u = min((t - stroke.begin) / stroke.lasts, 1.0)
        rate = 1.0 / stroke.lasts
        position = stroke.start + stroke.length * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        velocity = 30.0 * stroke.length * rate * (u * (1.0 - u))**2
        window, slope = np.sin(np.pi * u)**2, np.pi * rate * np.sin(2.0 * np.pi * u)
        angle = stroke.rates * t + stroke.phases
        level = self._profile.tremor * np.sqrt(2.0 / _SINES)
        sway, swing = np.sin(angle).sum(), (stroke.rates * np.cos(angle)).sum()
        return Motion(float(position + level * window * sway),
                      float(velocity + level * (slope * sway + window * swing)))


def _strokes(start, target, speed, profile, rng):
    """Return the strokes from start to target [m], and when the last one ends [s]."""
    strokes, t, at = [], 0.0, start
    sense = np.sign(target - start)
    while at != target:
        length = profile.stroke * _about_one(profile, rng)
        left = abs(target - at)
        if left < (1.0 + _LAST) * length:
            length = left
        lasts = _PEAK * length / (speed * _about_one(profile, rng))
        strokes.append(_Stroke(t, lasts, at, sense * length,
                               2.0 * np.pi * rng.uniform(*_TREMOR, _SINES),
                               rng.uniform(0.0, 2.0 * np.pi, _SINES)))
        t += lasts
        at = target if length == left else at + sense * length
        end, t = t, t + profile.pause * _about_one(profile, rng)
    return strokes, end if strokes else 0.0


def _about_one(profile, rng):
    """A lognormal variable of mean 1 and standard deviation `variation`."""
    variance = np.log1p(profile.variation**2)
    return float(np.exp(np.sqrt(variance) * rng.standard_normal() - 0.5 * variance))
