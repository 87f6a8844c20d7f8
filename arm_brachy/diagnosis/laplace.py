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
from scipy.linalg import cho_solve, cholesky

from arm_brachy.diagnosis.fitted import data_of, without_modulus


@dataclass(frozen=True)
class Gain:
    """What a full fit gains over the linear answer at the same states, natural logarithms.

    evidence : of the cause;  fit : of the density of the data and the numbers at their best alone
    """

    evidence: float
    fit: float


def gain_over_response(assembly, candidate, found):
    """The Gain of a full fit; None without fit.

    assembly : assembly.Assembly;  candidate : decide.Candidate;  found : its fitted.Fitted
    A place that is fitted pays by the volume that it leaves, and no more by the number of places
    that were tried (`Candidate.paid`). Good while the posterior is about normal.
    """
    if found.refit is None:
        return None
    fit, volumes = -found.refit.after, 0.5 * np.linalg.slogdet(found.refit.covariance)[1]
    slope, curvature, responses = 0.0, 0.0, [
        assembly.hypothesis_of(e)[1] for e in candidate.explanations]
    for i, (m, kept, back) in enumerate(zip(assembly.suspects, found.kept, found.back,
                                            strict=True)):
        data, fitted = data_of(m, kept), without_modulus(m, kept)
        r = data.residual({kind: values[kept] for kind, values in m.baseline.shown.items()})
        X = np.hstack([data.observables.whiten({kind: values[kept] for kind, values
                                                in one[i].per_prior().items()})
                       for one in responses])
        weighted, volume = _weighted(data.U, np.column_stack([X, r]))
        fit += 0.5 * r @ weighted[:, -1]
        volumes += volume - _weighted(np.hstack([fitted.U, back]), r[:, None])[1]
        slope, curvature = slope + X.T @ weighted[:, -1], curvature + X.T @ weighted[:, :-1]
    factor = np.eye(len(slope)) + curvature
    fit -= 0.5 * slope @ np.linalg.solve(factor, slope)
    volumes += 0.5 * np.linalg.slogdet(factor)[1] - _paid_for_places(candidate, found)
    return Gain(float(fit + volumes), float(fit))


def _weighted(U, X):
    """((I + U U')^-1 X (n, p), half the logarithm of the determinant of I + U U')."""
    factor = cholesky(np.eye(U.shape[1]) + U.T @ U, lower=True)
    return X - U @ cho_solve((factor, True), U.T @ X), float(np.log(np.diag(factor)).sum())


def _paid_for_places(candidate, found):
    """What the choice among variants cost, of causes whose variants are places that are fitted."""
    fitted = {(chart.number, chart.field) for chart in found.refit.space.charts}
    return sum(paid - e.log_prior for i, (e, paid, one) in enumerate(zip(
        candidate.explanations, candidate.paid, found.hypotheses, strict=True))
        if any((i, field) in fitted for field in one.place))
