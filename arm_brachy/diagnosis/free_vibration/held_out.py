"""The held-out figure of a released body: what a description leaves of the markers' motion.

How strongly and in which phase the hand let go is no property of the body, nor is the tracker's
frame, or how the hand bent it as far as markers leave that in doubt: amplitude, phase, a small
turn and the bend are fitted to the recording that is predicted, and its frequency within the error
with which it is known (a body that swings far slows down, and one per cent over ten swings is half
of what swings). All else is not. The same for a model and for the other repeat, which says what
repeats.
Test: diagnosis/test_free_release.py
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from arm_brachy.diagnosis.free_vibration.observation import SETTLED, FreePriors
from arm_brachy.diagnosis.free_vibration.release import oscillation

BEGIN = 0.1         # s after the release, for a body that does not ring
SURE = 2.0          # standard deviations within which a frequency may be
INSTANTS = 8        # at which a model is asked for its slow motion


@dataclass(frozen=True)
class Description:
    """Slow motion and ringing of k channels.

    t : (m,) [s] after the release;  moved : (m, k, 3) [m], straight in log t between them
    frequency [Hz], damping, shape : (k, 3);  nan where nothing rings
    """

    t: np.ndarray
    moved: np.ndarray
    frequency: float
    damping: float
    shape: np.ndarray

    def slow(self, t):
        """(n, k, 3) [m] at t (n,)."""
        flat = self.moved.reshape(len(self.t), -1)
        at = [np.interp(np.log(t), np.log(self.t), column) for column in flat.T]
        return np.column_stack(at).reshape(len(t), *self.moved.shape[1:])


def of_model(model, case):
    """Description by a model.FreeModel of a observation.Case; it rings as it was let go."""
    release = case.release
    start = BEGIN if release.ring is None else release.ring.span[0]
    t = np.geomspace(start, release.since[-1], INSTANTS)
    swing, = model.swings(t, (case.hand.bent.nodes,))
    return Description(t, swing.moved[:, case.index], swing.frequency, swing.damping,
                       swing.shape[case.index])


def of_repeat(case):
    """Description by another observation.Case: its ringing, and the means of its settled windows.

    From the stress-free shape, as far as how it was held is known.
    """
    release = case.release
    ring, bent = release.ring, case.hand.bent.points[case.index]
    if ring is None:
        moved = release.moved + bent
        return Description(release.times, moved, np.nan, np.nan, moved[-1])
    ends = np.array([ring.span[0], release.since[-1]])
    if len(release.times) == 1:     # too short a rest for the slope of what creeps
        return Description(ends, np.repeat(release.moved + bent, 2, axis=0), ring.frequency,
                           ring.damping, ring.shape)
    late = release.since >= ring.span[1]
    t, path = release.since[late], (release.path[late] + bent).reshape(late.sum(), -1)
    basis = np.column_stack([np.ones(len(t)), np.log(t)])
    seen = np.isfinite(path)
    fit = np.column_stack([np.linalg.lstsq(basis[here], column[here], rcond=None)[0]
                           for column, here in zip(path.T, seen.T, strict=True)])
    moved = np.column_stack([np.ones(2), np.log(ends)]) @ fit
    return Description(ends, moved.reshape(2, -1, 3), ring.frequency, ring.damping, ring.shape)


def left(case, description):
    """[m] rms per axis that a Description of the same channels leaves of a observation.Case."""
    if not _rings(case, description):
        return _left(case, description)
    return float(_tuned(case, description).fun)


def path(case, description):
    """(t (n,) [s] after the release, measured (n, k, 3), predicted (n, k, 3) [m]) of `left`.

    Both from where each channel was held; measured NaN where it was not seen.
    """
    if _rings(case, description):
        description = replace(description, frequency=float(
            _tuned(case, description).x) * description.frequency)
    rows, seen, off, residual = _residual(case, description)
    measured = case.release.path[rows]
    predicted = np.full_like(measured, np.nan)
    predicted[seen] = measured[seen] - residual
    return case.release.since[rows], measured, predicted


def _rings(case, description):
    return case.release.ring is not None and np.isfinite(description.frequency)


def _tuned(case, description):
    """The optimum of scipy over factors on the frequency, within its error."""
    ring = case.release.ring
    slack = SURE * np.hypot(ring.frequency_sd / ring.frequency, FreePriors().frequency)
    return minimize_scalar(lambda factor: _left(case, replace(
        description, frequency=factor * description.frequency)), method='bounded',
        bounds=(1.0 - slack, 1.0 + slack))


def _left(case, description):
    return float(np.sqrt(np.mean(_residual(case, description)[3] ** 2)))


def _residual(case, description):
    """(rows (m,) used, seen (n, k, 3), off (n, k, 3), what is left of those seen) of a Case."""
    release, hand = case.release, case.hand
    start = BEGIN if release.ring is None else release.ring.span[0]
    rows = release.since >= start
    t = release.since[rows]
    slow = description.slow(t)
    off = release.path[rows] + hand.bent.points[case.index] - slow
    free = [np.cross(axis, slow) for axis in np.eye(3)]
    if release.ring is not None and np.isfinite(description.frequency):
        swing = oscillation(t - start, description.frequency, description.damping)
        free += [one[:, None, None] * description.shape for one in swing.T]
    doubt = [np.broadcast_to(one[case.index], off.shape) for one in hand.doubt]
    seen = np.isfinite(off)
    basis = np.column_stack([one[seen] for one in (*free, *doubt)])
    return rows, seen, off, _unexplained(basis, off[seen], len(free),
                                         _error(case) * np.sqrt(len(t)))


def _unexplained(basis, off, free, error):
    """What a basis leaves of `off`, its columns after the first `free` of unit prior.

    error : [m] of `off` as a whole, beside which they are fitted
    """
    size = np.linalg.norm(basis[:, :free], axis=0)
    scaled = basis / np.append(size, np.ones(basis.shape[1] - free))
    prior = np.diag(np.append(np.zeros(free), np.full(basis.shape[1] - free, error)))[free:]
    best = np.linalg.lstsq(np.vstack([scaled, prior]), np.append(off, np.zeros(len(prior))),
                           rcond=None)[0]
    return off - scaled @ best


def _error(case):
    """[m] per axis of where a channel settles: as its row has it."""
    return min(sd for row, sd in zip(case.rows, case.sd, strict=True) if row.kind == SETTLED)
