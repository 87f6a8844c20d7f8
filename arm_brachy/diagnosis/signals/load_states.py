"""A recording as a bounded number of load states: every stream averaged around each of them."""

from dataclasses import dataclass, fields, replace

import numpy as np

from arm_brachy.diagnosis.signals.state_labels import Labels, free_labels, labels_of
from arm_brachy.diagnosis.signals.stream import ENCODER
from arm_brachy.diagnosis.signals.windows import SETTLED, free_windows, windows_of

LIMIT = 80      # states: more say no more where the model is the limit, and take minutes
LONGEST_GAP = 1.5   # periods between the samples on either side of an instant,
WIDEST_GAP = 2.0    # and lengths of the window of a ramp
CENTRED = 1e-3      # s: a sample that near the centre of a ramp's window is at it


@dataclass(frozen=True)
class Averaged:
    """One stream at m load states. names, bodies, along : of the Stream;  rest : (k, c), too

    values : (m, k, c) SI, NaN where not seen;  variance : (m, k, c) of these means, infinite there
    count : (m, k) samples averaged
    """

    names: tuple
    bodies: tuple
    rest: np.ndarray
    values: np.ndarray
    variance: np.ndarray
    count: np.ndarray
    along: np.ndarray | None = None


@dataclass(frozen=True)
class LoadStates:
    """What a quasi-static model is compared with, in order of time.

    t : (m,) [s] centres by the encoders' clock;  width : (m,) [s] of the windows
    q : (m, p) [m] pushes, all pads of the scene;  velocity : (m, p) [m/s]
    streams : kind -> Averaged; optical positions in the world frame
    correlation : kind -> (m, m) of the errors of two states of one channel
    labels : Labels
    path_t, path_q : (n,), (n, p) corners of the whole path and the states on it, in order: what
        depends on the past is carried along it;  state : (m,) index of each state in the path
    """

    t: np.ndarray
    width: np.ndarray
    q: np.ndarray
    velocity: np.ndarray
    streams: dict
    correlation: dict
    labels: Labels
    path_t: np.ndarray
    path_q: np.ndarray
    state: np.ndarray


def without(states, times):
    """The LoadStates whose windows hold none of `times` [s]: in them nothing has one value."""
    half = 0.5 * states.width + SETTLED
    kept = np.array([not np.any(np.abs(np.asarray(times) - t) < h)
                     for t, h in zip(states.t, half, strict=True)], dtype=bool)
    labels = replace(states.labels, **{f.name: getattr(states.labels, f.name)[kept]
                                       for f in fields(states.labels)})
    streams = {kind: replace(one, values=one.values[kept], variance=one.variance[kept],
                             count=one.count[kept]) for kind, one in states.streams.items()}
    correlation = {kind: c[np.ix_(kept, kept)] for kind, c in states.correlation.items()}
    return replace(states, t=states.t[kept], width=states.width[kept], q=states.q[kept],
                   velocity=states.velocity[kept], streams=streams, correlation=correlation,
                   labels=labels, state=states.state[kept])


def unseen(states, kind, names):
    """The LoadStates as if the channels of these names of a stream had not been seen."""
    stream = states.streams[kind]
    seen = ~np.isin(stream.names, names)
    stream = replace(stream, values=np.where(seen[:, None], stream.values, np.nan),
                     variance=np.where(seen[:, None], stream.variance, np.inf),
                     count=np.where(seen, stream.count, 0))
    return replace(states, streams={**states.streams, kind: stream})


def load_states(prepared, late=None, limit=LIMIT, rhythm=0.0, events=()):
    """Reduce a recording to at most `limit` LoadStates.

    prepared : preparation.Prepared;  late : kind -> [s] by which a stream's stamps are late
    rhythm : [Hz] in which something goes on all the time, 0 = nothing does
    events : times [s] of what came suddenly: a few states more lie between two of them
    On ramps the value of a straight line at the middle of the window is taken, so that gaps do not
    shift it in time; on stands the mean. Valid for motion that is straight within the tolerance of
    prepared.motion inside every window, and for a body that follows without inertia.
    Test: diagnosis/structural/test_states.py
    """
    late, motion = late or {}, prepared.motion
    if motion is None:
        windows = free_windows(prepared.evidence, prepared.noise, limit)
        q = np.zeros((len(windows), 0))
        labels, velocity = free_labels(windows), q
        path_t, path_q = np.array([w.centre for w in windows]), q
        state = np.arange(len(windows))
    else:
        windows = windows_of(motion, limit, rhythm, events)
        q, velocity = _pushes(prepared, windows)
        labels = labels_of(motion, windows, q)
        path_t, path_q, state = _path(motion, windows, q)
    t = np.array([w.centre for w in windows])
    streams, correlation = {}, {}
    for kind, stream in prepared.evidence.streams.items():
        if kind != ENCODER:
            part, noise = prepared.on(kind, *dict.fromkeys(stream.bodies))
            streams[kind] = _averaged(part, noise, windows, late.get(kind, 0.0))
            correlation[kind] = noise.between(t, streams[kind].count.max(axis=1))
    width = np.array([w.stop - w.start for w in windows])
    return LoadStates(t, width, q, velocity, streams, correlation, labels, path_t, path_q, state)


def _pushes(prepared, windows):
    """Pushes (m, p) and velocities (m, p) of all pads of the scene by their encoders."""
    encoder, pads = prepared.evidence.get(ENCODER), prepared.evidence.pads
    column = [pads.index(name) for name in encoder.names]
    q, v = np.zeros((len(windows), len(pads))), np.zeros((len(windows), len(pads)))
    part = _averaged(encoder, prepared.noise[ENCODER], windows, 0.0)
    between = encoder.at(np.array([w.centre for w in windows]))[..., 0]
    q[:, column] = np.where(np.isfinite(part.values[:, :, 0]), part.values[:, :, 0], between)
    ends = np.array([[w.start, w.stop] for w in windows])
    moved = encoder.at(ends[:, 1])[..., 0] - encoder.at(ends[:, 0])[..., 0]
    moves = np.array([w.moves for w in windows])
    v[:, column] = np.where(moves[:, None], moved / np.diff(ends), 0.0)
    return q, v


def _path(motion, windows, q):
    """Corners and states in one sequence; where they coincide the state stays."""
    t = np.array([w.centre for w in windows])
    apart = np.abs(motion.t[:, None] - t[None]).min(axis=1) > 1e-9
    every = np.concatenate([motion.t[apart], t])
    order = np.argsort(every, kind='stable')
    path = np.concatenate([motion.q[apart], q])[order]
    return every[order], path, np.flatnonzero(np.isin(order, np.arange(apart.sum(), len(every))))


def _averaged(stream, noise, windows, late):
    """Averaged of one stream over all windows; the first samples at or around each centre."""
    m, (k, c) = len(windows), stream.values.shape[1:]
    values, variance = np.full((m, k, c), np.nan), np.full((m, k, c), np.inf)
    count = np.zeros((m, k), dtype=int)
    for i, window in enumerate(windows):
        rows = _rows(stream, window, late)
        centre = window.centre + late
        x, t, seen = stream.values[rows], stream.t[rows] - centre, stream.valid[rows]
        n = seen.sum(axis=0)
        some = n > 0
        weight = seen / np.maximum(n, 1)
        mean = np.einsum('nk,nkc->kc', weight, np.where(seen[..., None], x, 0.0))
        factor = noise.colour.mean_variance(n, noise.period)
        if window.moves:
            mean, more, known = _at_centre(x, t, seen, weight, mean)
            factor, some = factor * more, some & known
        values[i, some] = mean[some]
        variance[i, some] = (factor[:, None] * noise.sd ** 2)[some]
        count[i] = n
    return Averaged(stream.names, stream.bodies, stream.rest, values, variance, count,
                    stream.along)


def _rows(stream, window, late):
    """Samples inside a window; of a ramp shorter than two those on either side of its centre, if
    these are on the same ramp. A stand between two samples was not seen.
    """
    start = int(np.searchsorted(stream.t, window.start + late - 1e-9))
    stop = int(np.searchsorted(stream.t, window.stop + late + 1e-9))
    if not window.moves or stop - start >= 2:
        return slice(start, stop)
    after = int(np.clip(np.searchsorted(stream.t, window.centre + late), 1, len(stream.t) - 1))
    longest = LONGEST_GAP * stream.period
    if window.stop > window.start:
        longest = min(longest, WIDEST_GAP * (window.stop - window.start))
    near = stream.t[after] - stream.t[after - 1] <= longest
    return slice(after - 1, after + 1) if near else slice(0, 0)


def _at_centre(x, t, seen, weight, mean):
    """Straight lines through the samples of a ramp at t = 0, what that costs in variance, and
    where there is one: a single sample beside the centre says nothing of it.
    """
    middle = weight.T @ t
    spread = np.where(seen, t[:, None] - middle, 0.0)
    power = np.sum(spread ** 2, axis=0)
    slope = np.einsum('nk,nkc->kc', spread, np.where(seen[..., None], x, 0.0))
    sloped = power > 0.0
    safe = np.where(sloped, power, 1.0)
    slope = np.where(sloped[:, None], slope / safe[:, None], 0.0)
    n = seen.sum(axis=0)
    more = 1.0 + np.where(sloped, n * middle ** 2 / safe, 0.0)
    return mean - slope * middle[:, None], more, sloped | (np.abs(middle) < CENTRED)
