"""Numbers that stand for "not measured", and how they are told from measurements.

- Above 1e20 nothing was measured: NDI writes -3.697314E28 (its documented bad float), others
  1e30, 9.96921e36 (netCDF), 3.4e38 and 1.8e308 (the largest floats).
- 999, 9999 and their like, of either sign, count where they are far from everything else that
  the channel shows, or where all axes of a point have one.
- 0 0 0 of a point counts where the point does not come there by itself: the step to it is far
  longer than any other of that channel. A point that is always 0 0 0 was never seen.

Where this stops being valid: a channel that shows a code next to its own range, and a point that
jumps to the origin once, as a teleported simulated one may.
Test: recording/test_stand_ins.py
"""

from dataclasses import dataclass

import numpy as np

HUGE = 1e20         # scikit-surgerynditracker and readers of NDI files take as much for NaN
NINES = (999.0, 9999.0, 99999.0, 999999.0, 999.9, 9999.9, 32768.0, 32767.0,
         2147483647.0, 2147483648.0)
FAR = 10.0          # spans of the other values of a channel, from them
JUMP = 3.0          # of the longest ordinary step
ORDINARY = 99.0     # percentile of the steps of a channel that are ordinary


@dataclass(frozen=True)
class StandIns:
    """values : (n, k, c) with NaN where a number stood for nothing

    found : (channel, what, rows (m,)) each, by what was written
    kept : (channel, rows (m,)) each, points at 0 0 0 that were left as places
    """

    values: np.ndarray
    found: tuple
    kept: tuple = ()


def without_stand_ins(values, *, codes=(), points=False, zeros='gap'):
    """StandIns of a stream.

    values : (n, k, c) in the unit of the file, c axes of k channels
    codes : further numbers that mean "not measured", wherever they stand
    points : True of positions, for which 0 0 0 in all axes may be one
    zeros : 'gap', or 'place' to leave these alone
    """
    values, found, kept = values.copy(), [], []
    for k in range(values.shape[1]):
        channel = values[:, k]      # a view
        for what, rows in (*_by_value(channel, codes), *_nines(channel)):
            found.append((k, what, rows))
            channel[rows] = np.nan
        if points and zeros == 'gap':
            gaps, places = _zeros(channel)
            if len(gaps):
                found.append((k, '0 0 0', gaps))
                channel[gaps] = np.nan
            if len(places):
                kept.append((k, places))
    return StandIns(values, tuple(found), tuple(kept))


def _by_value(channel, codes):
    """(what, rows) of the huge ones and of the given codes."""
    huge = np.abs(channel) > HUGE
    if huge.any():
        rows = np.flatnonzero(huge.any(axis=1))
        yield f'{channel[huge][0]:.7g}', rows
    for code in codes:
        rows = np.flatnonzero((channel == code).any(axis=1))
        if len(rows):
            yield f'{code:g}', rows


def _nines(channel):
    """(what, rows) of the numbers of NINES that measure nothing."""
    size = np.abs(channel)
    coded = np.isin(size, NINES)
    if not coded.any():
        return
    rest = np.where(coded, np.nan, channel)
    out = coded.all(axis=1) & (channel.shape[1] > 1)
    for axis in range(channel.shape[1]):
        known = rest[np.isfinite(rest[:, axis]), axis]
        hits = coded[:, axis]
        if not hits.any():
            continue
        if not len(known):
            out |= hits & (channel.shape[1] == 1)
            continue
        span = max(float(np.ptp(known)), 1e-3 * float(np.abs(known).max()))
        away = np.maximum(channel[:, axis] - known.max(), known.min() - channel[:, axis])
        out |= hits & (away > FAR * span)
    for code in np.unique(channel[coded & out[:, None]]):
        rows = np.flatnonzero((channel == code).any(axis=1) & out)
        if len(rows):
            yield f'{code:g}', rows


def _zeros(channel):
    """(rows at 0 0 0 that no motion leads to, rows at 0 0 0 to which one does)."""
    none = np.zeros(0, dtype=int)
    seen = np.isfinite(channel).all(axis=1)
    zero = seen & (channel == 0.0).all(axis=1)
    if not zero.any():
        return none, none
    places = seen & ~zero
    if not places.any():
        return np.flatnonzero(zero), none
    steps = np.linalg.norm(np.diff(channel, axis=0), axis=1)[places[1:] & places[:-1]]
    longest = float(np.percentile(steps, ORDINARY)) if len(steps) else 0.0
    index = np.flatnonzero(places)
    gaps = np.zeros(len(channel), dtype=bool)
    for rows in _runs(zero):
        beside = [i for i in (np.searchsorted(index, rows[0]) - 1,
                              np.searchsorted(index, rows[-1])) if 0 <= i < len(index)]
        nearest = min(np.linalg.norm(channel[index[i]]) for i in beside)
        gaps[rows] = nearest > JUMP * longest
    return np.flatnonzero(gaps), np.flatnonzero(zero & ~gaps)


def _runs(flags):
    """Arrays of the rows of every run of True."""
    rows = np.flatnonzero(flags)
    return np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
