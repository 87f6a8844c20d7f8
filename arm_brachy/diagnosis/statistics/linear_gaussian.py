"""What explains a residual: linear-Gaussian evidence, prediction of what was held out, separation.

A residual r (n,), whitened by its noise, is modelled as

    r = U z + e,    z ~ N(0, I) (k,),    e ~ N(0, I) (n,),

the columns of U being everything that may be in it, each times its prior standard deviation:
nuisances (registration, zeros, modulus), errors of the mesh, and one hypothesis. A hypothesis is
thus nothing but more columns, and what it is worth is how much better the joint density of the
data becomes (evidence), or the density of recordings of one kind given all others (held out).
Costs go with n k^2. Source: Rasmussen & Williams 2006, Gaussian Processes for Machine Learning,
sec. 2.7 (explicit basis functions) and 5.4.2 (leave-out predictive probability).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, cho_solve, cholesky, solve_triangular
from scipy.stats import norm

TO_90 = float(norm.ppf(0.95))   # standard deviations to either end of a normal 90 % interval


@dataclass(frozen=True)
class Posterior:
    """What data say of the coefficients: z ~ N(mean, (L L')^-1).

    mean : (k,);  factor : L (k, k), lower triangular, of I + U'U
    """

    mean: np.ndarray
    factor: np.ndarray

    def covariance(self, columns=slice(None)):
        """Return the covariance (m, m) of the coefficients of some columns."""
        return cho_solve((self.factor, True), np.eye(len(self.mean)))[columns][:, columns]


def posterior(U, r):
    """Return the Posterior of the coefficients of U (n, k) given r (n,)."""
    factor = cholesky(np.eye(U.shape[1]) + U.T @ U, lower=True)
    return Posterior(cho_solve((factor, True), U.T @ r), factor)


class Beside:
    """Products with C^-1, C = I + U U', U (n, k): what is left beside all that may be there.

    By the matrix inversion lemma; the factor is made once.
    """

    def __init__(self, U):
        self._U = U
        self._factor = cholesky(np.eye(U.shape[1]) + U.T @ U, lower=True)

    def weighted(self, X):
        """Return C^-1 X (n, m) or (n,)."""
        return X - self._U @ cho_solve((self._factor, True), self._U.T @ X)

    def square(self, effect):
        """Return e' C^-1 e of an effect e (n,): its size beside everything else, squared."""
        return float(effect @ self.weighted(effect))

    @property
    def half_log_det(self):
        """Half the logarithm of the determinant of C."""
        return float(np.log(np.diag(self._factor)).sum())


def stacked(parts):
    """(N, k) nuisances of several recordings, those of single ones side by side, others as one.

    parts : each with its U (n, k') and own (k',), True for what the others do not share
    """
    own = block_diag(*(part.U[:, part.own] for part in parts))
    return np.hstack([own, np.vstack([part.U[:, ~part.own] for part in parts])])


def log_density(U, r):
    """Return log p(r), r (n,) ~ N(0, I + U U'), by the matrix inversion lemma.

    log det (I + U U') = log det (I + U'U);  r'(I + U U')^-1 r = r'r - |L^-1 U'r|^2.
    """
    factor = cholesky(np.eye(U.shape[1]) + U.T @ U, lower=True)
    explained = solve_triangular(factor, U.T @ r, lower=True)
    log_det = 2.0 * np.log(np.diag(factor)).sum()
    return -0.5 * (r @ r - explained @ explained + log_det + len(r) * np.log(2.0 * np.pi))


def evidence_over_none(B, a):
    """Return the log evidence of columns X (n, p) with coefficients ~ N(0, I) over none.

    a'(I + B)^-1 a / 2 - log det(I + B) / 2, B = X' C^-1 X (p, p), a = X' C^-1 r (p,)
    """
    factor = cholesky(np.eye(len(a)) + B, lower=True)
    half = solve_triangular(factor, a, lower=True)
    return 0.5 * float(half @ half) - float(np.log(np.diag(factor)).sum())


def separation(power, cross, own):
    """Return how far an effect is from the best that a rival can make of it [sd of noise].

    power : e' C^-1 e of the effect (n,) at its fitted size, C = I + U U' with all that is in both;
    cross : (m,) X' C^-1 e and own : (m, m) X' C^-1 X of the rival's responses X, free in size
    Zero: no analysis of these data can tell one from the other.
    """
    scale = np.sqrt(np.maximum(np.diag(own), 1e-300))
    taken = np.linalg.pinv(own / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    shared = (cross / scale) @ taken @ (cross / scale)
    return float(np.sqrt(max(power - shared, 0.0)))


def detectability(U, effects):
    """Return sizes (m,) of effects (n, m) beside everything else, U (n, k) [sd of noise]."""
    factor = cholesky(np.eye(U.shape[1]) + U.T @ U, lower=True)
    seen = solve_triangular(factor, U.T @ effects, lower=True)
    power = np.einsum('nm,nm->m', effects, effects) - np.einsum('km,km->m', seen, seen)
    return np.sqrt(np.maximum(power, 0.0))
