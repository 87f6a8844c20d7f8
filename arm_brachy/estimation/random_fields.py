"""Smooth random fields: the leading modes of a Matern covariance over scattered points."""

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh
from scipy.spatial.distance import cdist

from arm_brachy.core.errors import InputError

DENSE = 1500  # points up to which the whole spectrum is cheaper than an iteration


def matern(distance, length):
    """Return the Matern covariance of smoothness 3/2 and unit variance, shape of `distance`.

    distance : [m];  length : [m] correlation length l in (1 + r sqrt(3) / l) exp(-r sqrt(3) / l)
    Source: Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, eq. (4.17).
    """
    scaled = np.sqrt(3.0) * np.asarray(distance) / length
    return (1.0 + scaled) * np.exp(-scaled)


def field_modes(points, length, count):
    """Return modes (n, k), k <= count, whose sum with standard normal factors is the field.

    points : (n, 3) [m];  length : [m] as in `matern`;  count : how many at most
    The modes are the leading ones of the covariance, scaled so that the mean variance over the
    points is one: what truncation takes away is put back evenly. Raises InputError for a length
    that is not positive.
    """
    if not length > 0.0:
        raise InputError(f'correlation length {length} m; must be positive')
    n, count = len(points), min(count, len(points))
    covariance = matern(cdist(points, points), length)
    if n <= DENSE or count > n // 4:
        values, vectors = eigh(covariance, subset_by_index=(n - count, n - 1))
    else:
        values, vectors = eigsh(covariance, k=count, v0=np.ones(n))
    order = np.argsort(-values)
    modes = vectors[:, order] * np.sqrt(np.maximum(values[order], 0.0))
    return modes / np.sqrt((modes**2).sum(axis=1).mean())
