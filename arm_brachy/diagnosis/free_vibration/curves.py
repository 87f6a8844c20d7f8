"""Measured and predicted motion of a released body, as it is drawn.

Test: diagnosis/test_curves.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.diagnosis.free_vibration import held_out
from arm_brachy.diagnosis.report.curves import Curve
from arm_brachy.diagnosis.report.figures import Trace

MOST = 3        # channels that are drawn


@dataclass(frozen=True)
class FreePath:
    """One recording, k channels.

    t : (n,) [s] of the recording;  measured : (n, k, 3) [m] from where it was held, NaN = not seen
    before : (n, k, 3) predicted at the modulus that fits;  after : with the causes, or None
    noise : (k, 3) [m] of a sample;  floor : [m] rms that a repeat leaves
    """

    recording: str
    stream: str
    names: tuple
    t: np.ndarray
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray | None
    noise: np.ndarray
    floor: float


def path_of(case, descriptions, floor):
    """The FreePath of a observation.Case; descriptions : held_out.Description before, after."""
    drawn = [held_out.path(case, one) for one in descriptions]
    since, measured, before = drawn[0]
    release = case.release
    return FreePath(release.name, release.kind, release.names, since + release.t, measured,
                    before, drawn[1][2] if len(drawn) > 1 else None, release.noise, floor)


def free_curves(paths, label):
    """curves.Curve of the MOST channels with the largest misfit before, one axis each."""
    ranked = []
    for path in paths:
        left = np.sqrt(np.nanmean((path.measured - path.before) ** 2, axis=0))
        for k, axis in enumerate(np.argmax(left, axis=1)):
            ranked.append((float(left[k, axis]), path, k, int(axis)))
    ranked.sort(key=lambda one: -one[0])
    return tuple(Curve(
        path.recording, path.stream, path.names[k], axis, path.t, path.measured[:, k, axis],
        path.before[:, k, axis], float(path.noise[k, axis]),
        None if path.after is None else path.after[:, k, axis],
        '' if path.after is None else label) for _, path, k, axis in ranked[:MOST])


def free_traces(paths):
    """figures.Trace of each FreePath: rms over channels and axes."""
    def rms(path, predicted):
        return None if predicted is None else np.sqrt(np.nanmean(
            (path.measured - predicted) ** 2, axis=(1, 2)))

    return tuple(Trace(path.recording, path.stream, path.t, rms(path, path.before), path.floor,
                       rms(path, path.after)) for path in paths)
