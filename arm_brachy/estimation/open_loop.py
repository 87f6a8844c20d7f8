"""Open loop: the finite elements at the pads' travel. Markers are not looked at."""

import numpy as np

from arm_brachy.estimation.estimate import Estimate
from arm_brachy.estimation.model_body import ModelBody
from arm_brachy.tissue.mesh import interpolate
from arm_brachy.tissue.newton import StaticSolver


class OpenLoop:
    """Equilibrium of the model by Newton, the baseline of every table.

    It says nothing of how wrong the model is: its covariance is NaN.
    Test: estimation/test_baselines.py
    """

    def __init__(self, scene, terms, targets, markers):
        """Arguments as `ModelBody`."""
        self._model = ModelBody(scene, terms, targets, markers)
        self.targets = self._model.targets
        self._solver = StaticSolver(self._model.body)
        self.reset()

    def reset(self):
        """Forget the last state; the next solve starts from rest."""
        self._x, self._q = self._model.body.mesh.nodes, None

    def step(self, surface):
        """Return the Estimate of a Surface; a failed solve leaves the last state to start from."""
        if self._q is None or not np.array_equal(surface.q, self._q):
            solution = self._solver.solve(self._x, self._model.pad_displacement(surface.q))
            if not solution.outcome.ok:
                return Estimate.failed(surface.t, self.targets, solution.outcome)
            self._x, self._q = solution.x, np.array(surface.q)
        points = interpolate(self._model.target_rider, self._x)
        return Estimate(surface.t, self.targets, points,
                        np.full((len(points), 3, 3), np.nan), self._x)


def build(scene, terms, targets, markers, params=None):
    """The estimator; params : none needed."""
    return OpenLoop(scene, terms, targets, markers)
