"""Rigid: targets go where the markers' best rigid motion takes them. No mechanics at all."""

import numpy as np

from arm_brachy.core.outcome import Outcome
from arm_brachy.estimation.estimate import Estimate
from arm_brachy.estimation.model_body import ModelBody

FEWEST = 3      # markers, not on one line
FLATTEST = 1e-6  # second singular value over the first, below which they are on one


class Rigid:
    """Point-set registration of the markers, from rest to now, applied to the targets.

    Least squares over rotations and translations: Kabsch 1976, Acta Cryst A32:922. What image
    guidance does without a model of the tissue. Its covariance is NaN: the residual of a fit that
    deformation dominates says nothing of the inside.
    Test: estimation/test_baselines.py
    """

    def __init__(self, scene, terms, targets, markers):
        """Arguments as `ModelBody`."""
        self._model = ModelBody(scene, terms, targets, markers)
        self.targets = self._model.targets

    def reset(self):
        """Nothing is remembered."""

    def step(self, surface):
        """Return the Estimate of a Surface; REJECTED where markers leave a rotation open."""
        seen = surface.seen
        motion = rigid_motion(self._model.rest_markers[seen], surface.markers[seen])
        if motion is None:
            return Estimate.failed(surface.t, self.targets, Outcome.REJECTED,
                                   f'{seen.sum()} markers seen; a rigid motion needs {FEWEST} '
                                   'that are not on one line')
        R, p = motion
        points = self._model.rest_targets @ R.T + p
        return Estimate(surface.t, self.targets, points, np.full((len(points), 3, 3), np.nan))


def rigid_motion(before, after):
    """Rotation (3, 3) and translation (3,) [m] that take `before` (k, 3) nearest to `after`.

    Returns None where the points leave a rotation open.
    """
    if len(before) < FEWEST:
        return None
    a, b = before.mean(axis=0), after.mean(axis=0)
    U, spread, Vt = np.linalg.svd((after - b).T @ (before - a))
    if spread[1] <= FLATTEST * spread[0]:
        return None
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return R, b - R @ a


def build(scene, terms, targets, markers, params=None):
    """The estimator; params : none needed."""
    return Rigid(scene, terms, targets, markers)
