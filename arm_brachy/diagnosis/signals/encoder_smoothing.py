"""Encoders that are loud (potentiometers, markers in their place): the path that they tell of.

What pads do is driven by their path; noise in it is taken for motion, and a reading less itself
follows the reading. So a loud encoder is replaced by straight pieces: a local line through as many
samples on either side as one line will do for (Goldenshluger & Nemirovski 1997, Math Methods
Statist 6:135: intervals of ever longer windows must have a point in common), corners where that
turns, and least squares between them.
Test: diagnosis/structural/test_steadied.py
"""

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from arm_brachy.diagnosis.signals.motion import FINENESS, corners_of, noise_of

QUIET = 2e-5        # m of noise: less was found to do no harm
WINDOWS = (2, 3, 5, 8, 12, 18, 27, 40, 60, 90, 135, 200)    # samples to one side
WIDE = 3.0          # standard deviations of a window's interval
TURN = 8.0          # standard deviations of a local line that make a corner: its ends err as well
SHORTEST = 10       # samples in which a pad may be said to stand


def steadied(stream, notes):
    """The encoders' Stream with loud channels as straight pieces; notes : list that is told.

    Valid for noise that is white from sample to sample; a motion shorter than five samples is
    flattened by about its noise.
    """
    values, loud, taken = stream.values.copy(), [], np.zeros(len(stream.names))
    for k, name in enumerate(stream.names):
        seen = stream.valid[:, k]
        t, q = stream.t[seen], stream.values[seen, k, 0]
        noise = noise_of(q)
        if noise > QUIET:
            values[seen, k, 0], taken[k] = _pieces(t, q, noise), noise
            loud.append(f'{name} ({1e3 * noise:.2g} mm)')
    if not loud:
        return stream
    notes.append(f'The encoders of {", ".join(loud)} are noisy: straight pieces through their '
                 'readings were taken for their path.')
    return replace(stream, values=values, taken=taken)


def _pieces(t, q, noise):
    """Readings q (n,) at t (n,) as straight pieces fitted to them; what may stand, stands."""
    local, sd = _local_lines(t, q, noise)
    tolerance = np.maximum(FINENESS * float(np.ptp(local)), TURN * sd)
    corners = corners_of(t, local[:, None], tolerance)
    hats, counts = _hats(t, t[corners]), np.diff(corners)
    heights = _fitted(hats, q)
    error = noise * np.sqrt(12.0 / np.maximum(counts, 1))       # of a line's rise
    stands = (np.abs(np.diff(heights)) < WIDE * error) & (counts >= SHORTEST)
    stands = _joined(stands, heights, counts, noise)
    level = np.append(0, np.cumsum(~stands))        # corners on either end of a stand share one
    shared = (hats @ coo_array((np.ones(len(level)), (np.arange(len(level)), level)))).tocsr()
    return shared @ _fitted(shared, q)


def _joined(stands, heights, counts, noise):
    """(c - 1,) `stands` with what is between two of them, if all that can be one stand.

    heights : (c,) of the corners;  counts : (c - 1,) samples of the pieces
    """
    out, at = stands.copy(), np.flatnonzero(stands)
    middle = 0.5 * (heights[1:] + heights[:-1])
    for i, k in zip(at[:-1], at[1:], strict=True):
        apart = abs(middle[i] - middle[k]) / np.sqrt(1.0 / counts[i] + 1.0 / counts[k])
        between = np.abs(heights[i + 1:k + 1] - 0.5 * (middle[i] + middle[k])).max()
        if counts[i + 1:k].sum() < SHORTEST and max(apart, between) < WIDE * noise:
            out[i + 1:k] = True
    return out


def _hats(t, corners):
    """Sparse (n, c): share that each corner's height has in the straight pieces at t (n,)."""
    piece = np.clip(np.searchsorted(corners, t, side='right') - 1, 0, len(corners) - 2)
    share = (t - corners[piece]) / np.diff(corners)[piece]
    rows = np.arange(len(t))
    return coo_array((np.concatenate([1.0 - share, share]), (
        np.concatenate([rows, rows]), np.concatenate([piece, piece + 1]))),
        shape=(len(t), len(corners))).tocsr()


def _fitted(hats, q):
    """Heights (c,) of least squares."""
    return spsolve((hats.T @ hats).tocsc(), hats.T @ q)


def _local_lines(t, q, noise):
    """(values, standard deviations), both (n,), of lines to the left and to the right, joined."""
    right = _one_sided(t, q, noise)
    left = tuple(one[::-1] for one in _one_sided(-t[::-1], q[::-1], noise))
    weights = [1.0 / sd**2 for _, sd in (left, right)]
    total = weights[0] + weights[1]
    return (weights[0] * left[0] + weights[1] * right[0]) / total, 1.0 / np.sqrt(total)


def _one_sided(t, q, noise):
    """(values, standard deviations) at t (n,) of the longest line from there that will do."""
    n = len(t)
    out, spread = q.copy(), np.full(n, noise)
    low, high, open_ = q - WIDE * noise, q + WIDE * noise, np.ones(n, dtype=bool)
    for width in WINDOWS:
        value, sd = _lines(t, q, width, noise)
        low, high = np.maximum(low, value - WIDE * sd), np.minimum(high, value + WIDE * sd)
        open_ &= (low <= high) & (np.arange(n) + width < n)
        out, spread = np.where(open_, value, out), np.where(open_, sd, spread)
    return out, spread


def _lines(t, q, width, noise):
    """(values, standard deviations) at t (n,) of least-squares lines over the next samples."""
    ahead = np.minimum(np.arange(len(t)) + width + 1, len(t))
    count = (ahead - np.arange(len(t))).astype(float)

    def summed(values):
        total = np.append(0.0, np.cumsum(values))
        return total[ahead] - total[:-1]

    # Times and readings from the middle of all, lest the sums cancel.
    s, y = t - t.mean(), q - q.mean()
    mean_s, mean_y = summed(s) / count, summed(y) / count
    spread = np.maximum(summed(s * s) - count * mean_s**2, 1e-300)
    slope = (summed(s * y) - count * mean_s * mean_y) / spread
    value = mean_y + slope * (s - mean_s) + q.mean()
    return value, noise * np.sqrt(1.0 / count + (s - mean_s)**2 / spread)
