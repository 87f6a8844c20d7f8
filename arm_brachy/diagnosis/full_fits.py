"""Candidates fitted in full when they are asked for, and whether they leave anything.

Test: diagnosis/test_full_fits.py
"""

import numpy as np

from arm_brachy.diagnosis.adequacy import scan
from arm_brachy.diagnosis.assembly import features_of, structured_tests
from arm_brachy.diagnosis.fitted import fit_in_full, parts_of
from arm_brachy.diagnosis.held_out import stacked
from arm_brachy.diagnosis.law_error import by_channel, law_of
from arm_brachy.diagnosis.model_error import Accuracy


class FullFits:
    """Fitted of every decide.Candidate that is asked for, once, and what each leaves.

    rng : numpy.random.Generator for the distribution of structured tests
    accuracy : model_error.Accuracy, None = its defaults: how well a law can hold
    """

    def __init__(self, assembly, rng, accuracy=None):
        self._assembly, self._rng, self._known = assembly, rng, {}
        self._law = (accuracy or Accuracy()).law

    def of(self, candidate):
        """The Fitted of a decide.Candidate."""
        key = tuple(map(id, candidate.explanations))
        if key not in self._known:
            self._known[key] = fit_in_full(self._assembly, candidate, self._law)
        return self._known[key]

    def check(self, candidate):
        """The adequacy.Scan of what it leaves, its numbers free to first order."""
        found = self.of(candidate)
        if found.refit is None:
            return self._linear(candidate)
        parts = parts_of(self._assembly, found, 1.0)
        tests, _ = structured_tests([
            (part.observables, {name: values[kept] for name, values in features_of(m).items()})
            for part, m, kept in zip(parts, self._assembly.matched, found.kept, strict=False)])
        effect = np.concatenate([part.r - residual for part, residual in
                                 zip(parts, found.refit.residual, strict=True)])
        U = np.hstack([stacked(parts), np.vstack([part.columns for part in parts])])
        return self._scan(U, np.concatenate([part.named for part in parts]), tests, effect,
                          [part.observables for part in parts],
                          law_of(found.hypotheses, self._law))

    def gone(self, candidate):
        """True if a cause of it may be nothing at all once its numbers are fitted in full.

        What one number of its own, or of the model, explains as well has then no size left.
        """
        found = self.of(candidate)
        return found.refit is not None and any(
            all(_may_be_nothing(strength, estimates[strength.name])
                for strength in hypothesis.strengths)
            for hypothesis, estimates in zip(found.hypotheses, found.estimates, strict=True))

    def _linear(self, candidate):
        """The Scan of what the linear answer leaves."""
        problem, found = self._assembly.problem, candidate.explanations
        law = law_of([self._assembly.hypothesis_of(e)[0] for e in found], self._law)
        columns = np.hstack([e.columns for e in found])
        return self._scan(np.hstack([problem.U, columns]), problem.r, problem.tests,
                          columns @ candidate.mean,
                          [m.observables for m in self._assembly.matched], law)

    def _scan(self, U, r, tests, effect, observables, law):
        """The Scan beside U of r (N,) with an effect (N,) in it that is known to a share, law."""
        U = np.hstack([U, by_channel(observables, law * effect)])
        weight = 1.0 / np.sqrt(1.0 + np.square(law * effect))
        return scan(weight[:, None] * U, weight * r, weight[:, None] * tests, self._rng)


def _may_be_nothing(strength, estimate):
    """True if the 90 % interval of a Strength holds the value at which it has no effect."""
    low, high = estimate.low, estimate.high
    if strength.component is not None:
        low, high = low[strength.component], high[strength.component]
    return low <= strength.neutral <= high
