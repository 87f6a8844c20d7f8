"""Candidates fitted in full when they are asked for, and whether they leave anything.

Test: diagnosis/test_full_fits.py
"""

import numpy as np
from scipy.stats import chi2

from arm_brachy.diagnosis.estimation.cross_validation import with_found
from arm_brachy.diagnosis.estimation.fit import fit_in_full, parts_of
from arm_brachy.diagnosis.estimation.laplace import Gain, gain_over_response
from arm_brachy.diagnosis.likelihood.constitutive_error import (
    law_errors,
    law_of,
    of_tissue,
    past_errors,
)
from arm_brachy.diagnosis.likelihood.discrepancy import Accuracy
from arm_brachy.diagnosis.progress import FITS, Count, untold
from arm_brachy.diagnosis.selection.misfit_tests import in_directions, structured_tests
from arm_brachy.diagnosis.selection.pooled_misfit_tests import Past
from arm_brachy.diagnosis.settings import Rules
from arm_brachy.diagnosis.statistics.linear_gaussian import Beside, evidence_over_none, stacked
from arm_brachy.diagnosis.statistics.misfit_scan import scan

AS_GOOD = 1.0       # gain of a full fit in log density, below which its response does as well


class FullFits:
    """Fitted of every judge.Candidate that is asked for, once, and what each leaves.

    rng : numpy.random.Generator for the distribution of structured tests
    accuracy : discrepancy.Accuracy, None = its defaults: how well a law can hold
    ends : ids of hypotheses -> Fitted.end of fits of the same recordings in other noise, from
        which those of these begin, and go on where they did not settle; those made here are added
    quiet : FullFits of the same recordings in quieter noise, None = there are none
    count : progress.Count of full fits, None = nobody counts
    """

    def __init__(self, assembly, rng, accuracy=None, ends=None, quiet=None, count=None):
        self._count = count or Count(untold, FITS, 0)
        self._assembly, self._rng, self._known, self._gains = assembly, rng, {}, {}
        self._ends, self._quiet, self._worth = {} if ends is None else ends, quiet, {}
        self._law = (accuracy or Accuracy()).law

    def of(self, candidate):
        """The Fitted of a judge.Candidate."""
        key = tuple(map(id, candidate.explanations))
        if key not in self._known:
            self._known[key] = self._fit(candidate)
        return self._known[key]

    @property
    def gains(self):
        """Ids of explanations -> laplace.Gain of the full fits that are over; None = unsettled."""
        return dict(self._gains)

    def _fit(self, candidate):
        """The Fitted of a judge.Candidate, begun where that of other noise ended."""
        hypotheses = self._hypotheses(candidate)
        self._count.begin(' + '.join(candidate.causes))
        found = fit_in_full(self._assembly, candidate, self._law, self._ends.get(hypotheses))
        self._count.finish()
        if found.end is not None:
            self._ends[hypotheses] = found.end
        return found

    def _hypotheses(self, candidate):
        """Ids of the hypotheses of a judge.Candidate: the same in any noise."""
        return tuple(id(self._assembly.hypothesis_of(e)[0]) for e in candidate.explanations)

    def check(self, candidate):
        """The misfit_scan.Scan of what it leaves, its numbers free to first order.

        Full fits are made at some of the states. Where the response does as well there, it is
        asked what it leaves in all of them: of weak effects a third of the states shows little.
        """
        return (self._linear if self._response_does(candidate) else self._fitted)(candidate)

    def beyond(self, candidate, explanations):
        """Log evidence of more decide.Explanations in what a Candidate leaves, over none.

        Beside what its law may have wrong: by some per cent of a strong cause another one may be
        paid that is not there. As `check`, by the full fit of the Candidate or by its response.
        """
        if self._response_does(candidate):
            U, left, size = self._response_leaves(candidate)
            columns = [e.columns for e in explanations]
        else:
            parts, U, left, size = self._fit_leaves(candidate)
            columns = [self._columns(e, parts, self.of(candidate).kept) for e in explanations]
        weight = 1.0 / np.sqrt(1.0 + np.square(size))
        shown = weight[:, None] * np.hstack(columns)
        seen = Beside(weight[:, None] * U).weighted(shown)
        return evidence_over_none(seen.T @ shown, seen.T @ (weight * left))

    def gain(self, candidate):
        """laplace.Gain of the full fit of a judge.Candidate; None if it did not settle.

        What was worth nothing in quieter noise is worth no more in this, and is not fitted again:
        where it leaves the data as they are, no place of it is better than another.
        """
        key = tuple(map(id, candidate.explanations))
        if key not in self._gains:
            self._gains[key] = self._worthless(candidate) or gain_over_response(
                self._assembly, candidate, self.of(candidate))
            if self._gains[key]:
                self._worth[self._hypotheses(candidate)] = Gain(
                    candidate.evidence + self._gains[key].evidence,
                    candidate.fit + self._gains[key].fit)
        return self._gains[key]

    def _worthless(self, candidate):
        """The Gain by which a Candidate is worth what little it was in quieter noise; None if it
        was not fitted there, or promised something.
        """
        found = self._quiet and self._quiet._worth.get(self._hypotheses(candidate))
        if not found or found.evidence >= Rules().promising:
            return None
        return Gain(found.evidence - candidate.evidence, found.fit - candidate.fit)

    def gone(self, candidate):
        """True if a cause of it may be nothing at all once its numbers are fitted in full.

        What one number of its own, or of the model, explains as well has then no size left.
        Of several numbers each may be nothing where all of them cannot.
        """
        found = self.of(candidate)
        return found.refit is not None and any(
            all(_may_be_nothing(strength, estimates[strength.name])
                for strength in hypothesis.strengths)
            and not _are_something(found.refit, number, hypothesis.strengths)
            for number, (hypothesis, estimates) in enumerate(
                zip(found.hypotheses, found.estimates, strict=True)))

    def _response_does(self, candidate):
        """True if a full fit did not settle or does no better than the response."""
        gain = self.gain(candidate)
        return gain is None or gain.fit < AS_GOOD

    def _columns(self, explanation, parts, kept):
        """Columns (N, p) of a judge.Explanation at the states `kept` of every Part."""
        responses = self._assembly.hypothesis_of(explanation)[1]
        return np.vstack([part.observables.whiten(
            {kind: values[some] for kind, values in one.per_prior().items()})
            for part, some, one in zip(parts, kept, responses, strict=False)])

    def _fitted(self, candidate):
        """The Scan of what the full fit leaves at its states."""
        parts, U, left, size = self._fit_leaves(candidate)
        kept = self.of(candidate).kept
        structured = structured_tests(self._assembly.suspects, [
            (part.observables, some) for part, some in zip(parts, kept, strict=True)])
        return self._scan(U, left, size, structured)

    def _linear(self, candidate):
        """The Scan of what the linear answer leaves."""
        return self._scan(*self._response_leaves(candidate),
                          (self._assembly.problem.tests, self._assembly.tests))

    def _fit_leaves(self, candidate):
        """(Parts, U (N, k), what is left (N,), size (N,)) of a full fit at its states.

        U : nuisances, its numbers to first order, and errors of its law;  size : of these by row
        """
        found, matched = self.of(candidate), self._assembly.suspects
        parts, law = parts_of(self._assembly, found, 1.0), law_of(found.hypotheses, self._law)
        sizes = [law * (part.r - part.of_mesh - residual) * of_tissue(
            part.observables, m.baseline.model.specimen)
            for part, residual, m in zip(parts, found.refit.residual, matched, strict=True)]
        named, columns = with_found(parts)
        U = np.hstack([stacked(parts), columns])
        pushes = [pushes_of(m)[kept] for m, kept in zip(matched, found.kept, strict=True)]
        errors = law_errors([part.observables for part in parts], pushes, sizes)
        left = named - np.concatenate([part.of_mesh for part in parts])
        return parts, np.hstack([U, errors]), left, np.concatenate(sizes)

    def _response_leaves(self, candidate):
        """(U, what is left, size) as of `_fit_leaves`, of the linear answer at all states."""
        problem, found = self._assembly.problem, candidate.explanations
        law = law_of([self._assembly.hypothesis_of(e)[0] for e in found], self._law)
        columns, matched = np.hstack([e.columns for e in found]), self._assembly.matched
        soft = np.concatenate([of_tissue(m.observables, m.baseline.model.specimen)
                               for m in matched])
        size = law * soft * (columns @ candidate.mean)
        errors = law_errors([m.observables for m in matched], [pushes_of(m) for m in matched],
                            np.split(size, np.cumsum([len(m.r) for m in matched])[:-1]))
        return np.hstack([problem.U, columns, errors]), problem.r, size

    def _scan(self, U, r, size, structured):
        """The Scan beside U of r (N,) with an effect in it that rows have wrong by size (N,).

        structured : columns (N, m) of tests and their labels
        """
        tests, labels = structured
        past = np.array([isinstance(label, Past) for label in labels])
        U = np.hstack([U, past_errors(tests[:, past], size)])
        weight = 1.0 / np.sqrt(1.0 + np.square(size))
        return scan(weight[:, None] * U, weight * r, weight[:, None] * tests, self._rng,
                    together=in_directions(labels))


def pushes_of(m):
    """Travel (n, p) [m] of the pads at the states of a Matched."""
    return m.baseline.path.at(m.baseline.t)


def _may_be_nothing(strength, estimate):
    """True if the 90 % interval of a Strength holds the value at which it has no effect."""
    low, high = estimate.low, estimate.high
    if strength.component is not None:
        low, high = low[strength.component], high[strength.component]
    return low <= strength.neutral <= high


def _are_something(refit, number, strengths):
    """True if Strengths of a hypothesis of a map_fit.Refit cannot all have no effect (90 %).

    Where they have none its place and its width do nothing either, and make up for none of them:
    of a lump only the product of size and contrast is known, and a tangent has any contrast, none
    too, made up for by size.
    """
    if not np.all(np.isfinite([one.neutral for one in strengths])):
        return False
    mine = np.flatnonzero(refit.space.owner == number)
    precision = np.linalg.inv(refit.covariance[np.ix_(mine, mine)])
    away = np.zeros(len(refit.z))
    for one in strengths:
        chart, part = next((chart, part) for chart, part in zip(
            refit.space.charts, refit.space.slices, strict=True)
            if (chart.number, chart.field) == (number, one.name))
        k, z = one.component or 0, refit.z[part]
        h = np.eye(len(z))[k] * chart.step[k]
        now, before, after = (np.atleast_1d(chart.value(at))[k] for at in (z, z - h, z + h))
        away[part.start + k] = (now - one.neutral) * 2.0 * chart.step[k] / (after - before)
    return bool(away[mine] @ precision @ away[mine] > chi2.ppf(0.9, len(strengths)))
