"""Noise of every stream, from the stretches in which nothing moves, or from the data sheet."""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.devices.actuator_driver import ActuatorParams
from arm_brachy.devices.em_tracker import EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensorParams
from arm_brachy.devices.optical_tracker import OpticalParams
from arm_brachy.diagnosis.signals.motion import motion_of
from arm_brachy.diagnosis.signals.quantisation import quantum
from arm_brachy.diagnosis.signals.registration import FIRST
from arm_brachy.diagnosis.signals.rest_noise import over_rests
from arm_brachy.diagnosis.signals.rests import (
    ENOUGH_IDLE,
    SETTLING,
    excess,
    rest_spans,
    undisturbed,
)
from arm_brachy.diagnosis.signals.stream import EM, ENCODER, FORCE, OPTICAL, TISSUE
from arm_brachy.diagnosis.statistics.noise_process import (
    LONGEST_LAG,
    Colour,
    fit_colour,
    lags_for,
    pieces,
    variogram,
)

LATER_PART = 0.5     # of a later stretch that is taken: its end, when the tissue has settled
LEAST_IDLE = 20      # samples of idle below which the data sheet is asked
SILENT = 1e-3        # of the data sheet's noise: no sensor has less
PRIOR_SAMPLES = 30   # idle samples that the pooled variance of a stream counts for
DEPARTED, CLEAR = 0.1, 0.05     # of its largest way, and s before that, which are no hold any more
QUIETER = 0.5        # times the variance of its end, for the time in which it is held to be taken
STILL_SHARE = 0.2    # of what follows the release of a body without pads: it has come to rest


@dataclass(frozen=True)
class Noise:
    """Noise of one stream.

    sd : (k, c) per channel and axis, SI;  colour : Colour, one for the stream
    period : [s] between samples;  axes : (c, c) correlation between axes, pooled over channels
    source : 'idle' or 'data sheet';  idle : [s] of idle that it was taken from
    notes : sentences;  doubt : times that, the variance of means may be for all that rests tell
    count : [SI] step between the values of its coarsest axis, 0 if none is digitised
    """

    sd: np.ndarray
    colour: Colour
    period: float
    axes: np.ndarray
    source: str
    idle: float = 0.0
    notes: tuple = ()
    doubt: float = 1.0
    count: float = 0.0

    def turned(self, rotation):
        """The Noise of vectors that are turned by a matrix (3, 3)."""
        each = self.sd[:, :, None] * self.axes * self.sd[:, None, :]
        each = rotation @ each @ rotation.T
        sd = np.sqrt(np.diagonal(each, axis1=1, axis2=2))
        pooled = each.mean(axis=0)
        size = np.sqrt(np.diag(pooled))
        return replace(self, sd=sd, axes=pooled / np.outer(size, size))

    def own_axes(self, k):
        """(axes (c, c), columns, sd (c,)) along which noise of channel k is not correlated."""
        power, axes = np.linalg.eigh(self.sd[k][:, None] * self.axes * self.sd[k])
        return axes, np.sqrt(np.maximum(power, 0.0))

    def mean_variance(self, count):
        """Variance of means over `count` (..., k) successive samples, (..., k, c)."""
        factor = self.colour.mean_variance(count, self.period)
        return np.asarray(factor)[..., None] * self.sd ** 2

    @property
    def rounding(self):
        """[SI] rms error of the count, which lasts as long as nothing moves."""
        return self.count / np.sqrt(12.0)

    def effective(self, count):
        """Number of independent samples that `count` successive ones are worth."""
        return 1.0 / self.colour.mean_variance(count, self.period)

    def between(self, t, count):
        """Correlation (m, m) between means at centres t (m,) [s] over `count` (m,) samples.

        Off the diagonal only the slow part counts, taken as constant over each window: good while
        the windows are short against the time between them or the memory of the noise.
        """
        own = self.colour.mean_variance(count, self.period)
        slow = self.colour.correlation(t[:, None] - t[None, :])
        out = slow / np.sqrt(own[:, None] * own[None, :])
        out = np.minimum(out, 0.99)
        np.fill_diagonal(out, 1.0)
        return out


def noise_of(evidence, devices=None, colours=None, events=()):
    """Noise of every stream of an Evidence, kind -> Noise.

    devices : mapping kind -> parameters of the device (devices.*Params), for the data sheet;
        None = their defaults
    colours : kind -> Colour that is known from elsewhere, None = none
    events : [s] at which something happened that sets off what follows
    Idle is the time before the first push, and if that is less than 5 s also the second half of
    the later stretches in which the pads stand; of a body without pads it is the time in which it
    is held or the last fifth of what follows its fastest motion, whichever is clearly the quieter:
    a hand may hold it, and it may ring until the end. What may be creep is taken out as a
    parabola. Noise that outlasts such stretches shows between rests without a push, if these are
    the idle (`over_rests`); how much more they differ is left in doubt (`excess`). Variances of
    channels are pooled, the pool weighing 30 samples; an encoder that shows no noise has that of
    its quantisation.
    """
    spans, out = idle_spans(evidence), {}
    rests = undisturbed(rest_spans(evidence), events)
    for kind, stream in evidence.streams.items():
        noise = _noise(stream, spans, rests, devices or {}, (colours or {}).get(kind),
                       _witness(evidence) if kind == EM else None)
        out[kind] = replace(noise, doubt=excess(stream, noise, rests), count=coarsest(stream))
    return out


def idle_spans(evidence):
    """Stretches in which nothing moves, by the encoders: tuples (t_start, t_end, settled) [s].

    settled : False after a motion, when the tissue may still creep
    """
    motion = motion_of(evidence)
    if motion is None:
        released, end = _fastest(evidence), evidence.span[1]
        held = (evidence.span[0], _departure(evidence), False)
        last = (end - STILL_SHARE * (end - released), end, False)
        quieter = _restless(evidence, *held[:2]) < QUIETER * _restless(evidence, *last[:2])
        return (held if quieter else last,)
    first = evidence.get(ENCODER).t[0]
    spans = []
    for start, end, _ in motion.stills():
        settled = start == first
        if not settled:
            start = max(start + SETTLING, end - LATER_PART * (end - start))
        if end > start:
            spans.append((start, end, settled))
        if settled and end - start >= ENOUGH_IDLE:
            break
    return tuple(spans)


def _restless(evidence, start, end):
    """Variance [SI] of what is seen from `start` to `end` [s], a parabola taken out, the mean over
    channels; infinite where too little is seen.
    """
    stream = _first_stream(evidence)
    rows = slice(*np.searchsorted(stream.t, (start, end)))
    values = stream.values[rows].reshape(-1, stream.values[0].size)
    values = values[:, np.isfinite(values).sum(axis=0) >= LEAST_IDLE]
    if not values.size:
        return np.inf
    powers = np.vander(np.linspace(-1.0, 1.0, len(values)), 3)
    left = [np.linalg.lstsq(powers[seen], column[seen], rcond=None)[1] / (seen.sum() - 3)
            for column in values.T for seen in (np.isfinite(column),)]
    return float(np.mean(np.concatenate(left)))


def _departure(evidence):
    """Time [s] up to which a body without pads is held: before its first tenth of the way."""
    stream = _first_stream(evidence)
    first = np.ma.masked_invalid(stream.values[stream.t < stream.t[0] + FIRST]).mean(axis=0)
    far = np.nan_to_num(np.linalg.norm(stream.values - first.filled(np.nan), axis=2))
    gone = (far > DEPARTED * far.max()).any(axis=1)
    return float(stream.t[int(np.argmax(gone))] - CLEAR)


def _first_stream(evidence):
    return next(evidence.streams[kind] for kind in (OPTICAL, EM, FORCE)
                if kind in evidence.streams)


def _fastest(evidence):
    """Time [s] within the span at which a body without pads moves fastest: it was let go there."""
    stream = _first_stream(evidence)
    steps = np.linalg.norm(np.nan_to_num(np.diff(stream.values, axis=0)), axis=2).sum(axis=1)
    return float(np.clip(stream.t[int(np.argmax(steps))], *evidence.span))


def _witness(evidence):
    """The optical Stream of markers on the tissue, None without."""
    optical = evidence.get(OPTICAL)
    return None if optical is None else optical.channels(optical.on(TISSUE))


def _noise(stream, spans, rests, devices, known, witness=None):
    """Noise of a Stream; known : its Colour, None = to be found;  witness : as `over_rests`."""
    stretches = [piece for start, end, settled in spans for piece in pieces(
        int(np.searchsorted(stream.t, start)), int(np.searchsorted(stream.t, end)), settled)]
    seen = sum(int(stream.valid[s.start:s.stop].any(axis=1).sum()) for s in stretches)
    if seen < LEAST_IDLE:
        return _data_sheet(stream, devices, f'Only {seen} samples of {stream.kind} are idle; its '
                           'noise is taken from the data sheet. Rest a second before the first '
                           'push.')
    k, c = stream.values.shape[1:]
    longest = max(s.stop - s.start for s in stretches)
    lags = lags_for(int(LONGEST_LAG * longest))
    gamma, pairs = variogram(stream.values.reshape(len(stream.t), -1),
                             np.repeat(stream.valid, c, axis=1), lags, stretches)
    if not pairs[0].any():
        return _data_sheet(stream, devices, f'No two samples of {stream.kind} follow each other '
                           'at rest; its noise is taken from the data sheet.')
    short = _shrunk(gamma[0].reshape(k, c), pairs[0].reshape(k, c))
    if known is None:
        colour, ratio = over_rests(stream, rests, witness) or _pooled_colour(
            gamma, pairs, lags, short.ravel(), stream.period, stretches)
    else:
        colour, ratio = known, 1.0 / (1.0 - known.correlation(stream.period))
    floor = quantum(stream.values[np.isfinite(stream.values)]) / np.sqrt(12.0)
    if floor ** 2 > short.max() * ratio:   # what is seen are single counts, not noise
        colour = Colour()
    idle = sum(float(stream.t[s.stop - 1] - stream.t[s.start]) for s in stretches)
    floor = max(floor, SILENT * data_sheet_sd(stream.kind, devices.get(stream.kind)))
    return Noise(np.maximum(np.sqrt(short * ratio), floor), colour, stream.period,
                 _axes(stream, stretches), 'idle', idle)


def _shrunk(gamma, pairs):
    """Short-lag variance (k, c) of each channel, drawn towards that of all, axis by axis."""
    weight = np.where(np.isfinite(gamma), pairs, 0)
    total = np.maximum(weight.sum(axis=0), 1)
    common = np.nansum(np.where(weight > 0, gamma, 0.0) * weight, axis=0) / total
    own = np.where(weight > 0, gamma, 0.0)
    return (own * weight + PRIOR_SAMPLES * common) / (weight + PRIOR_SAMPLES)


def _pooled_colour(gamma, pairs, lags, short, period, stretches):
    """Colour of the stream, and total variance over that at the shortest lag."""
    loud = short > 0.0
    if not loud.any():
        return Colour(), 1.0
    known = np.isfinite(gamma[:, loud])
    relative = np.where(known, gamma[:, loud], 0.0) / short[loud]
    weight = np.where(known, pairs[:, loud], 0)
    total = weight.sum(axis=1)
    pooled = np.where(total > 0, np.sum(relative * weight, axis=1) / np.maximum(total, 1), np.nan)
    colour, variance = fit_colour(pooled, total, lags, period, stretches)
    return colour, max(variance, 1.0)


def _axes(stream, stretches):
    """Correlation (c, c) between axes of successive differences, pooled over channels."""
    c = stream.values.shape[2]
    steps = np.concatenate([np.diff(stream.values[s.start:s.stop], axis=0) for s in stretches])
    steps = steps.reshape(-1, c)
    steps = steps[np.isfinite(steps).all(axis=1)]
    square = steps.T @ steps
    size = np.sqrt(np.diag(square))
    if len(steps) < LEAST_IDLE or not size.all():
        return np.eye(c)
    return square / np.outer(size, size)


def coarsest(stream):
    """Quantum of the axis of a Stream that is digitised most coarsely [SI], 0 if none is."""
    axes = np.moveaxis(stream.values, 2, 0)
    return max(quantum(axis[np.isfinite(axis)]) for axis in axes)


def _data_sheet(stream, devices, note):
    sd = data_sheet_sd(stream.kind, devices.get(stream.kind))
    c = stream.values.shape[2]
    return Noise(np.full(stream.values.shape[1:], sd), _sheet_colour(stream, devices),
                 stream.period, np.eye(c), 'data sheet', notes=(note,))


def _sheet_colour(stream, devices):
    time = getattr(devices.get(stream.kind), 'noise_correlation', 0.0)
    return Colour(1.0, time) if time > 0.0 else Colour()


def data_sheet_sd(kind, params=None):
    """Standard deviation per axis [SI] that a device's parameters declare.

    params : devices.*Params of that kind; None = its defaults
    """
    if kind == ENCODER:
        return (params or ActuatorParams()).encoder_resolution / np.sqrt(12.0)
    if kind == FORCE:
        return (params or ForceSensorParams()).noise
    if kind == EM:
        return (params or EmTrackerParams()).position_noise / np.sqrt(3.0)
    if kind == OPTICAL:
        return (params or OpticalParams()).noise / np.sqrt(3.0)
    raise KeyError(kind)
