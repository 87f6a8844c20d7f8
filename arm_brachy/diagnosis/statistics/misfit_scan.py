"""Is anything left? Structured tests of a whitened residual, all at once.

A sum of squares over everything drowns a small systematic part in the noise of all channels. Here
every channel is correlated with what a missed effect would follow (depth, its square, direction,
speed, time, a constant), nuisances and the accepted cause projected out; the largest of these
correlations is judged against its own distribution under the model, correlations between the tests
included. An effect goes in any direction, seldom along an axis: tests that differ in that alone
are also judged together.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.stats import chi2, norm

DRAWS = 5_000      # of the largest |z| under the model: its 0.1 % point to a half
RANK = 1e-6        # of the largest eigenvalue of the tests' covariance: below, they repeat others
ALIVE = 0.02       # of its length: what the model leaves of a column for it to be a test


@dataclass(frozen=True)
class Scan:
    """Structured tests of one residual.

    z : (m,) each standard normal if the model is right
    worst : index of the test that stands out most; of tests that do together, of the largest |z|
    chance : probability that noise alone makes some test, or some together, stand out as much
    """

    z: np.ndarray
    worst: int
    chance: float


def scan(U, r, columns, rng, *, together=(), draws=DRAWS):
    """Return the Scan of a residual.

    U : (n, k) all that the model allows, as in `linear_gaussian`;  r : (n,) whitened residual
    columns : (n, m) what to look for; a column that the model explains wholly gets z = 0
    rng : numpy.random.Generator for the distribution of what stands out most
    together : indices of columns that are one effect in several directions, a sequence for each
    Score tests: with C = I + U U', z_j = x_j' C^-1 r / sqrt(x_j' C^-1 x_j) (Rao 1948, Proc Camb
    Philos Soc 44:50); jointly normal with the correlations R of the x_j in C^-1. Of d together
    z' R^-1 z is a chi-square of d degrees of freedom. The least chance of all stands out most.
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
    if not len(kept):
        return Scan(z, 0, 1.0)
    correlation = covariance[np.ix_(kept, kept)] / np.outer(size[kept], size[kept])
    largest, least, groups = _standing_out(z[kept], correlation, _among(kept, together))
    return Scan(z, int(kept[largest]), _chance(least, correlation, groups, rng, draws))


@dataclass(frozen=True)
class _Together:
    """Tests judged as one.

    members : (g, d) of g groups;  roots : (g, d, d) of which z' R^-1 z is the square of z times it
    """

    members: np.ndarray
    roots: np.ndarray

    def squares(self, z):
        """(s, g) chi-squares of normals z (s, m)."""
        return np.sum(np.square(np.einsum('sgd,gde->sge', z[:, self.members], self.roots)), axis=2)


def _among(kept, together):
    """Lists of positions in `kept` of groups of columns that still have two or more of them."""
    at = {int(column): i for i, column in enumerate(kept)}
    left = ([at[column] for column in group if column in at] for group in together)
    return [group for group in left if len(group) > 1]


def _standing_out(z, correlation, groups):
    """Position of the test that stands out most, the log chance of that, _Together by size."""
    best, least = int(np.argmax(np.abs(z))), np.log(2.0) + norm.logsf(np.abs(z).max())
    judged = []
    for size in sorted({len(group) for group in groups}):
        members = np.array([group for group in groups if len(group) == size])
        power, shape = np.linalg.eigh(
            correlation[members[:, :, None], members[:, None, :]].astype(float))
        apart = power[:, 0] > ALIVE**2 * power[:, -1]   # else one repeats the others
        one = _Together(members[apart], shape[apart] / np.sqrt(power[apart])[:, None, :])
        chances = chi2.logsf(one.squares(z[None])[0], size)
        judged.append(one)
        if len(chances) and chances.min() < least:
            least, group = chances.min(), members[apart][chances.argmin()]
            best = int(group[np.argmax(np.abs(z[group]))])
    return best, float(least), judged


def _chance(least, correlation, judged, rng, draws):
    """Share of draws of normals with this correlation in which some test stands out as much.

    least : log chance of the one that does;  judged : _Together
    Where the sum of all their chances (Bonferroni) is below what draws resolve, that sum.
    """
    bound = float(np.exp(least)) * (len(correlation) + sum(len(one.members) for one in judged))
    if bound < 1.0 / draws:
        return bound
    limit = norm.isf(0.5 * np.exp(least))
    limits = [chi2.isf(np.exp(least), one.members.shape[1]) for one in judged]
    power, shape = np.linalg.eigh(correlation.astype(np.float32))
    kept = power > RANK * power[-1]
    root = (shape[:, kept] * np.sqrt(power[kept])).T
    reached, block = 0, 1000
    for start in range(0, draws, block):
        count = min(block, draws - start)
        drawn = rng.standard_normal((count, len(root)), dtype=np.float32) @ root
        beyond = np.abs(drawn).max(axis=1) >= limit
        for one, most in zip(judged, limits, strict=True):
            beyond |= (one.squares(drawn) >= most).any(axis=1)
        reached += int(np.sum(beyond))
    return (reached + 1) / (draws + 1)
