"""Single readings that are far off: reflections that a tracker takes for a marker for a frame.

A step search takes what is left of one for a step, and a least-squares fit follows it: they are
marked as not seen before anything is averaged.
Test: diagnosis/structural/test_spikes.py
"""

import numpy as np

from arm_brachy.diagnosis.signals.noise import SILENT, data_sheet_sd
from arm_brachy.diagnosis.signals.quantisation import quantum

LONGEST = 2         # successive samples: what lasts longer may have happened
FAR = 8.0           # times what samples usually miss the line between their neighbours by
ROUGH = 5.0         # times what the samples around it do
COUNTS = 4.0        # of a digitised signal
AGREE = 0.5         # of how far a sample is off: the neighbours are at most that far apart
NEAR = 3            # samples on either side that are around it
APART = 3.0         # periods from one sample to the next, else nobody knows what was between
MOST = 0.02         # of the samples of a channel; where more are off it is no exception


def without_spikes(stream, speed, notes):
    """The Stream with lone samples that are far off marked as not seen; notes say how many.

    speed : [SI/s] that nothing honest exceeds, 0 = not known; it may be there and back between
        two samples
    A channel in which more than MOST of the samples are off is left as it is.
    """
    hidden, lone, often = np.zeros_like(stream.valid), [], []
    counts = COUNTS * float(np.linalg.norm(
        [quantum(axis[np.isfinite(axis)]) for axis in np.moveaxis(stream.values, 2, 0)]))
    for k, name in enumerate(stream.names):
        rows = np.flatnonzero(stream.valid[:, k])
        values = stream.values[rows, k]
        usual = max(FAR * max(_miss(values), SILENT * data_sheet_sd(stream.kind)), counts)
        off = spikes(stream.t[rows], values, usual, speed)
        if off.sum() > MOST * len(rows):
            often.append(name)
        elif off.any():
            lone.append(f'{off.sum()} of {name}')
            hidden[rows[off], k] = True
    if lone:
        notes.append(f'Lone samples of {stream.kind} that are far off those before and after were '
                     f'left out: {", ".join(lone)}.')
    if often:
        notes.append(f'More than {100.0 * MOST:.0f} % of the samples of {stream.kind} are lone '
                     f'and far off and were left in: {", ".join(often)}.')
    return stream.without(hidden) if lone else stream


def fastest(encoder):
    """[m/s] that all pads together moved at by the Stream of their encoders; 0 without (None)."""
    if encoder is None:
        return 0.0
    seen = encoder.valid.all(axis=1)
    steps = np.linalg.norm(np.diff(encoder.values[seen, :, 0], axis=0), axis=1)
    return float(np.max(steps / np.diff(encoder.t[seen]), initial=0.0))


def spikes(t, values, usual, speed=0.0):
    """(n,) True for samples of one channel that lie far from a line between their neighbours.

    t : (n,) [s];  values : (n, c) SI;  usual : how far off noise and counts bring a sample
    speed : as in `without_spikes`
    Up to LONGEST successive ones, whose neighbours agree: a step has neighbours that do not. What
    is around a spike is straight without it; around a reversal it is not.
    """
    runs = [run for length in range(1, LONGEST + 1) for run in _runs(t, values, length)]
    runs = [(first, stop, off) for first, stop, off in runs
            if off > max(usual, 0.5 * speed * (t[stop] - t[first - 1]))]
    kept = np.flatnonzero(~_within([run[:2] for run in runs], len(t)))
    rough = _misses(t[kept], values[kept])
    alone = []
    for first, stop, off in runs:
        middle = int(np.searchsorted(kept, first))
        if off > ROUGH * rough[max(middle - NEAR, 0):middle + NEAR].max(initial=0.0):
            alone.append((first, stop))
    return _within(alone, len(t))


def _within(runs, n):
    """(n,) True for the samples in runs (first, stop)."""
    out = np.zeros(n, dtype=bool)
    for first, stop in runs:
        out[first:stop] = True
    return out


def _runs(t, values, length):
    """Tuples (first, stop, off) of the runs of `length` samples that may be spikes.

    off : of the sample that is nearest to the line between the run's neighbours
    """
    if len(t) < length + 2:
        return []
    before, after = np.arange(len(t) - length - 1), np.arange(length + 1, len(t))
    gap = np.linalg.norm(values[after] - values[before], axis=1)
    off = np.min([_distance(t, values, before, before + 1 + i, after) for i in range(length)],
                 axis=0)
    close = t[after] - t[before] <= APART * (length + 1) * np.median(np.diff(t))
    return [(int(i) + 1, int(i) + 1 + length, float(off[i]))
            for i in np.flatnonzero(close & (gap < AGREE * off))]


def _distance(t, values, before, here, after):
    """(m,) distances of the samples `here` from the lines between those before and after."""
    share = ((t[here] - t[before]) / (t[after] - t[before]))[:, None]
    line = values[before] + share * (values[after] - values[before])
    return np.linalg.norm(values[here] - line, axis=1)


def _misses(t, values):
    """(n,) how far each sample is from the line between its neighbours; 0 at the ends."""
    inner = np.arange(1, max(len(t) - 1, 1))
    return np.pad(_distance(t, values, inner - 1, inner, inner + 1), 1)[:len(t)]


def _miss(values):
    """Median of how far samples (n, c) are from the middle between their neighbours."""
    misses = _misses(np.arange(len(values)), values)[1:-1]
    return float(np.median(misses)) if len(misses) else 0.0
