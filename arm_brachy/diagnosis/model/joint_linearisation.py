"""One baseline over several recordings, so that what they share is solved for once."""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.signals.motion import Path

BETWEEN = 1e-3      # s from the end of one recording to the begin of the next, at the same place


def baselines(model, trials):
    """Return the Baseline of each of `trials` (trials.Trial), with a clock of its own.

    All begin and end at the same place. A body with memory has the trials before a trial in it,
    what is new to it begins at rest.
    Raises what Baseline raises.
    """
    starts = np.cumsum([0.0, *(trial.path.t[-1] + BETWEEN for trial in trials)])
    path = Path(np.concatenate([trial.path.t + start for trial, start in
                                zip(trials, starts[:-1], strict=True)]),
                np.concatenate([trial.path.q for trial in trials]))
    whole = Baseline(model, path, np.concatenate([trial.t + start for trial, start in
                                                  zip(trials, starts[:-1], strict=True)]))
    return tuple(_stretch(whole, start, stop - 0.5 * BETWEEN)
                 for start, stop in zip(starts[:-1], starts[1:], strict=True))


def _stretch(whole, start, stop):
    """The part of a Baseline from `start` to `stop` [s], its clock at zero at the start."""
    part = whole.take(np.flatnonzero((whole.t >= start) & (whole.t < stop)))
    inside = (whole.trajectory.t >= start) & (whole.trajectory.t < stop)
    trajectory = whole.trajectory.take(np.flatnonzero(inside))
    part.trajectory, part.t = replace(trajectory, t=trajectory.t - start), part.t - start
    part.at = np.searchsorted(part.trajectory.t, part.t)
    part.encoder, part.path = (_cut(path, start, stop) for path in (whole.encoder, whole.path))
    return part


def _cut(path, start, stop):
    inside = (path.t >= start) & (path.t < stop)
    return Path(path.t[inside] - start, path.q[inside])
