"""A periodic part common to several series: breathing, a pump, a swinging frame."""

from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from arm_brachy.diagnosis.isolation.force_bias import unloaded
from arm_brachy.diagnosis.results.finding import ALARM, Finding, threshold
from arm_brachy.diagnosis.signals.regressors import drift_columns, history_columns
from arm_brachy.diagnosis.signals.stream import BASE, OPTICAL, TISSUE, thinned
from arm_brachy.diagnosis.statistics.gls import bridged, regress
from arm_brachy.diagnosis.statistics.noise_process import residual_colour

SLOWEST_CYCLES = 4.0    # in the recording: fewer are a drift
SLOWEST = 0.08          # Hz: slower is no breath
AROUND = 5              # independent frequencies on either side that make up the background
FINENESS = 4            # frequencies tried per independent one
FASTEST = 3.0           # Hz: breathing 0.2, heart 1.2
BIN = 0.1               # s
FEWEST = 20             # samples
MOSTLY = 0.7            # of the time that a marker must have been seen


@dataclass(frozen=True)
class Rhythm:
    """cosine, sine : (s,) of every series, times in s from 0;  chance : of noise doing as much."""

    frequency: float
    cosine: np.ndarray
    sine: np.ndarray
    chance: float

    @property
    def amplitude(self):
        """(s,) of every series."""
        return np.hypot(self.cosine, self.sine)


def rhythm(t, series, sd, columns, colour):
    """The strongest common sinusoid of series (n, s) beside the regressors `columns` (n, p).

    t : (n,) [s], even;  sd : (s,) of the noise;  colour : noise_process.Colour
    At every frequency the fall of chi^2 by a cosine and a sine in every series is chi-square with
    2 s degrees of freedom if there is noise alone; `chance` multiplies its tail by the number of
    independent frequencies (Scargle 1982, Astrophys J 263:835). Where the median fall of the
    frequencies around is larger than that of noise, the fall is scaled down by it: a rhythm is a
    line, not a broad hump. None if the recording is too short. Values that were not seen have to
    be filled beforehand.
    """
    span, period, dof = t[-1] - t[0], float(np.median(np.diff(t))), 2 * series.shape[1]
    low, high = max(SLOWEST_CYCLES / span, SLOWEST), min(FASTEST, 0.4 / period)
    if high <= low:
        return None
    Q = np.linalg.qr(colour.whiten(period, columns))[0]
    Y = colour.whiten(period, series / sd)
    frequency, fall = _spectrum(period, colour, Q, Y - Q @ (Q.T @ Y), low, high)
    total = fall.sum(axis=1)
    around = median_filter(total, size=2 * AROUND * FINENESS + 1, mode='nearest')
    total = total / np.maximum(around / chi2.median(dof), 1.0)
    best = int(np.argmax(total))
    chance = min(1.0, (high - low) * span * chi2.sf(total[best], dof))
    peak = _refined(t, colour.whiten, Q, Y - Q @ (Q.T @ Y), frequency, best)
    phase = 2.0 * np.pi * peak * t
    named = {str(i): c for i, c in enumerate(columns.T)}
    fit = regress(t, series, named | {'cosine': np.cos(phase), 'sine': np.sin(phase)},
                  np.ones(len(t), dtype=bool), colour, sd)
    return Rhythm(peak, fit.value[-2], fit.value[-1], float(chance))


def _spectrum(period, colour, Q, Y, low, high):
    """Frequencies (m,) and, about, the falls of chi^2 (m, s) by a wave at each.

    Inner products with whitened waves are Fourier transforms of the data sent backwards through
    the whitening filter; what the regressors (n, p), orthonormal, take of the waves is subtracted.
    How the filter starts is left out, which matters little against many periods.
    """
    n = len(Y)
    size = next_fast_len(FINENESS * n)
    back = np.concatenate([Q, Y], axis=1)[::-1]
    F = np.fft.rfft(colour.whiten(period, back)[::-1], size, axis=0)
    frequency = np.fft.rfftfreq(size, period)
    keep = (frequency >= low) & (frequency <= high)
    inner = np.stack([F.real, -F.imag], axis=1)[keep]
    A, match = inner[:, :, :Q.shape[1]], inner[:, :, Q.shape[1]:]
    response = np.abs(np.fft.rfft(colour.whiten(period, np.eye(1, n)[0]), size)[keep]) ** 2
    gram = 0.5 * n * response[:, None, None] * np.eye(2) - A @ A.transpose(0, 2, 1)
    waves = np.linalg.solve(gram, match)
    return frequency[keep], np.sum(match * waves, axis=1)


def _refined(t, whiten, Q, Y, frequency, best):
    """Frequency between the neighbours of frequency[best] whose wave takes most from Y (n, s).

    Left on the grid it would be off by up to an eighth of 1 / span, a sixteenth of a turn at
    either end. It is known to the Cramer-Rao bound then.
    Test: diagnosis/structural/test_rhythm.py
    """
    period = float(np.median(np.diff(t)))

    def left(f):
        phase = 2.0 * np.pi * f * t
        waves = whiten(period, np.stack([np.cos(phase), np.sin(phase)], axis=1))
        waves = np.linalg.qr(waves - Q @ (Q.T @ waves))[0]
        return -float(np.sum(np.square(waves.T @ Y)))

    ends = frequency[max(best - 1, 0)], frequency[min(best + 1, len(frequency) - 1)]
    return float(minimize_scalar(left, bounds=ends, method='bounded',
                                 options={'xatol': 1e-4 * (ends[1] - ends[0])}).x)


@dataclass(frozen=True)
class Swinging:
    """What moves in rhythm: stream.Stream of the `body`'s markers, stream.BASE or TISSUE."""

    body: str
    stream: object
    rhythm: Rhythm


def swinging(prepared, travel, late, jumps=()):
    """The Swinging of base markers, else of the tissue beside its pushes, None if nothing does.

    travel : (t, q (m, p));  late : [s] of the optical clock;  jumps : times [s] of sudden events
    What a repeated protocol leaves unexplained is periodic too: the motion has to be there while
    nothing pushes as well, with the same frequency and half the amplitude or more.
    """
    for body in (BASE, TISSUE):
        stream, noise = prepared.on(OPTICAL, body)
        if stream is None:
            continue
        stream = thinned(stream, max(BIN, stream.period)) if stream.period < BIN else stream
        stream = stream.channels(np.flatnonzero(stream.valid.mean(axis=0) > MOSTLY))
        if not len(stream.names) or len(stream.t) < FEWEST:
            continue
        columns = {'1': np.ones(len(stream.t))} | drift_columns(stream.t) | history_columns(
            stream.t - late, travel, prepared.motion.touch, memory=False)
        columns |= {f'jump {time}': (stream.t >= time).astype(float) for time in jumps}
        found = _common(prepared, stream, np.stack(list(columns.values()), axis=1), noise)
        if found is not None:
            return Swinging(body, stream, found)
    return None


def _common(prepared, stream, X, noise):
    """The Rhythm of all components of a stream, if it also shows while nothing pushes."""
    n, k, c = stream.values.shape
    series = np.concatenate([bridged(stream.t, stream.values[:, i], stream.valid[:, i], X,
                                     noise.colour) for i in range(k)], axis=1)
    sd = np.full(k * c, float(noise.sd.mean()) / np.sqrt(max(stream.period / noise.period, 1.0)))
    left = series - X @ np.linalg.lstsq(X, series, rcond=1e-8)[0]
    everywhere = np.ones(n, dtype=bool)
    colour, louder = residual_colour(stream.t, left, everywhere, noise.colour, sd[0])
    found = rhythm(stream.t, series, louder, X, colour)
    idle = unloaded(prepared, stream.t)
    if found is None or found.chance > ALARM or idle.sum() < FEWEST:
        return None
    phase = 2.0 * np.pi * found.frequency * stream.t[idle]
    wave = np.stack([np.ones(idle.sum()), np.cos(phase), np.sin(phase)], axis=1)
    there = np.linalg.norm(np.linalg.lstsq(wave, left[idle], rcond=None)[0][1:], axis=0)
    return found if there @ found.amplitude > 0.5 * found.amplitude @ found.amplitude else None


def rhythm_findings(swings, slack):
    """The common motion of a Swinging's markers as Findings, none if it is no louder than allowed.

    slack : finding.Calibration.restless
    Test: diagnosis/structural/test_rest.py
    """
    found, stream, body = swings.rhythm, swings.stream, swings.body
    cosine, sine = (x.reshape(-1, 3).mean(axis=0) for x in (found.cosine, found.sine))
    U, size, Vt = np.linalg.svd(np.stack([cosine, sine]))
    amplitude, direction = float(size[0]), Vt[0]
    z = amplitude / slack
    if z <= threshold(2):
        return []
    what = 'base' if body == BASE else 'tissue'
    phase = float(np.arctan2(cosine @ direction, sine @ direction))
    return [Finding(OPTICAL, body, 'breathing', 'amplitude', amplitude, 'm', slack, z,
                    float(stream.t[0]), float(stream.t[-1]),
                    f'Markers on the {what} move in rhythm, {found.frequency:.2f} times a second '
                    f'by {1e3 * amplitude:.2f} mm to either side, whether or not something '
                    'pushes.', parameters={'amplitude': amplitude, 'frequency': found.frequency,
                                           'phase': phase, 'direction': tuple(direction)})]
