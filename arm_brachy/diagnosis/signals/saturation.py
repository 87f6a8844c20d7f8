"""Force sensors at the end of their range: what they read there is no force.

Test: diagnosis/structural/test_saturation.py
"""

from dataclasses import replace

import numpy as np

RUN = 20        # samples on end, for an end to be one
RESTLESS = 0.5  # of the other samples that may equal the one before: coarser counts do not tell


def unsaturated(stream, notes):
    """The Stream with the samples of a channel not seen in which a component is at its end.

    notes : list that is told. The end is the largest or smallest value of a component, where it is
    read again and again although the sensor is never still elsewhere.
    """
    valid = stream.valid.copy()
    for k, name in enumerate(stream.names):
        seen = np.flatnonzero(stream.valid[:, k])
        for axis in range(stream.values.shape[2]):
            at_end = _at_end(stream.values[seen, k, axis])
            if at_end.any():
                valid[seen[at_end], k] = False
                way = 'xyz'[axis] if stream.along is None else (
                    'its push' if stream.names.index(name) == k else 'an axis across its push')
                ends = np.unique(stream.values[seen[at_end], k, axis])
                notes.append(
                    f'{stream.kind} on {name} stays at {" and ".join(f"{v:.3g}" for v in ends)} N '
                    f'along {way} in {int(at_end.sum())} samples, the end of its range: '
                    'these are left out.')
    if np.array_equal(valid, stream.valid):
        return stream
    values = np.where(valid[:, :, None], stream.values, np.nan)
    return replace(stream, values=values, valid=valid)


def _at_end(values):
    """(n,) True where values (n,) are at an end of their range that stops them."""
    out = np.zeros(len(values), dtype=bool)
    if len(values) < RUN:
        return out
    same = np.append(False, values[1:] == values[:-1])
    for end in {float(values.min()), float(values.max())}:
        at = values == end
        elsewhere = same[~at]
        if _longest(at) >= RUN and len(elsewhere) and elsewhere.mean() < RESTLESS:
            out |= at
    return out


def _longest(flags):
    """Number of True values on end at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))
