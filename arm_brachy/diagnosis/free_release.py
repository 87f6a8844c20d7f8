"""A body that was held and let go, as a recording shows it: when, how it rings, where it settles.

A recording is reduced to numbers that a model gives without integration in time: where every
marker settles, how it still creeps then, and one frequency, damping ratio and shape of ringing.
Test: diagnosis/test_free_release.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.registration import FIRST
from arm_brachy.diagnosis.stream import BASE, EM, OPTICAL, TISSUE
from arm_brachy.evaluation.ringing import ringing

DEPARTED = 0.05     # of the whole way, from where it was held: it has been let go
LOUD = 8.0          # standard deviations of noise that count as a departure
CLEAR = 0.03        # s before that which are no hold any more
STILL = 0.005       # of its first amplitude: what rings no more
QUIET = 0.05        # of it: what is left of one mode is worth no fit
PARTS = 3           # windows over the settled stretch: enough for a rate and its change
FEWEST = 30         # frames that show every channel, fewer are no motion to fit
PERIODS = 3.0       # of ringing, fewer have no frequency
BROKEN = 20.0       # times what a sound base may move: a marker of it has come off
APART = 4.0         # times the spread of the others
LEAST_WAY = 10.0    # standard deviations of noise that it must have gone


@dataclass(frozen=True)
class Ring:
    """x(t) = Re[shape A exp(-zeta w t + i w_d t)], w_d^2 = (1 - zeta^2) w^2, all channels alike.

    frequency [Hz], damping : ratio;  shape : (k, 3) of unit norm, along the way it settled
    amplitude : A [m] at the beginning;  each `_sd` : half of what the earlier and the later half
        of the ringing differ by, for that is what one mode does not describe
    left : [m] rms per axis of what the mode leaves;  span : (start, end) [s] after the release
    """

    frequency: float
    damping: float
    shape: np.ndarray
    amplitude: float
    frequency_sd: float
    damping_sd: float
    shape_sd: float
    left: float
    span: tuple


@dataclass(frozen=True)
class Release:
    """One recording of a body that was let go at `t` [s]; k channels on the tissue, b on the base.

    since : (n,) [s] after the release;  path : (n, k, 3) [m] from where it was held, NaN = unseen
    times : (w,) [s] middles of the settled windows;  moved : (w, k, 3), base : (w, b, 3) [m]
    noise : (k, 3) [m] of one sample;  count : (w,) samples worth of each window
    base_rest : (b, 3) [m];  ring : Ring, None if it does not ring
    odd : (name, (3,) [m]) of a base marker that moved against all others and is left out
    """

    name: str
    kind: str
    names: tuple
    t: float
    since: np.ndarray
    path: np.ndarray
    times: np.ndarray
    moved: np.ndarray
    base: np.ndarray
    base_rest: np.ndarray
    noise: np.ndarray
    count: np.ndarray
    ring: Ring | None
    odd: tuple | None = None


def release_of(prepared):
    """Return the Release of a prepared.Prepared recording without pads.

    From the markers on the tissue, or the EM tools where there are none; from the markers on the
    base how far the base went along. Raises RecordingError if nothing was let go in it.
    """
    kind = OPTICAL if prepared.on(OPTICAL, TISSUE)[0] is not None else EM
    stream, noise = prepared.on(kind, TISSUE)
    if stream is None:
        raise RecordingError(f'{prepared.evidence.name}: no marker and no EM tool on the tissue; '
                             'nothing says how the body moved; record one')
    at = _release(stream, noise.sd, prepared.evidence.name)
    held = (stream.t > at - CLEAR - FIRST) & (stream.t < at - CLEAR)
    if not held.any():
        held = stream.t < at
    path = stream.values - np.nanmean(stream.values[held], axis=0)
    since = stream.t - at
    ring = _ring(since, path)
    windows = _windows(since[-1], ring)
    base, rest, odd = _sound_base(*_base(prepared, at, windows), prepared.calibration.base)
    moved = np.stack([_mean(path[(since >= a) & (since <= b)]) for a, b in windows])
    count = np.array([noise.effective(np.sum((since >= a) & (since <= b))) for a, b in windows])
    return Release(prepared.evidence.name, kind, stream.names, float(at), since, path,
                   windows.mean(axis=1), moved, base, rest, noise.sd, count, ring, odd)


def _release(stream, sd, name):
    """Time [s] at which the body leaves where it was held."""
    held = stream.t < stream.t[0] + FIRST
    start = _mean(stream.values[held])
    end = _mean(stream.values[-max(len(stream.t) // 10, 1):])
    way, noise = np.linalg.norm(end - start, axis=1), np.linalg.norm(sd, axis=1)
    if not np.nanmax(way / noise) > LEAST_WAY:
        raise RecordingError(f'{name}: its markers end where they began, within '
                             f'{1e3 * LEAST_WAY * noise.max():.2g} mm; a body without pads must '
                             'be held, let go and settle; record the release too')
    far = np.linalg.norm(stream.values - start, axis=2)
    gone = np.flatnonzero((np.nan_to_num(far) > np.maximum(DEPARTED * np.nanmax(way),
                                                           LOUD * noise)).any(axis=1))
    return stream.t[max(gone[0] - 1, 0)]


def _mean(values):
    """Mean over frames, NaN for a channel that was seen in none."""
    seen = np.isfinite(values)
    count = seen.sum(axis=0)
    return np.where(count > 0, np.where(seen, values, 0.0).sum(axis=0) / np.maximum(count, 1),
                    np.nan)


def _ring(since, path):
    """Ring of a motion, None if there is none worth the name."""
    final = _mean(path[-max(len(path) // 10, 1):])
    whole = np.isfinite(path).all(axis=(1, 2)) & (since > 0.0)
    if whole.sum() < FEWEST:
        return None
    t, s = since[whole], (path - final)[whole].reshape(whole.sum(), -1)
    largest = int(np.nanargmax(np.linalg.norm(final, axis=1)))
    rough = ringing(t, path[whole, largest])
    if not (np.isfinite(rough.frequency) and 0.0 < rough.damping < 0.5):
        return None
    start = 1.0 / rough.frequency
    rate = 2.0 * np.pi * rough.frequency * rough.damping
    end = min(start - np.log(QUIET) / rate, t[-1])
    if (end - start) * rough.frequency < PERIODS:
        return None
    guess, middle = (rough.frequency, rough.damping), 0.5 * (start + end)
    one, early, late = (_mode(t, s, a, b, guess, final) for a, b in (
        (start, end), (start, middle), (middle, end)))
    half = [0.5 * np.abs(a - b) for a, b in zip(early[:2], late[:2], strict=True)]
    apart = 0.5 * float(np.sqrt(np.mean((early[2] - late[2]) ** 2)))
    return Ring(one[0], one[1], one[2], one[3], *half, apart, one[4], (start, end))


def _mode(t, s, start, end, guess, final):
    """(frequency, damping, shape, amplitude at the start, rms left) of one mode in a window."""
    rows = (t >= start) & (t <= end)
    t, s = t[rows] - start, s[rows]

    def split(p):
        basis = np.column_stack([oscillation(t, *p), np.ones_like(t), t])
        fit = np.linalg.lstsq(basis, s, rcond=None)[0]
        return s - basis @ fit, fit

    scale = np.abs(s).max()
    found = least_squares(lambda p: split(p)[0].ravel() / scale, guess, x_scale=guess,
                          bounds=([0.5 * guess[0], 1e-4], [2.0 * guess[0], 0.9]))
    left, fit = split(found.x)
    swing = fit[0] - 1j * fit[1]
    swing = swing * np.exp(-0.5j * np.angle(np.sum(swing ** 2)))    # most of it real
    real = swing.real.reshape(-1, 3)
    real = real if np.sum(real * final) >= 0.0 else -real
    size = np.linalg.norm(real)
    return (float(found.x[0]), float(found.x[1]), real / size, float(size),
            float(np.sqrt(np.mean(left ** 2))))


def oscillation(t, frequency, damping):
    """Columns (n, 2): the decaying cosine and sine of a mode at t (n,) [s]."""
    w = 2.0 * np.pi * frequency
    turn = w * np.sqrt(max(1.0 - damping ** 2, 1e-6)) * t
    return np.exp(-damping * w * t)[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])


def _windows(last, ring):
    """(w, 2) [s] after the release: parts of the stretch in which nothing rings."""
    if ring is None:
        return np.array([[0.8 * last, last]])
    period = 1.0 / ring.frequency
    start = -np.log(STILL) / (2.0 * np.pi * ring.frequency * ring.damping)
    lasts = int((last - start) / (PARTS * period))      # whole periods: what rings averages out
    if lasts < 1:
        return np.array([[max(last - 3.0 * period, 0.0), last]])
    edges = last - period * lasts * np.arange(PARTS, -1, -1)
    return np.column_stack([edges[:-1], edges[1:]])


def _base(prepared, at, windows):
    """Names of the base's markers, how far they went (w, b, 3) [m], their places (b, 3) [m]."""
    stream, _ = prepared.on(OPTICAL, BASE)
    if stream is None:
        return (), np.zeros((len(windows), 0, 3)), np.zeros((0, 3))
    since = stream.t - at
    held = (since > -CLEAR - FIRST) & (since < -CLEAR)
    rest = _mean(stream.values[held if held.any() else since < 0.0])
    moved = np.stack([_mean(stream.values[(since >= a) & (since <= b)]) - rest
                      for a, b in windows])
    seen = np.isfinite(moved).all(axis=(0, 2))
    names = tuple(n for n, here in zip(stream.names, seen, strict=True) if here)
    return names, moved[:, seen], stream.rest[seen]


def _sound_base(names, moved, rest, slack):
    """(moved, rest, odd): without the one marker that went far while all others stayed together.

    slack : [m] by which a sound base may move. Takes three markers. Of three it may also be the
    base that turned about the line through the other two, which no base does by half a millimetre.
    """
    last = moved[-1]
    for k, name in enumerate(names if len(names) >= 3 else ()):
        kept = np.delete(np.arange(len(names)), k)
        alone = last[k] - last[kept].mean(axis=0)
        spread = np.linalg.norm(last[kept] - last[kept].mean(axis=0), axis=1).max()
        if np.linalg.norm(alone) > max(BROKEN * slack, APART * spread):
            return moved[:, kept], rest[kept], (name, alone)
    return moved, rest, None
