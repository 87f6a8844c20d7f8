"""Estimates of targets beside truth or EM sensor: errors, and how often the ellipsoid holds it."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

MM = 1e3
LEVEL = 0.95
# Squared Mahalanobis distance within which a Gaussian of three dimensions has LEVEL of its mass.
WITHIN = float(chi2.ppf(LEVEL, 3))
# Times an estimate's usual interval after which it is missing.
_OVERDUE = 1.5


@dataclass(frozen=True)
class EstimateMetrics:
    """One estimator and target over a run. SI; errors are distances from the reference.

    count : estimates;  share : of the time, from the first estimate on, with one that is due
    mean, rms, p95, largest : [m];  offset : (3,) [m] mean error vector
    sd : [m] root of a third of the mean trace of the covariance
    coverage : share of estimates whose 95 % ellipsoid holds the truth. Errors of one run go
        together in time, so that no binomial interval belongs to it
    """

    estimator: str
    target: str
    count: int
    share: float
    mean: float
    rms: float
    p95: float
    largest: float
    offset: np.ndarray
    sd: float
    coverage: float


def estimate_metrics(run):
    """EstimateMetrics of every estimator and target of a RunData that has a reference, a tuple.

    Beside an EM sensor errors contain the sensor's noise and what its registration leaves.
    """
    return tuple(_metrics(name, target, said, run.reference[target])
                 for name, targets in run.estimates.items()
                 for target, said in targets.items() if target in run.reference and len(said.t))


def estimate_rows(numbers):
    """One flat dict per EstimateMetrics, units in the keys."""
    return tuple({'estimator': n.estimator, 'target': n.target, 'estimates': n.count,
                  'available_percent': 100.0 * n.share, 'mean_error_mm': n.mean * MM,
                  'rms_error_mm': n.rms * MM, 'p95_error_mm': n.p95 * MM,
                  'largest_error_mm': n.largest * MM, 'claimed_sd_mm': n.sd * MM,
                  'coverage_percent': 100.0 * n.coverage} for n in numbers)


def true_at(truth, t):
    """Positions (n, 3) [m] of a Series of truth at times t (n,) [s], interpolated."""
    return np.stack([np.interp(t, truth.t, axis) for axis in truth.values.T], axis=1)


def held(error, covariance):
    """(n,) bool: the 95 % ellipsoid of covariance (n, 3, 3) holds an error (n, 3) [m]."""
    return np.einsum('ni,ni->n', error, np.linalg.solve(covariance, error[..., None])[..., 0]
                     ) <= WITHIN


def _metrics(name, target, said, truth):
    error = said.points - true_at(truth, said.t)
    size = np.linalg.norm(error, axis=1)
    return EstimateMetrics(
        name, target, len(size), _share(said.t, truth.t[-1]), size.mean(),
        np.sqrt(np.mean(size**2)), np.quantile(size, 0.95), size.max(), error.mean(axis=0),
        np.sqrt(np.trace(said.covariance, axis1=1, axis2=2).mean() / 3.0),
        held(error, said.covariance).mean())


def _share(t, end):
    """Share of the time from t[0] to `end` with an estimate no older than it should be."""
    if len(t) < 2 or end <= t[0]:
        return 1.0
    steps = np.diff(np.append(t, end))
    allowed = _OVERDUE * np.median(np.diff(t))
    return float(np.minimum(steps, allowed).sum() / steps.sum())
