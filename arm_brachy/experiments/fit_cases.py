"""What an estimator is fitted on: measured fresh plants, and how well it predicts targets."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.experiments import fresh_plants, inside_plants, inside_study
from arm_brachy.experiments.inside_measurements import session

SEED = 4411   # of the measurements' noise
MM = 1e3


@dataclass(frozen=True)
class Case:
    """One push of a fresh plant to one depth, measured.

    push : number among those of the plant;  count : of markers;  truth : (t, 3) [m]
    surfaces : Surface, from rest to the end of the hold
    """

    fresh: object
    push: int
    count: int
    surfaces: tuple
    truth: np.ndarray

    @property
    def last(self):
        """The Surface that is judged."""
        return self.surfaces[-1]

    @property
    def deepest(self):
        """True for pushes of 15 mm and more."""
        return self.last.q.max() >= 15e-3


def cases(solved):
    """Measure every push of `fresh_plants.plants` at each depth; the sets of markers alternate."""
    found, model = [], inside_plants.model_scene()
    for fresh, pushes in solved:
        for i, push in enumerate(pushes):
            count = tuple(inside_study.MARKER_SETS)[(fresh.number // len(fresh_plants.KINDS)
                                                     + fresh.number + i) % 2]
            names = inside_plants.tissue_markers(model)[inside_study.MARKER_SETS[count]]
            seen = session(fresh_plants.scene(fresh), push, names, SEED,
                           f'fresh {fresh.number}/{i}')
            found += [Case(fresh, i, count, seen.surfaces[:end + 1], truth)
                      for end, truth in zip(seen.ends, push.targets[1:], strict=True)]
    return found


@dataclass(frozen=True)
class Judgement:
    """What predictions are worth.

    nlpd : mean negative log predictive density of a target's place, in units of mm, after the
        covariance has been multiplied by `inflation`, at which 95 % of the truths lie inside
    error : mean [m];  deep : of pushes of 15 mm and more [m]
    squared : (n,) squared Mahalanobis distances of the truths, covariance as predicted
    """

    nlpd: float
    inflation: float
    error: float
    deep: float
    squared: np.ndarray

    @property
    def trials(self):
        """How many truths were predicted."""
        return len(self.squared)

    def covered_with(self, inflation):
        """Share of the truths in the 95 % ellipsoids of covariances times `inflation`."""
        return float(np.mean(self.squared <= inflation * inside_study.INSIDE_95))


def judge(some, predictions):
    """Judgement of predictions, one for each Case: (points (t, 3), covariances (t, 3, 3))."""
    off = np.array([p - case.truth for case, (p, _) in zip(some, predictions, strict=True)])
    P = np.array([covariance for _, covariance in predictions])
    squared = np.einsum('kti,kti->kt', off, np.linalg.solve(P, off[..., None])[..., 0])
    inflation = float(np.quantile(squared, 0.95)) / inside_study.INSIDE_95
    logdet = np.linalg.slogdet(MM**2 * P)[1] + 3.0 * np.log(inflation)
    nlpd = 0.5 * (squared / inflation + logdet + 3.0 * np.log(2.0 * np.pi))
    error, deep = np.linalg.norm(off, axis=2), np.array([case.deepest for case in some])
    return Judgement(float(nlpd.mean()), inflation, float(error.mean()), float(error[deep].mean()),
                     squared.ravel())


def blocks(covariance):
    """(t, 3, 3) diagonal blocks of a covariance (3t, 3t)."""
    t = len(covariance) // 3
    return covariance.reshape(t, 3, t, 3)[range(t), :, range(t)]
