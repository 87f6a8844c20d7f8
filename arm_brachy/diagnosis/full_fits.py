"""Candidates fitted in full when they are asked for, and whether they leave anything.

Test: diagnosis/test_diagnose.py
"""

import numpy as np

from arm_brachy.diagnosis.adequacy import scan
from arm_brachy.diagnosis.assembly import features_of, structured_tests
from arm_brachy.diagnosis.fitted import data_of, fit_in_full, parts_of
from arm_brachy.diagnosis.held_out import stacked
from arm_brachy.diagnosis.law_error import by_channel
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
        problem = self._assembly.problem
        if found.refit is None:
            U = np.hstack([problem.U, *(e.columns for e in candidate.explanations)])
            return scan(U, problem.r, problem.tests, self._rng)
        parts = parts_of(self._assembly, found, 1.0)
        features = [{name: values[data_of(m)[1]] for name, values in features_of(m).items()}
                    for m in self._assembly.matched]
        tests, _ = structured_tests(
            [(part.observables, f) for part, f in zip(parts, features, strict=False)])
        effect = np.concatenate([part.r - residual for part, residual in
                                 zip(parts, found.refit.residual, strict=True)])
        U = np.hstack([stacked(parts), np.vstack([part.columns for part in parts]),
                       by_channel([part.observables for part in parts], self._law * effect)])
        weight = 1.0 / np.sqrt(1.0 + np.square(self._law * effect))
        return scan(weight[:, None] * U, weight * np.concatenate([p.named for p in parts]),
                    weight[:, None] * tests, self._rng)
