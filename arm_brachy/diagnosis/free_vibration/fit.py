"""A cause, or the modulus alone, fitted to released bodies by full solutions.

Test: diagnosis/test_free_body.py
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from arm_brachy.core.errors import ConfigError, MeshError, NotConverged
from arm_brachy.diagnosis.results.cause import Estimate
from arm_brachy.tissue.assembly import InvertedElement
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

STEPS = 12          # Gauss and Newton's, of which three do as a rule
SMALL = 0.02        # prior standard deviations over which slopes are taken again
DONE = 0.02         # of a posterior standard deviation: no step is worth taking
HALVINGS = 6
NINETY = 1.645      # standard deviations of a 90 % interval
WIDE = 3.0          # times the prior of a cause, once it is named: its size is left to the data


@dataclass(frozen=True)
class FreeFit:
    """Parameters in prior standard deviations: of the frees in their order, then the modulus.

    mean, sd : (p + 1,);  terms : that say it, stiffness_scale last
    residual : (n,) over the errors, nuisances not taken out;  frees : candidates.Free each
    slopes : (n, p + 1) by which the residual falls with each;  cost : at the end
    """

    frees: tuple
    mean: np.ndarray
    sd: np.ndarray
    terms: tuple
    residual: np.ndarray
    modulus: float
    slopes: np.ndarray
    cost: float

    def stiffness(self, E):
        """Estimate [Pa] of Young's modulus where the scene has E."""
        m, sd = self.mean[-1] * self.modulus, self.sd[-1] * self.modulus
        return Estimate(float(E * np.exp(m)), float(E * np.exp(m - NINETY * sd)),
                        float(E * np.exp(m + NINETY * sd)))

    def parameters(self, i):
        """field -> Estimate of the i-th of the frees, SI; vectors whole."""
        first = sum(len(free.prior) for free in self.frees[:i])
        free = self.frees[i]
        a, sd = (v[first:first + len(free.prior)] * free.prior for v in (self.mean, self.sd))
        at = [free.hypothesis.term(_within(free, a + s * NINETY * sd)) for s in (0.0, -1.0, 1.0)]
        names = dict.fromkeys(s.name for s in free.hypothesis.strengths)
        return {name: _estimate(*(getattr(term, name) for term in at)) for name in names}


def _estimate(value, one, other):
    ends = [np.minimum(one, other), np.maximum(one, other)]
    low, high = np.minimum(ends[0], value), np.maximum(ends[1], value)
    if np.ndim(value):
        return Estimate(*(tuple(float(x) for x in v) for v in (value, low, high)))
    return Estimate(float(value), float(low), float(high))


def _within(free, amplitudes):
    """Amplitudes that the term accepts, as near as it goes towards them from nothing."""
    for _ in range(HALVINGS * 4):
        if free.allows(amplitudes):
            return amplitudes
        amplitudes = 0.8 * amplitudes
    return 0.0 * amplitudes


def refit(study, problem, frees=(), start=(), modulus=0.0):
    """Return the FreeFit of frees and modulus to the study.

    problem : judge.Problem of the study;  start : (p,) prior standard deviations
    modulus : to start from, its logarithm in prior standard deviations from the study's
    Least squares in the covariance of noise and nuisances. Raises NotConverged if not even the
    start has an equilibrium.
    """
    U = problem.U[:, :-1]       # the modulus, its last column, is fitted here
    factor = cho_factor(np.eye(U.shape[1]) + U.T @ U)

    def inverse(v):
        return v - U @ cho_solve(factor, U.T @ v)

    p = np.append(np.asarray(start, dtype=float), modulus)
    prior = np.append(np.full(len(p) - 1, WIDE ** -2), 1.0)
    middle = np.append(np.zeros(len(p) - 1), study.given)

    def cost(r, p):
        return r @ inverse(r) + (p - middle) @ (prior * (p - middle))

    p, r = _first(study, frees, p)
    for _ in range(STEPS):
        J = _slopes(study, frees, p, r)
        weighted = inverse(J)
        covariance = np.linalg.inv(J.T @ weighted + np.diag(prior))
        sd = np.sqrt(np.diag(covariance))
        step = covariance @ (weighted.T @ r - prior * (p - middle))
        p, r, went = _advance(study, frees, p, r, step, cost)
        if np.all(np.abs(went) <= DONE * sd):
            break
    return FreeFit(tuple(frees), p, sd, _terms(study, frees, p), r, study.priors.modulus, J,
                   float(cost(r, p)))


def _terms(study, frees, p):
    out, first = [], 0
    for free in frees:
        a = p[first:first + len(free.prior)] * free.prior
        if not free.allows(a):
            raise ConfigError(f'{free.hypothesis.name} out of its bounds')
        out.append(free.term(a))
        first += len(a)
    return (*out, StiffnessScale(factor=float(np.exp(p[-1] * study.priors.modulus))))


def _residual(study, frees, p):
    """(n,) at p, None where a term refuses it or there is no equilibrium."""
    try:
        return study.residual(_terms(study, frees, p))
    except (ConfigError, MeshError, NotConverged, InvertedElement):
        return None


def _first(study, frees, p):
    for _ in range(HALVINGS):
        r = _residual(study, frees, p)
        if r is not None:
            return p, r
        p = 0.5 * p
    raise NotConverged('the fit of a released body: no equilibrium near where the tangent leads')


def _slopes(study, frees, p, r):
    """(n, p) minus the derivative of the residual, by differences to the side that exists."""
    columns = []
    for k in range(len(p)):
        for step in (SMALL, -SMALL):
            there = _residual(study, frees, p + step * (np.arange(len(p)) == k))
            if there is not None:
                break
        columns.append(np.zeros_like(r) if there is None else (r - there) / step)
    return np.column_stack(columns)


def _advance(study, frees, p, r, step, cost):
    """(p, r, step taken), shortened until it exists and costs less; none if that is nowhere."""
    before = cost(r, p)
    for k in range(HALVINGS):
        went = 0.5 ** k * step
        there = _residual(study, frees, p + went)
        if there is not None and cost(there, p + went) <= before:
            return p + went, there, went
    return p, r, np.zeros_like(p)
