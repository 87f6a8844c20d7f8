"""What a judge.Judge asks full fits of released bodies: what a cause is worth, what it leaves.

Responses are taken at one modulus and for small effects; where a cause has to be large, it is the
full solutions at its best numbers that must leave nothing, or it explains nothing.
Test: diagnosis/test_free_body.py
"""

from dataclasses import replace

import numpy as np
from scipy.stats import norm

from arm_brachy.core.errors import NotConverged
from arm_brachy.diagnosis.estimation.laplace import Gain
from arm_brachy.diagnosis.free_vibration.fit import WIDE, refit
from arm_brachy.diagnosis.progress import FITS, Count, untold
from arm_brachy.diagnosis.statistics.linear_gaussian import log_density, posterior
from arm_brachy.diagnosis.statistics.misfit_scan import Scan, scan


class FreeFullFits:
    """Full fits of decide.Candidates, each made once.

    study : problem.FreeStudy;  problem : judge.Problem;  answers : problem.Answer each
    rng : numpy.random.Generator for the structured tests;  count : progress.Count of full fits
    """

    def __init__(self, study, problem, answers, rng, count=None):
        self._count = count or Count(untold, FITS, 0)
        self._study, self._problem, self._rng = study, problem, rng
        self._answers = {a.free.key: a for a in answers}
        self._known = {}

    def fit(self, candidate):
        """Return the fit.FreeFit of a Candidate; None if it finds no equilibrium."""
        keys = tuple((e.cause, e.variant) for e in candidate.explanations)
        if keys not in self._known:
            self._count.begin(' + '.join(candidate.causes))
            self._known[keys] = self._made([self._answers[key] for key in keys], candidate.mean)
            self._count.finish()
        return self._known[keys]

    def weigh(self, candidate):
        """Return the laplace.Gain of the full fit over the responses; None where there is none."""
        fit = self.fit(candidate)
        if fit is None:
            return None
        X = np.hstack([self._problem.U, *(e.columns for e in candidate.explanations)])
        U, r = self._about(fit)
        return Gain(log_density(U, r) - log_density(X, self._problem.r),
                    0.5 * _least(X, self._problem.r) - 0.5 * _least(U, r))

    def lead(self, candidate, other):
        """Return by how much the full fit of a Candidate is likelier than another's."""
        return 0.5 * (self.fit(other).cost - self.fit(candidate).cost)

    def left(self, candidate):
        """Return the misfit_scan.Scan of what the full fit leaves; where there is none, all.

        The size of a cause is left to the data, as in its fit. How far the modulus has to be from
        where it was expected counts as well: two independent chances (Fisher 1925, Statistical
        Methods for Research Workers, sec. 21.1).
        """
        fit = self.fit(candidate)
        if fit is None:
            return Scan(np.zeros(self._problem.tests.shape[1]), 0, 0.0)
        found = scan(*self._about(fit, WIDE), self._problem.tests, self._rng)
        modulus = 2.0 * float(norm.sf(abs(fit.mean[-1] - self._study.given)))
        return replace(found, chance=_both(found.chance, modulus))

    def gone(self, candidate):
        """Return True for a Candidate that has no full fit: no body is as it would have it."""
        return self.fit(candidate) is None

    def _about(self, fit, wide=1.0):
        """(U, r) of the problem made linear at a FreeFit: r is what would be left of nothing.

        wide : times the prior of a cause, the modulus keeping its own
        """
        spread = np.append(np.full(len(fit.mean) - 1, wide), 1.0)
        U = np.hstack([self._problem.U[:, :-1], fit.slopes * spread])
        away = fit.mean - np.append(np.zeros(len(fit.mean) - 1), self._study.given)
        return U, fit.residual + fit.slopes @ away

    def _made(self, answers, mean):
        try:
            return refit(self._study, self._problem, [a.free for a in answers],
                         *_start(answers, mean))
        except NotConverged:
            return None


def _both(one, other):
    """Chance that the product of two independent chances is as small as that of these."""
    product = one * other
    return product * (1.0 - float(np.log(product))) if product > 0.0 else 0.0


def _start(answers, mean):
    """(parameters, modulus) to start from: of what was fitted alone as it was found there."""
    start, first, modulus = [], 0, 0.0
    for answer in answers:
        k = len(answer.free.prior)
        known = answer.fit is not None
        start += (answer.fit.mean[:-1] if known else mean[first:first + k]).tolist()
        modulus = answer.fit.mean[-1] if known else modulus
        first += k
    return start, modulus


def _least(U, r):
    """Squares of the data and of the coefficients of U (n, k) at their best."""
    z = posterior(U, r).mean
    return float(np.sum((r - U @ z) ** 2) + z @ z)
