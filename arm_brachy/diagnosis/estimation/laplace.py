"""Evidence of a full fit, by Laplace's approximation, beside that of the linear answer.

The evidence is the cost at its minimum and the volume of the posterior over that of the prior
(MacKay 1992, Neural Comput 4:415). A full fit is made at some states of each recording; what it
gains there over the linear answer at the same states is what bends with the size of an effect, and
what lies between the places that were tried. The modulus is a nuisance of the one and a number of
the other: the determinants of both count.
Test: diagnosis/theorems/test_full_evidence.py
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.diagnosis.estimation.fit import data_of, without_modulus
from arm_brachy.diagnosis.statistics.linear_gaussian import Beside, stacked


@dataclass(frozen=True)
class Gain:
    """What a full fit gains over the linear answer at the same states, natural logarithms.

    evidence : of the cause;  fit : of the density of the data and the numbers at their best alone
    """

    evidence: float
    fit: float


def gain_over_response(assembly, candidate, found):
    """The Gain of a full fit; None without fit.

    assembly : problem.Assembly;  candidate : judge.Candidate;  found : its fit.Fitted
    A place that is fitted pays by the volume that it leaves, and no more by the number of places
    that were tried (`Candidate.paid`). Good while the posterior is about normal.
    """
    if found.refit is None:
        return None
    fit, volumes = -found.refit.after, 0.5 * np.linalg.slogdet(found.refit.covariance)[1]
    responses = [assembly.hypothesis_of(e)[1] for e in candidate.explanations]
    linear, fitted, columns, residual = [], [], [], []
    for i, (m, kept, back) in enumerate(zip(assembly.suspects, found.kept, found.back,
                                            strict=True)):
        linear.append(data_of(m, kept))
        fitted.append(without_modulus(m, kept).beside(back))
        residual.append(linear[-1].residual(
            {kind: values[kept] for kind, values in m.baseline.shown.items()}))
        columns.append(np.hstack([linear[-1].observables.whiten(
            {kind: values[kept] for kind, values in one[i].per_prior().items()})
            for one in responses]))
    beside, X, r = Beside(stacked(linear)), np.vstack(columns), np.concatenate(residual)
    fit += 0.5 * beside.square(r)
    volumes += beside.half_log_det - Beside(stacked(fitted)).half_log_det
    weighted = beside.weighted(X)
    slope, curvature = weighted.T @ r, weighted.T @ X
    factor = np.eye(len(slope)) + curvature
    fit -= 0.5 * slope @ np.linalg.solve(factor, slope)
    volumes += 0.5 * np.linalg.slogdet(factor)[1] - _paid_for_places(candidate, found)
    return Gain(float(fit + volumes), float(fit))


def _paid_for_places(candidate, found):
    """What the choice among variants cost, of causes whose variants are places that are fitted."""
    fitted = {(chart.number, chart.field) for chart in found.refit.space.charts}
    return sum(paid - e.log_prior for i, (e, paid, one) in enumerate(zip(
        candidate.explanations, candidate.paid, found.hypotheses, strict=True))
        if any((i, field) in fitted for field in one.place))
