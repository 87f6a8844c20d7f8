"""A body that was held and let go, as a recording shows it: when, how it rings, where it settles.

A recording is reduced to numbers that a model gives without integration in time: where every
marker settles, how it still creeps then, and one frequency, damping ratio and shape of ringing.
Test: diagnosis/test_free_release.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.signals.registration import FIRST
from arm_brachy.diagnosis.signals.stream import BASE, EM, OPTICAL, TISSUE
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
THINNEST = 8        # frames of a channel in either half of the ringing, fewer show no mode
UNSETTLED = 0.05    # of the whole way: what moves more in its last window has not settled
PARTS_RUNG = (1.0, 0.5, 0.25, 0.125, 0.0625)    # of a recording: a long rest hides what rings
LAST = 0.1          # of a recording: where its markers end
LONGEST_LAST = 1.0  # s of that at most: a long hold is no end


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
    held : (k, 3) [m] where each channel was held, from its place in the scene
    base_names : (b,), base_rest : (b, 3) [m], base_held : (b, 3) [m] as held, of those on the base
    ring : Ring, None if it does not ring
    odd : (name, (3,) [m]) of a base marker that moved against all others and is left out
    lost : names of channels that were not seen where they were needed and are left out
    """

    name: str
    kind: str
    names: tuple
    t: float
    since: np.ndarray
    path: np.ndarray
    times: np.ndarray
    moved: np.ndarray
    noise: np.ndarray
    count: np.ndarray
    held: np.ndarray
    base: np.ndarray
    base_names: tuple
    base_rest: np.ndarray
    base_held: np.ndarray
    ring: Ring | None
    odd: tuple | None = None
    lost: tuple = ()


def release_of(prepared):
    """Return the Release of a preparation.Prepared recording without pads.

    From the markers on the tissue, or the EM tools where there are none; from the markers on the
    base how far the base went along. Raises RecordingError if nothing was let go in it.
    """
    kind = OPTICAL if prepared.on(OPTICAL, TISSUE)[0] is not None else EM
    stream, noise = prepared.on(kind, TISSUE)
    if stream is None:
        raise RecordingError(f'{prepared.evidence.name}: no marker and no EM tool on the tissue; '
                             'nothing says how the body moved; record one')
    name = prepared.evidence.name
    every, sd = stream.names, noise.sd
    kept = _seen_at_both_ends(stream, name)
    stream, sd = stream.channels(kept), sd[kept]
    at = _release(stream, sd, name)
    held, since = _held(stream, at), stream.t - at
    path = stream.values - held
    ring, kept = _ring_of_most(since, path)
    stream, sd, path, held = stream.channels(kept), sd[kept], path[:, kept], held[kept]
    windows = _windows(since[-1], ring)
    if ring is None:
        _refuse_unsettled(name, path[since >= windows[-1, 0]], sd)
    base, odd = _sound_base(_base(prepared, at, windows), prepared.calibration.base)
    moved = np.stack([_mean(path[(since >= a) & (since <= b)]) for a, b in windows])
    count = np.array([noise.effective(np.sum((since >= a) & (since <= b))) for a, b in windows])
    return Release(name, kind, stream.names, float(at), since, path, windows.mean(axis=1), moved,
                   sd, count, held - stream.rest, *base, ring, odd,
                   tuple(n for n in every if n not in stream.names))


def _held(stream, at):
    """(k, 3) [m] where each channel was held: just before the release, or earlier if unseen."""
    just = _mean(stream.values[(stream.t > at - CLEAR - FIRST) & (stream.t < at - CLEAR)])
    return np.where(np.isfinite(just), just, _mean(stream.values[stream.t <= at]))


def _refuse_unsettled(name, path, sd):
    """Raise RecordingError if what does not ring still moves in its last window (n, k, 3) [m]."""
    way = np.linalg.norm(_mean(path), axis=1).max()
    goes = np.linalg.norm(np.nanmax(path, axis=0) - np.nanmin(path, axis=0), axis=1)
    if (goes > np.maximum(UNSETTLED * way, LOUD * np.linalg.norm(sd, axis=1))).any():
        raise RecordingError(f'{name}: at its end its markers still move by '
                             f'{1e3 * goes.max():.2g} mm of {1e3 * way:.2g} mm, and it is too '
                             'short for a frequency; record until it settles')


def _seen_at_both_ends(stream, name):
    """Indices of the channels that are seen at rest and at the end."""
    ends = (stream.t < stream.t[0] + FIRST, stream.t >= _last(stream.t))
    seen = [stream.valid[rows].any(axis=0) for rows in ends]
    for which, where in zip(seen, (f'in its first {FIRST:g} s, while it is held',
                                  'at its end, where it settles'),
                            strict=True):
        if not which.any():
            raise RecordingError(f'{name}: no marker or tool on the tissue is seen {where}; cut '
                                 'the recording to where they are seen')
    if not (seen[0] & seen[1]).any():
        raise RecordingError(f'{name}: no marker or tool on the tissue is seen both while it is '
                             'held and where it settles; nothing says how far it went')
    return np.flatnonzero(seen[0] & seen[1])


def _last(t):
    """Time [s] from which on a recording is at its end."""
    return max(t[-max(int(LAST * len(t)), 1)], t[-1] - LONGEST_LAST)


def _release(stream, sd, name):
    """Time [s] at which the body leaves where it was held."""
    held = stream.t < stream.t[0] + FIRST
    start = _mean(stream.values[held])
    end = _mean(stream.values[stream.t >= _last(stream.t)])
    way, noise = np.linalg.norm(end - start, axis=1), np.linalg.norm(sd, axis=1)
    if not (way / noise).max() > LEAST_WAY:
        raise RecordingError(f'{name}: its markers end where they began, within '
                             f'{1e3 * LEAST_WAY * noise.max():.2g} mm; a body without pads must '
                             'be held, let go and settle; record the release too')
    far = np.linalg.norm(stream.values - start, axis=2)
    gone = (np.nan_to_num(far) > np.maximum(DEPARTED * way.max(), LOUD * noise)).any(axis=1)
    if gone[held].any():
        raise RecordingError(f'{name}: its markers move in the first {FIRST:g} s, in which it '
                             'must be held still; let the recording begin earlier')
    return stream.t[max(int(np.argmax(gone)) - 1, 0)]


def _mean(values):
    """Mean over frames, NaN for a channel that was seen in none."""
    seen = np.isfinite(values)
    count = seen.sum(axis=0)
    return np.where(count > 0, np.where(seen, values, 0.0).sum(axis=0) / np.maximum(count, 1),
                    np.nan)


def _ring_of_most(since, path):
    """(Ring, indices of the channels it is of): those that hide from it are left out, if any do.

    A channel hides where no mode is seen in the frames that show all, but in those of the others.
    """
    every = np.arange(path.shape[1])
    ring = _ring(since, path)
    seen = np.isfinite(path).all(axis=2)
    while ring is None and len(every) > 1 and not seen[since > 0.0][:, every].all():
        every = np.delete(every, int(np.argmin(seen[since > 0.0][:, every].sum(axis=0))))
        ring = _ring(since, path[:, every])
    return (ring, every) if ring is not None else (None, np.arange(path.shape[1]))


def _ring(since, path):
    """Ring of a motion, None if there is none worth the name."""
    final = _mean(path[since >= _last(since)])
    whole = np.isfinite(path).all(axis=(1, 2)) & (since > 0.0)
    if whole.sum() < FEWEST:
        return None
    t, s = since[whole], (path - final)[whole].reshape(whole.sum(), -1)
    largest = int(np.nanargmax(np.linalg.norm(final, axis=1)))
    rough = _rough(t, path[whole, largest])
    if rough is None:
        return None
    start = 1.0 / rough.frequency
    rate = 2.0 * np.pi * rough.frequency * rough.damping
    end = min(start - np.log(QUIET) / rate, t[-1])
    if (end - start) * rough.frequency < PERIODS:
        return None
    guess, middle = (rough.frequency, rough.damping), 0.5 * (start + end)
    if min(((t >= a) & (t <= b)).sum() for a, b in ((start, middle), (middle, end))) < THINNEST:
        return None
    one, early, late = (_mode(t, s, a, b, guess, final) for a, b in (
        (start, end), (start, middle), (middle, end)))
    half = [0.5 * np.abs(a - b) for a, b in zip(early[:2], late[:2], strict=True)]
    apart = 0.5 * float(np.sqrt(np.mean((early[2] - late[2]) ** 2)))
    return Ring(one[0], one[1], one[2], one[3], *half, apart, one[4], (start, end))


def _rough(t, x):
    """ringing.Ringing of a marker (n, 3), from all of it or its first part; None if it has none.

    Creep over a long rest is more of the whole motion than what rings at its beginning.
    """
    for part in PARTS_RUNG:
        rows = t <= t[0] + part * (t[-1] - t[0])
        found = ringing(t[rows], x[rows])
        if np.isfinite(found.frequency) and 0.0 < found.damping < 0.5:
            return found
    return None


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
    """(how far (w, b, 3) [m], names, places (b, 3) [m], from them when held (b, 3)) of markers."""
    stream, _ = prepared.on(OPTICAL, BASE)
    if stream is None:
        none = np.zeros((0, 3))
        return np.zeros((len(windows), 0, 3)), (), none, none
    since = stream.t - at
    held = (since > -CLEAR - FIRST) & (since < -CLEAR)
    rest = _mean(stream.values[held if held.any() else since < 0.0])
    moved = np.stack([_mean(stream.values[(since >= a) & (since <= b)]) - rest
                      for a, b in windows])
    return _of_base((moved, stream.names, stream.rest, rest - stream.rest),
                    np.flatnonzero(np.isfinite(moved).all(axis=(0, 2))))


def _of_base(base, kept):
    moved, names, places, held = base
    return moved[:, kept], tuple(names[i] for i in kept), places[kept], held[kept]


def _sound_base(base, slack):
    """(base, odd): without the one marker that went far while all others stayed together.

    base : as `_base` returns it;  slack : [m] by which a sound base may move
    Takes three markers. Of three it may also be the base that turned about the line through the
    other two, which no base does by half a millimetre.
    """
    last, names = base[0][-1], base[1]
    for k, name in enumerate(names if len(names) >= 3 else ()):
        kept = np.delete(np.arange(len(names)), k)
        alone = last[k] - last[kept].mean(axis=0)
        spread = np.linalg.norm(last[kept] - last[kept].mean(axis=0), axis=1).max()
        if np.linalg.norm(alone) > max(BROKEN * slack, APART * spread):
            return _of_base(base, kept), (name, alone)
    return base, None
