"""Ensemble smoother with multiple data assimilation: one measurement, taken in several times.

z_i <- z_i + C_zy (C_yy + a_n C_d)^-1 (d + sqrt(a_n) C_d^(1/2) e_i - y_i),  y_i = G(z_i)   (5.5)
with C_zy and C_yy the covariances of the members, divided by Ne - 1 (5.6), and sum 1 / a_n = 1,
for which the mean and covariance of a linear G and a Gaussian prior tend to the exact ones with
the number of members (Emerick & Reynolds 2013, Comput Geosci 17:325).

An ensemble of Ne members spans Ne - 1 directions at most. With the thesis' Ne = 10 and 26 latent
variables the update cannot leave a plane of 9: the poor first curve of its figure 5.7. That is a
warning here, `RankDeficient`.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from arm_brachy.core.errors import InputError, NotConverged
from arm_brachy.core.quantity import quantity


class RankDeficient(UserWarning):
    """The members span fewer directions than there are unknowns: the rest stays unmeasured."""


@dataclass(frozen=True)
class EsMdaOptions:
    """How the smoother is run."""

    members: int = 100
    assimilations: int = 5
    inflation: float = quantity(
        1.03, '', 'factor on the spread of the members after each assimilation', low=1.0,
        high=2.0, source='a Gaussian case with 26 unknowns and 100 members: without it the spread '
                         'ends at 0.87 of the exact one (1.03^5 = 1.16); '
                         'test_es_mda.py::test_inflation_gives_the_lost_spread_back')
    localised: bool = False     # taper the covariances that so few members cannot know


@dataclass(frozen=True)
class Smoothed:
    """What the smoother came to.

    z : (Ne, nz) members;  means : (Na + 1, nz) of the members before and after each assimilation
    rank : directions that the members spanned at the start, at most min(Ne - 1, nz)
    """

    z: np.ndarray
    means: np.ndarray
    rank: int

    @property
    def mean(self):
        """(nz,) the estimate."""
        return self.z.mean(axis=0)

    @property
    def covariance(self):
        """(nz, nz) of the members."""
        return np.cov(self.z.T).reshape(self.z.shape[1], self.z.shape[1])

    @property
    def deficient(self):
        """True if the members could not reach all of the space of z."""
        return self.rank < self.z.shape[1]


def es_mda(z, forward, observed, noise, rng, *, alphas=(5.0,) * 5, inflation=1.0, localised=False,
           perturbations=None):
    """Condition members on a measurement (5.5), (5.6).

    z : (Ne, nz) members of the prior, untouched
    forward : G, (Ne, nz) -> (Ne, nd) what each member would measure
    observed : (nd,);  noise : (nd,) variances or (nd, nd) covariance of the measurement
    alphas : (Na,) factors on the noise, sum of 1 / alpha = 1; the thesis lets them fall
    inflation : factor on the members' distance from their mean after each assimilation
    localised : multiply C_zy by `correlation_taper`
    perturbations : (Na, Ne, nd) standard normal numbers to use; None = drawn from `rng`
    Returns Smoothed; warns RankDeficient where Ne - 1 or the members' rank is below nz.
    Raises InputError for shapes or alphas that do not fit, NotConverged if G gives numbers that
    are not finite or C_yy + a C_d is not positive definite. Exact in the limit of many members
    for a linear G and a Gaussian prior only.
    Test: estimation/test_es_mda.py (pyesmda with the same perturbations; closed form)
    """
    z, root = _checked(z, observed, noise, alphas)
    shape = (len(alphas), len(z), len(observed))
    e = rng.standard_normal(shape) if perturbations is None else np.asarray(perturbations)
    if e.shape != shape:
        raise InputError(f'es_mda: perturbations {e.shape}; must be {shape}')
    rank = int(np.linalg.matrix_rank(z - z.mean(axis=0)))
    if rank < z.shape[1]:
        warnings.warn(f'es_mda: {len(z)} members span {rank} of {z.shape[1]} directions; take '
                      f'more than {z.shape[1]} members', RankDeficient, stacklevel=2)
    means = [z.mean(axis=0)]
    for alpha, now in zip(alphas, e, strict=True):
        y = np.asarray(forward(z), dtype=float)
        if not np.isfinite(y).all():
            raise NotConverged('es_mda: the forward map gave numbers that are not finite')
        z = z + _update(z, y, observed + np.sqrt(alpha) * now @ root.T, alpha * root @ root.T,
                        localised)
        z = z.mean(axis=0) + inflation * (z - z.mean(axis=0))
        means.append(z.mean(axis=0))
    return Smoothed(z, np.array(means), rank)


def equal_alphas(count):
    """(Na,) equal factors, each Na."""
    return (float(count),) * count


def falling_alphas(count, ratio=2.0):
    """(Na,) factors of which each is `ratio` times smaller than the last, sum of 1 / alpha = 1.

    What the thesis asks for in words (sec. 5.3.2) without naming numbers.
    """
    shares = ratio ** np.arange(count)
    return tuple(shares.sum() / shares)


def correlation_taper(z, y):
    """(nz, nd) factor in [0, 1] by which a covariance of so few members is to be believed.

    r^2 / (r^2 + (1 + r^2) / Ne) with r their correlation: the factor that minimises the expected
    error of the product (Furrer & Bengtsson 2007, J Multivar Anal 98:227, eq. 29). Needs no
    distances, which latent variables do not have.
    """
    dz, dy = z - z.mean(axis=0), y - y.mean(axis=0)
    size = np.outer(np.linalg.norm(dz, axis=0), np.linalg.norm(dy, axis=0))
    square = np.divide(dz.T @ dy, size, out=np.zeros(size.shape), where=size > 0.0) ** 2
    return square / (square + (1.0 + square) / len(z))


def _update(z, y, disturbed, noise, localised):
    """What (5.5) adds to each member: (Ne, nz)."""
    dz, dy = z - z.mean(axis=0), y - y.mean(axis=0)
    C_zy, C_yy = dz.T @ dy / (len(z) - 1), dy.T @ dy / (len(z) - 1)
    if localised:
        C_zy = C_zy * correlation_taper(z, y)
    try:
        factor = cho_factor(C_yy + noise)
    except LinAlgError:
        raise NotConverged('es_mda: covariance of what is measured is not positive definite; '
                           'must be, give every measurement some noise') from None
    return cho_solve(factor, (disturbed - y).T).T @ C_zy.T


def _checked(z, observed, noise, alphas):
    """Members as floats and C_d^(1/2), the Cholesky factor (nd, nd)."""
    z, observed, noise = (np.asarray(a, dtype=float) for a in (z, observed, noise))
    if z.ndim != 2 or len(z) < 2:
        raise InputError(f'es_mda: members {z.shape}; must be (Ne, nz) with Ne at least 2')
    n = len(observed)
    if noise.shape not in ((n,), (n, n)):
        raise InputError(f'es_mda: noise {noise.shape}; must be ({n},) variances or ({n}, {n})')
    if not np.isclose(sum(1.0 / a for a in alphas), 1.0):
        raise InputError(f'es_mda: sum of 1 / alpha = {sum(1.0 / a for a in alphas):.6g}; must be '
                         '1, else the measurement is counted more or less than once')
    try:
        return z, np.linalg.cholesky(np.diag(noise) if noise.ndim == 1 else noise)
    except np.linalg.LinAlgError:
        raise InputError('es_mda: noise is not positive definite; must be') from None
