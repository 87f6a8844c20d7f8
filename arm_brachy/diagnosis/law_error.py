"""What is left open by laws that hold to some per cent: of tests, and of the numbers fitted.

What a law is wrong by is alike in all of a recording and averages out with no number of rows; from
channel to channel (a marker, a pad, each axis) it is taken as independent.
Test: diagnosis/forward/test_refit.py
"""

import numpy as np

from arm_brachy.diagnosis.inference import posterior
from arm_brachy.diagnosis.stream import FORCE


def by_channel(observables, values):
    """Return columns (N, c): values (N,) split by channel and axis.

    observables : Observables of each recording, whose rows follow each other in N
    """
    keys = [(row.kind, row.channel, row.axis) for one in observables for row in one.rows]
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    out = np.zeros((len(values), len(number)))
    out[np.arange(len(values)), [number[key] for key in keys]] = values
    return out


def widened(found, data, factor, law):
    """Return the estimates, hypothesis number -> {field: Estimate}, of effects known to `law`.

    found : refit.Refit;  data : recording_fit.Data of its recordings, with their baselines
    factor : by which the modulus was scaled: forces by that are no effect of a cause
    law : share of an effect that the law may be wrong by, one standard deviation
    To first order: numbers move by what they would make of such errors in the data.
    """
    effect = []
    for one, residual in zip(data, found.residual, strict=True):
        shown = one.baseline.shown
        plain = one.observables.residual({**shown, FORCE: factor * shown[FORCE]})
        effect.append(plain - residual)
    errors = by_channel([one.observables for one in data], law * np.concatenate(effect))
    pulls, first = 0.0, 0
    for one, columns in zip(data, found.columns, strict=True):
        rows = slice(first, first + len(columns))
        first = rows.stop
        pulls = pulls + columns.T @ (errors[rows] - one.U @ posterior(one.U, errors[rows]).mean)
    moved = found.covariance @ pulls
    return found.space.estimates(found.z, found.mean, found.covariance + moved @ moved.T)
