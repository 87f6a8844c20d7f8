"""When a stream departs from its prediction: cumulative sums of whitened residuals.

Residuals over their noise pass the filter that makes coloured noise white
(`noise_process.Colour`), and a
cumulative sum (CUSUM) of each channel and axis, upwards and downwards,

    C <- max(0, C + e - k - |w|),

e the innovation, k = 0.5 and |w| what the same filter makes of the errors that a good model may
have. An alarm is raised where C stays beyond a threshold h; its onset is when C last was zero.
In white noise a one-sided sum takes (exp(2 k b) - 2 k b - 1) / (2 k^2) samples on average to reach
h, b = h + 1.166, from which h follows.
Source: Page 1954, Biometrika 41:100; Siegmund 1985, Sequential Analysis, eq. 2.56 and sec. 10.2.
Test: diagnosis/test_monitor.py
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from arm_brachy.core.quantity import quantity
from arm_brachy.diagnosis.signals.force_axes import IN_LINE, measured_axes, reading_axis
from arm_brachy.diagnosis.signals.noise import data_sheet_sd
from arm_brachy.diagnosis.statistics.noise_process import Colour

DRIFT = 0.5         # k: half of the shift [sd of an innovation] that is found soonest
OVERSHOOT = 1.166   # of a random walk beyond its threshold, above and below
ALONG = 3           # axis of a force sensor that has no other
AXES = ('x', 'y', 'z', 'its push')
SPIKE = 8.0         # sd that one sample stands out by from both its neighbours to be none
MOST = 2.0          # thresholds that a sum may reach, lest an alarm outlives its cause


@dataclass(frozen=True)
class Limits:
    """What counts as a mismatch."""

    per_hour: float = quantity(0.01, '', 'false alarms of a sound cell per hour, all channels',
                               low=1e-9, high=1e6, source='own choice: one in 100 hours')
    lasts: float = quantity(0.2, 's', 'time that a departure must last', low=0.0, high=60.0,
                            source='own choice: a glitch is no mismatch')
    zero: float = quantity(2.0, 's', 'time at the start from which offsets are taken', low=0.01,
                           high=600.0, source='own choice')
    share: float = quantity(0.05, '', 'error of the model over motion, or change of force, from '
                            'the start', low=0.0, high=1.0,
                            source='breast meshes: largest differences of markers, 5 %')
    clock: float = quantity(5.0, 'ms', 'error of the time of a sample', low=0.0, high=1e3,
                            source='own choice: half a period of trackers and encoders')


@dataclass(frozen=True)
class Watched:
    """A stream that is compared.

    names : c channels;  sd : (c, 3) of the noise, SI;  period : [s];  colour : Colour
    pushes : (c, 3) unit vectors, of forces: where a sensor has but one axis, it is compared along
        its push alone (`force_axes.reading_axis`); None = every axis is measured
    """

    names: tuple
    sd: np.ndarray
    period: float
    colour: Colour = Colour()
    pushes: np.ndarray | None = None


def watched(kind, names, params, pushes=None):
    """The Watched of a stream by the data sheet of its device.

    kind : stream.OPTICAL, EM or FORCE;  names : c channels;  params : devices.*Params
    pushes : as of Watched
    """
    colour = Colour(1.0, params.noise_correlation) if params.noise_correlation else Colour()
    sd = np.full((len(names), 3), data_sheet_sd(kind, params))
    return Watched(tuple(names), sd, 1.0 / params.rate, colour, pushes)


@dataclass(frozen=True)
class Alarm:
    """A departure from the prediction. axis : 0 to 2, or ALONG the push of the pad

    t : [s] when it was raised;  onset : [s] since when;  size : [m or N] mean since then
    """

    stream: str
    channel: str
    axis: int
    t: float
    onset: float
    size: float

    def __str__(self):
        unit, scale = ('N', 1.0) if self.stream == 'force' else ('mm', 1e3)
        return (f'{self.stream} {self.channel} is off its prediction by {scale * self.size:.2g} '
                f'{unit} along {AXES[self.axis]} since {self.onset:.2f} s')


def threshold(alarms, drift=DRIFT):
    """h at which a one-sided sum of white unit noise raises `alarms` false alarms per sample."""
    def excess(h):
        x = 2.0 * drift * (h + OVERSHOOT)
        return np.log((np.expm1(x) - x) / (2.0 * drift**2)) + np.log(alarms)
    return float(brentq(excess, 0.0, 300.0)) if excess(0.0) < 0.0 else 0.0


class _White:
    """The filter x_k - a x_{k-1} = E_k - m E_{k-1} of Colour, one step at a time; e = E / sd."""

    def __init__(self, colour, period, shape):
        self._sd, self._m = colour.innovation(period)
        self._a = np.exp(-period / colour.time) if colour.share else 0.0
        self._x, self._E = np.zeros(shape), np.zeros(shape)
        self._known = np.zeros(shape, dtype=bool)

    def step(self, x):
        """Innovations of x; zero where x or the sample before it is missing."""
        known = np.isfinite(x)
        E = x - self._a * self._x + self._m * self._E
        self._E = np.where(known & self._known, E, 0.0)
        self._x, self._known = np.where(known, x, 0.0), known
        return self._E / self._sd


class Channels:
    """Offsets, filters and sums of one stream.

    stream : its kind;  watched : Watched;  limits : Limits;  per_hour : false alarms of it
    active : (side, channel, axis) -> Alarm that has not ended
    """

    def __init__(self, stream, watched, limits, per_hour):
        self._stream, self._watched, self._limits = stream, watched, limits
        shape = np.shape(watched.sd)
        hourly = 2.0 * np.prod(shape) * 3600.0 / watched.period
        self._threshold = threshold(per_hour / hourly)
        self._white, self._allowed = (_White(watched.colour, watched.period, size)
                                      for size in (shape, (3, *shape)))
        self._zero, self._home, self._before, self._single = [], None, deque(maxlen=3), {}
        self._offset = self._shift = None
        self._sums, self._onset = np.zeros((2, *shape)), np.full((2, *shape), np.nan)
        self._total, self._count = np.zeros((2, *shape)), np.zeros((2, *shape))
        self.active = {}

    def take(self, t, values, expected):
        """The Alarms that a sample (c, 3) newly raises, given its prediction; a list."""
        if self._offset is None:
            self._collect(t, values, expected)
            return []
        left, expected = self._as_read(values, expected)
        self._before.append((t, left, expected))
        if len(self._before) < 3:
            return []
        (_, old, was), (t, left, there), (_, new, _) = self._before
        left = np.where(_spikes(old, left, new, SPIKE * self._watched.sd), np.nan, left)
        return self._add(t, left - self._offset, self._bias(there, was))

    def _as_read(self, values, expected):
        """(measured less predicted, predicted) (c, 3), NaN and zero where nothing is measured.

        Of a sensor of one axis the first of the three is that along the push, the others nothing.
        """
        if not self._single:
            return values - expected, expected
        left, there = values - expected, expected.copy()
        values = measured_axes(values[None])[0]
        for k, axis in self._single.items():
            push = self._watched.pushes[k]
            there[k] = expected[k] @ push, 0.0, 0.0
            left[k] = values[k] @ axis - there[k, 0], np.nan, np.nan
        return left, there

    def _single_axes(self, values):
        """Number of a channel -> (3,) its only axis, of values (n, c, 3) while it is zeroed.

        A sensor in a frame of its own, of which rest does not tell the sign, reads nothing yet.
        """
        if self._watched.pushes is None:
            return {}
        found, read = {}, measured_axes(values)
        for k, push in enumerate(self._watched.pushes):
            axis = reading_axis(read[np.isfinite(read[:, k]).all(axis=1), k], push)
            if axis is not None:
                found[k] = push if axis @ push >= IN_LINE else np.full(3, np.nan)
        return found

    def _collect(self, t, values, expected):
        self._zero.append((t, values, expected))
        if t - self._zero[0][0] < self._limits.zero:
            return
        self._single = self._single_axes(np.array([one for _, one, _ in self._zero]))
        pairs = [self._as_read(one, there) for _, one, there in self._zero]
        self._before.extend((when, *pair) for (when, *_), pair in zip(
            self._zero, pairs, strict=True))
        seen, self._home = (np.array(some) for some in zip(*pairs, strict=True))
        count = np.isfinite(seen).sum(axis=0)
        self._offset = np.where(count, np.nansum(seen, axis=0) / np.maximum(count, 1), np.nan)
        self._home = np.mean(self._home, axis=0)
        # Two standard deviations of the offsets' own error stay for good.
        self._shift = 2.0 * np.sqrt(self._watched.colour.mean_variance(
            count, self._watched.period))
        self._zero = []

    def _bias(self, there, was):
        """(3, c, 3) the largest errors of model, clocks and offsets, over the noise."""
        motion = np.linalg.norm(there - self._home, axis=1, keepdims=True)
        speed = np.linalg.norm(there - was, axis=1, keepdims=True) / self._watched.period
        errors = self._limits.share * motion, self._limits.clock * speed
        return np.stack([*(error / self._watched.sd for error in errors), self._shift])

    def _add(self, t, left, bias):
        e = self._white.step(left / self._watched.sd)
        errors = self._allowed.step(np.where(np.isfinite(left), bias, np.nan))
        slack = DRIFT + np.abs(errors).sum(axis=0)
        rise = np.stack([e - slack, -e - slack]) * np.isfinite(left)
        sums = np.clip(self._sums + rise, 0.0, MOST * self._threshold)
        begins, over = (self._sums == 0.0) & (sums > 0.0), sums == 0.0
        self._onset = np.where(begins, t, np.where(over, np.nan, self._onset))
        known = np.where(np.isfinite(left), left, 0.0)
        self._total = np.where(begins | over, 0.0, self._total) + known
        self._count = np.where(begins | over, 0.0, self._count) + np.isfinite(left)
        self._sums = sums
        return self._raise(t)

    def _raise(self, t):
        for key in [key for key in self.active if self._sums[key] == 0.0]:
            del self.active[key]
        lasting = t - self._onset >= self._limits.lasts     # False where there is no onset
        raised = []
        for key in map(tuple, np.argwhere((self._sums > self._threshold) & lasting)):
            if key not in self.active:
                size = float(self._total[key] / max(self._count[key], 1.0))
                axis = ALONG if key[1] in self._single else int(key[2])
                self.active[key] = Alarm(self._stream, self._watched.names[key[1]], axis, float(t),
                                          float(self._onset[key]), size)
                raised.append(self.active[key])
        return raised


def _spikes(old, this, new, far):
    """True where a sample stands out from both neighbours to the same side by more than `far`."""
    up, down = this - old, this - new
    return (np.minimum(up, down) > far) | (np.maximum(up, down) < -far)
