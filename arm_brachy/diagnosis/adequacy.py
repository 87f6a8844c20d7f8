"""Is anything left? Structured tests of a whitened residual, all at once.

A sum of squares over everything drowns a small systematic part in the noise of all channels. Here
every channel is correlated with what a missed effect would follow (depth, its square, direction,
speed, time, a constant), nuisances and the accepted cause projected out; the largest of these
correlations is judged against its own distribution under the model, correlations between the tests
included.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.stats import norm

DRAWS = 5_000      # of the largest |z| under the model: its 0.1 % point to a half
RANK = 1e-6        # of the largest eigenvalue of the tests' covariance: below, they repeat others
ALIVE = 0.02       # of its length: what the model leaves of a column for it to be a test


@dataclass(frozen=True)
class Scan:
    """Structured tests of one residual.

    z : (m,) each standard normal if the model is right;  worst : index of the largest |z|
    chance : probability that noise alone makes some |z| as large
    """

    z: np.ndarray
    worst: int
    chance: float


def scan(U, r, columns, rng, *, draws=DRAWS):
    """Return the Scan of a residual.

    U : (n, k) all that the model allows, as in `inference`;  r : (n,) whitened residual
    columns : (n, m) what to look for; a column that the model explains wholly gets z = 0
    rng : numpy.random.Generator for the distribution of the largest |z|
    Score tests: with C = I + U U', z_j = x_j' C^-1 r / sqrt(x_j' C^-1 x_j) (Rao 1948, Proc Camb
    Philos Soc 44:50); jointly normal with the correlations of the x_j in C^-1.
    """
    factor = cholesky(np.eye(U.shape[1]) + U.T @ U, lower=True)
    told = r - U @ cho_solve((factor, True), U.T @ r)
    length = np.sqrt(np.sum(columns**2, axis=0))
    # single precision: three digits of a correlation are plenty, and it is the bulk of the work
    unit = (columns / np.where(length > 0.0, length, 1.0)).astype(np.float32)
    seen = solve_triangular(factor.astype(np.float32), U.astype(np.float32).T @ unit, lower=True)
    covariance = unit.T @ unit - seen.T @ seen
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0)).astype(float)
    kept = np.flatnonzero(size > ALIVE)
    z = np.zeros(len(size))
    z[kept] = (unit.T @ told)[kept] / size[kept]
    worst = int(np.argmax(np.abs(z)))
    correlation = covariance[np.ix_(kept, kept)] / np.outer(size[kept], size[kept])
    return Scan(z, worst, _chance(np.abs(z[worst]), correlation, rng, draws))


def _chance(largest, correlation, rng, draws):
    """Share of draws of normals with this correlation in which some |z| reaches `largest`.

    Where the sum of all their chances (Bonferroni) is below what draws resolve, that sum.
    """
    if not len(correlation):
        return 1.0
    bound = 2.0 * float(norm.sf(largest)) * len(correlation)
    if bound < 1.0 / draws:
        return bound
    power, shape = np.linalg.eigh(correlation.astype(np.float32))
    kept = power > RANK * power[-1]
    root = (shape[:, kept] * np.sqrt(power[kept])).T
    reached, block = 0, 1000
    for start in range(0, draws, block):
        count = min(block, draws - start)
        drawn = rng.standard_normal((count, len(root)), dtype=np.float32) @ root
        reached += int(np.sum(np.abs(drawn).max(axis=1) >= largest))
    return (reached + 1) / (draws + 1)
