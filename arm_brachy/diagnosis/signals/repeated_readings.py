"""Readings that were written several times: a slow sensor in a log of a faster rate.

Written again they are late and as if the body had stood; of each the first time is kept.
Test: diagnosis/structural/test_held.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.signals.stream import ENCODER

FEWEST = 20         # readings that tell
REPEATED = 0.1      # of the samples, for a stream to be one that repeats
LONG, RARE = 2.0, 0.05      # runs that are so many medians long (and one more) hold so few samples
ALL = 0.9           # of the channels that change with a new reading; by coarse counts some do
STEADY = 0.9        # of the encoders' runs on the move that are of one length, give or take one
UNEVEN = 2.5        # times the smallest of their steps that large ones are: no single counts


def once(stream, notes):
    """The Stream with each reading at its first stamp only; the same if none is repeated.

    notes : list that is told. Standing encoders repeat themselves, as does all that has no noise:
    what tells is that runs of the same reading are equally long, whatever goes on. Encoders keep
    a sample per reading while they stand.
    """
    same = (stream.values[1:] == stream.values[:-1]) | ~(
        stream.valid[1:] | stream.valid[:-1])[..., None]
    fresh = np.append(True, ~same.all(axis=(1, 2)))
    runs = np.diff(np.append(np.flatnonzero(fresh), len(fresh)))
    told = _encoders_repeat if stream.kind == ENCODER else _all_repeat
    if (fresh.mean() > 1.0 - REPEATED or fresh.sum() < FEWEST
            or not told(stream, fresh, runs)):
        return stream
    kept = _phase_locked(fresh, int(np.median(runs))) if stream.kind == ENCODER else fresh
    period = float(np.median(np.diff(stream.t[kept])))
    notes.append(f'{stream.kind} is read every {1e3 * period:.0f} ms and written every '
                 f'{1e3 * stream.period:.0f} ms: of each reading the first stamp was taken.')
    return replace(stream, t=stream.t[kept], values=stream.values[kept], valid=stream.valid[kept])


def _all_repeat(stream, fresh, runs):
    """True if all channels change together, after runs of about one length."""
    long = runs > LONG * np.median(runs) + 1.0
    if runs[long].sum() > RARE * len(fresh):
        return False
    new = np.flatnonzero(fresh)[1:]
    seen = stream.valid[new] & stream.valid[new - 1]
    changed = np.any(stream.values[new] != stream.values[new - 1], axis=2) & seen
    return changed.sum() >= ALL * seen.sum()


def _encoders_repeat(stream, fresh, runs):
    """True if on the move runs are of one length, at steps of many counts."""
    typical = int(np.median(runs))
    moving = runs[runs <= LONG * typical + 1.0]
    new = np.flatnonzero(fresh)[1:]
    both = stream.valid[new] & stream.valid[new - 1]
    steps = np.where(both, np.abs(stream.values[new] - stream.values[new - 1])[..., 0], 0.0)
    steps = steps.max(axis=1)[steps.any(axis=1)]
    return (typical > 1 and np.mean(np.abs(moving - typical) <= 1) >= STEADY
            and len(steps) > 0 and np.quantile(steps, 0.9) > UNEVEN * steps.min())


def _phase_locked(fresh, every):
    """(n,) True for the first of each reading and, while the same lasts, each `every`th after."""
    first = np.maximum.accumulate(np.where(fresh, np.arange(len(fresh)), 0))
    return (np.arange(len(fresh)) - first) % every == 0
