"""When a device samples: exact times on a nanosecond grid, and the truth at those times."""

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import ConfigError

NANOSECONDS = 10**9
# Rates are taken as ratios with a denominator up to this: 29.97 Hz is 2997/100, not a float.
_MAX_DENOMINATOR = 1000


class Instant(NamedTuple):
    """One acquisition.  number : frame number, from 0;  ns : int, time in nanoseconds."""

    number: int
    ns: int

    @property
    def t(self):
        """Time [s]; the float nearest to the exact value."""
        return self.ns / NANOSECONDS


def to_ns(t):
    """Seconds to integer nanoseconds (nearest)."""
    return round(t * NANOSECONDS)


@dataclass(frozen=True)
class SampleTimes:
    """Acquisition times t_k = phase + k / rate, k = 0, 1, ..., in integer arithmetic: no drift.

    rate : Hz, > 0;  phase : s, >= 0, time of frame 0
    Raises ConfigError on a rate or phase out of range.
    """

    rate: float
    phase: float = 0.0

    def __post_init__(self):
        if not (np.isfinite(self.rate) and self.rate >= 1.0 / _MAX_DENOMINATOR):
            raise ConfigError(f'sampling: rate_Hz = {self.rate}; must be at least '
                              f'{1.0 / _MAX_DENOMINATOR}')
        if not (np.isfinite(self.phase) and self.phase >= 0.0):
            raise ConfigError(f'sampling: phase_s = {self.phase}; must be >= 0')

    def at(self, number):
        """Return the Instant of frame `number`, truncated to the nanosecond below."""
        rate = self._ratio
        return Instant(number, to_ns(self.phase)
                       + number * NANOSECONDS * rate.denominator // rate.numerator)

    def between(self, t0, t1):
        """Return the Instants in (t0, t1] [s], in order."""
        first, end = self._first_after(to_ns(t0)), self._first_after(to_ns(t1))
        return [self.at(k) for k in range(first, end)]

    @cached_property
    def _ratio(self):
        return Fraction(self.rate).limit_denominator(_MAX_DENOMINATOR)

    def _first_after(self, ns):
        """Smallest frame number whose time is later than ns."""
        rate = self._ratio
        since = ns - to_ns(self.phase)
        # t_k is rounded down, so the exact quotient can be one frame short, never past the answer
        k = max(since * rate.numerator // (NANOSECONDS * rate.denominator), 0)
        while self.at(k).ns <= ns:
            k += 1
        return k


def fraction(instant, t0, t1):
    """Return where `instant` lies between t0 and t1, in (0, 1]."""
    return (instant.ns - to_ns(t0)) / (to_ns(t1) - to_ns(t0))


def lerp(value0, value1, f):
    """Return value0 + f (value1 - value0), a new float array, equal to value1 at f = 1.

    Valid while the motion between two ticks is straight: the error is at most
    acceleration dt^2 / 8.
    """
    if f == 1.0:
        return np.array(value1, dtype=float)
    value0 = np.asarray(value0, dtype=float)
    return value0 + f * (np.asarray(value1, dtype=float) - value0)


def slerp(rot0, rot1, f):
    """Return the rotation matrices (k, 3, 3) a fraction f along the shortest way."""
    if f == 1.0 or np.array_equal(rot0, rot1):
        return np.array(rot1, dtype=float)
    start = Rotation.from_matrix(rot0)
    step = (start.inv() * Rotation.from_matrix(rot1)).as_rotvec()
    return (start * Rotation.from_rotvec(f * step)).as_matrix()


def lateness(terms):
    """Return by how much sensing terms together put the stamps of a device late [s]."""
    return sum(term.lateness for term in terms)


class DelayLine:
    """Stamps samples and holds them from acquisition to delivery, a fixed latency later.

    times : SampleTimes of acquisition;  latency : s, >= 0
    late : s, by how much stamps are later than the acquisition; negative: earlier
    No sample is handed out before its stamp: where `late` exceeds the latency it takes its place.
    Samples with a stamp before time zero are never handed out; no message could carry them.
    """

    def __init__(self, times, latency, late=0.0):
        self.times = times
        self._late = to_ns(late)
        wait = max(to_ns(latency), self._late)
        self.delivery = SampleTimes(times.rate, (to_ns(times.phase) + wait) / NANOSECONDS)
        self._held = []

    def stamped(self, instant):
        """Return the Instant that a sample acquired at `instant` says it is of."""
        return instant._replace(ns=instant.ns + self._late)

    def exchange(self, samples, t0, t1):
        """Take in what was acquired in (t0, t1], hand out what is delivered in it, in order.

        samples : list of (frame number, sample)
        """
        self._held += [(number, s) for number, s in samples
                       if self.stamped(self.times.at(number)).ns >= 0]
        last = self.delivery.between(t0, t1)
        if not last:
            return []
        out = [s for number, s in self._held if number <= last[-1].number]
        self._held = [(number, s) for number, s in self._held if number > last[-1].number]
        return out
