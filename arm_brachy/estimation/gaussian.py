"""Gaussian states and linear measurements: the closed-form update, and its robust form."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from arm_brachy.core.errors import NotConverged


@dataclass(frozen=True)
class Posterior:
    """What a measurement leaves: mean (k,), covariance (k, k).

    distance : normalised innovation squared, r' S^-1 r, expected (m) where all is as assumed
    """

    mean: np.ndarray
    covariance: np.ndarray
    distance: float


def condition(mean, covariance, residual, H, R):
    """Condition a Gaussian on one linear measurement (Joseph form).

    mean : (k,);  covariance : (k, k);  residual : (m,) measured less expected at `mean`
    H : (m, k);  R : (m, m) covariance of the measurement
    Returns Posterior. Raises NotConverged, naming the smallest eigenvalue, where H P H' + R is
    not positive definite. Exact for linear measurements with Gaussian noise.
    Source: Bar-Shalom, Li & Kirubarajan 2001, Estimation with Applications, sec. 5.2.
    Test: estimation/test_gaussian.py::test_equals_the_batch_formula
    """
    PH = covariance @ H.T
    S = H @ PH + R
    try:
        factor = cho_factor(0.5 * (S + S.T))
    except LinAlgError:
        raise NotConverged('gaussian update: covariance of the measurement has eigenvalue '
                           f'{np.linalg.eigvalsh(S)[0]:.3g}; must be positive; give every '
                           'measurement some noise') from None
    K = cho_solve(factor, PH.T).T
    keep = np.eye(len(mean)) - K @ H
    updated = keep @ covariance @ keep.T + K @ R @ K.T
    return Posterior(mean + K @ residual, 0.5 * (updated + updated.T),
                     float(residual @ cho_solve(factor, residual)))


def registration_jacobian(points):
    """Return d points / d (rotation vector, translation), (3 k, 6), about the points' centroid.

    points : (k, 3) [m]; the order of Surface.frame_covariance
    """
    arms = points - points.mean(axis=0)
    J = np.zeros((len(points), 3, 6))
    J[:, 0, 1], J[:, 0, 2] = arms[:, 2], -arms[:, 1]
    J[:, 1, 0], J[:, 1, 2] = -arms[:, 2], arms[:, 0]
    J[:, 2, 0], J[:, 2, 1] = arms[:, 1], -arms[:, 0]
    J[:, :, 3:] = np.eye(3)
    return J.reshape(-1, 6)


def student_weights(squared, dof, dimension=3):
    """Return weights of iterated reweighting for multivariate Student noise, 1 at most.

    squared : (m,) residual' covariance^-1 residual of each measured vector;  dof : nu > 0
    w = (nu + d) / (nu + squared), capped: a measurement that fits better than it should is
    believed as its covariance says, no more. Source: Lange, Little & Taylor 1989, J Am Stat Assoc
    84:881, eq. (8).
    """
    return np.minimum(1.0, (dof + dimension) / (dof + squared))
