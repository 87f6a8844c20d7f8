"""Stamps of the streams as the diagnosis takes them: from zero, in order, one clock a stream."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from arm_brachy.core.errors import RecordingError

SHARED = 0.1        # of a channel's stamps that another has too, for both to be stamped together
LONGEST_GAP = 1.5   # periods of a channel between the samples on either side of a stamp
SESSION = 43_200.0  # s within which recordings that follow each other are of one day at one cell
EARLY = 1.0         # s by which a stream may begin before the recording that holds it


def in_order(stream, name, notes):
    """The stream without repeated stamps. Raises RecordingError if times run backwards."""
    steps = np.diff(stream.t)
    if np.any(steps < 0.0):
        at = int(np.argmax(steps < 0.0))
        raise RecordingError(f'{name}: {stream.kind} goes back in time, from {stream.t[at]:g} s '
                             f'to {stream.t[at + 1]:g} s; sort the stream by its stamps')
    if np.all(steps > 0.0):
        return stream
    keep = np.concatenate([[True], steps > 0.0])
    notes.append(f'{int(np.sum(~keep))} samples of {stream.kind} repeat a time stamp and are '
                 'left out.')
    return replace(stream, t=stream.t[keep], values=stream.values[keep], valid=stream.valid[keep])


def together(stream, notes):
    """The stream with all channels at the stamps of its slowest one.

    Sensors that are read one by one have stamps of their own: rows with one channel each, of which
    neither a force balance nor the noise of successive samples can be had. The others are put on
    the straight line between their neighbours, unless a sample is missing there.
    """
    times = [stream.t[stream.valid[:, k]] for k in range(len(stream.names))]
    alive = [k for k, own in enumerate(times) if len(own) > 1]
    if len(alive) < 2 or all(_shares(k, times) for k in alive):
        return stream
    periods = {k: float(np.median(np.diff(times[k]))) for k in alive}
    slowest = max(periods, key=periods.get)
    t = times[slowest]
    values = np.full((len(t), *stream.values.shape[1:]), np.nan)
    for k, period in periods.items():
        values[:, k] = _between(t, times[k], stream.values[stream.valid[:, k], k], period)
    notes.append(f'Channels of {stream.kind} have stamps of their own: all were taken at those of '
                 f'{stream.names[slowest]}.')
    return replace(stream, t=t, values=values, valid=np.isfinite(values).all(axis=2))


def _shares(k, times):
    others = np.concatenate([t for i, t in enumerate(times) if i != k])
    return np.isin(times[k], others).mean() > SHARED


def _between(t, own, values, period):
    """Values (n, c) at t (n,) between those (m, c) at `own` (m,); NaN across a gap or outside."""
    after = np.clip(np.searchsorted(own, t), 1, len(own) - 1)
    near = own[after] - own[after - 1] <= LONGEST_GAP * period
    near &= (t >= own[0]) & (t <= own[-1])
    out = np.stack([np.interp(t, own, column) for column in values.T], axis=1)
    return np.where((near | np.isin(t, own))[:, None], out, np.nan)


def session_zero(spans):
    """Time [s] from which recordings of one session count together; None = each from its own.

    spans : (start, end) [s] of each
    Recordings that follow each other within SESSION have one clock: what drifts goes on between
    them, and a rhythm keeps its phase. Those that overlap have clocks of their own.
    """
    spans = sorted(spans)
    follow = all(one[1] < other[0] for one, other in pairwise(spans))
    if len(spans) < 2 or not follow or spans[-1][1] - spans[0][0] > SESSION:
        return None
    start, end = spans[0]
    return 0.0 if abs(start) <= end - start else start


def from_zero(streams, notes, zero=None):
    """The streams (tuple of Stream or None) with times from `zero` [s], `session_zero`; None, or
    one that is not theirs, stands for the first stamp, if these are dates.

    What drifts counts from time zero: a recording that begins later than it is long has another
    zero than its own, such as 1970.
    """
    here = [s for s in streams if s is not None]
    start, end = min(s.t[0] for s in here), max(s.t[-1] for s in here)
    shared = zero is not None and zero - EARLY <= start <= zero + SESSION
    if not shared:
        zero = 0.0 if abs(start) <= end - start else start
    if zero == 0.0:
        return tuple(streams)
    notes.append(f'Times are counted from the first stamp{" of all" if shared else ""}, '
                 f'{zero:.3f} s.')
    return tuple(None if s is None else replace(s, t=s.t - zero) for s in streams)
