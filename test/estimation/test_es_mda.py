"""The smoother against another implementation and against the closed form."""

import warnings

import covmats
import numpy as np
import pyesmda
import pytest

from arm_brachy.core.errors import InputError, NotConverged
from arm_brachy.core.random import stream
from arm_brachy.estimation.es_mda import (
    EsMdaOptions,
    RankDeficient,
    correlation_taper,
    equal_alphas,
    es_mda,
    falling_alphas,
)


class GaussLinear:
    """Prior N(0, I), y = H z + e, e ~ N(0, R) with R full."""

    def __init__(self, nz=26, nd=45, spread=0.3):
        rng = stream(1, 'gauss')
        self.H = rng.standard_normal((nd, nz)) / np.sqrt(nz)
        root = spread * (np.eye(nd) + 0.1 * rng.standard_normal((nd, nd)))
        self.R = root @ root.T
        self.z = rng.standard_normal(nz)
        self.d = self.H @ self.z + root @ rng.standard_normal(nd)
        self.gain = self.H.T @ np.linalg.inv(self.H @ self.H.T + self.R)
        self.mean = self.gain @ self.d
        self.covariance = np.eye(nz) - self.gain @ self.H

    def forward(self, z):
        return z @ self.H.T

    def run(self, members, assimilations=5, seed=0, **options):
        rng = stream(seed, 'members')
        z = rng.standard_normal((members, len(self.z)))
        return es_mda(z, self.forward, self.d, self.R, rng,
                      alphas=equal_alphas(assimilations), **options)


class Neighbours(GaussLinear):
    """Each number measured is that of one unknown and a little of the next."""

    def __init__(self, nz=26):
        self.H = np.eye(nz) + 0.3 * np.eye(nz, k=1)
        self.R = 0.1 * np.eye(nz)
        self.z = np.ones(nz)
        self.d = self.H @ self.z
        self.mean = self.H.T @ np.linalg.solve(self.H @ self.H.T + self.R, self.d)


class Bent(GaussLinear):
    """The same, measured through a map that is not linear."""

    def forward(self, z):
        y = z @ self.H.T
        return y + 0.2 * y ** 2


class Disturbed(pyesmda.ESMDA):
    """pyesmda with given perturbations in place of its own."""

    __slots__ = ['given', 'root']

    def _pertrub(self, inflation_factor):
        e = self.given[self._assimilation_step]
        self.d_obs_uc = self.obs[:, None] + np.sqrt(inflation_factor) * (e @ self.root.T).T


@pytest.mark.parametrize('alphas', [equal_alphas(4), falling_alphas(4)])
@pytest.mark.parametrize('case', [GaussLinear, Bent])
def test_equals_pyesmda_with_the_same_perturbations(case, alphas):
    case = case(nz=7, nd=12)
    rng = stream(3, 'members')
    z, e = rng.standard_normal((40, 7)), rng.standard_normal((4, 40, 12))
    root = np.linalg.cholesky(case.R)
    theirs = Disturbed(case.d, z.T.copy(), covmats.CovViaCholesky(root),
                       lambda m: case.forward(m.T).T, n_assimilations=4,
                       cov_obs_inflation_factors=alphas, inversion_type='naive')
    theirs.given, theirs.root = e, root
    theirs.solve()
    ours = es_mda(z, case.forward, case.d, case.R, None, alphas=alphas, perturbations=e)
    assert np.abs(ours.z - theirs.m_posterior.T).max() < 1e-8
    assert np.abs(ours.mean - z.mean(axis=0)).max() > 0.1


def test_many_members_have_mean_and_covariance_of_the_closed_form():
    case = GaussLinear(nz=4, nd=6)
    errors = []
    for members in (1000, 16000):
        found = case.run(members)
        errors.append([np.abs(found.mean - case.mean).max(),
                       np.abs(found.covariance - case.covariance).max()])
    assert np.all(np.array(errors[1]) < 0.02)
    assert np.all(np.array(errors[1]) < np.array(errors[0]))


def spread(case, inflation):
    """Root of the mean variance of the members, over the exact one, mean of 20 ensembles."""
    found = [np.trace(case.run(100, seed=k, inflation=inflation).covariance) for k in range(20)]
    return np.sqrt(np.mean(found) / np.trace(case.covariance))


def test_inflation_gives_the_lost_spread_back():
    case = GaussLinear()
    assert spread(case, 1.0) < 0.92
    assert spread(case, EsMdaOptions().inflation) == pytest.approx(1.0, abs=0.06)


def test_too_few_members_are_announced_and_stay_in_their_plane():
    case = GaussLinear()
    with pytest.warns(RankDeficient, match='10 members span 9 of 26 directions'):
        found = case.run(10)
    assert found.deficient and found.rank == 9
    rng = stream(0, 'members')
    z = rng.standard_normal((10, 26))
    plane = np.linalg.svd(z - z.mean(axis=0))[2][:9]
    moved = found.z - z.mean(axis=0)
    assert np.abs(moved - moved @ plane.T @ plane).max() < 1e-9
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert not case.run(100).deficient


def test_localisation_brings_few_members_closer_to_the_closed_form():
    """Where a measured number depends on one or two unknowns; a full H leaves little to gain."""
    case = Neighbours()

    def error(**options):
        runs = [case.run(30, seed=k, **options) for k in range(30)]
        return np.sqrt(np.mean([(r.mean - case.mean) ** 2 for r in runs]))

    assert error(localised=True) < 0.9 * error()


def test_taper_keeps_what_many_members_know_and_drops_chance():
    z = stream(5, 'z').standard_normal((1000, 60))
    taper = correlation_taper(z, z[:, :1] + 1e-3)
    assert taper[0, 0] > 0.99
    # chance alone: 1000 r^2 is chi-squared, of which c / (c + 1) is 0.34 in the mean
    assert taper[1:, 0].mean() == pytest.approx(0.34, abs=0.12)
    assert np.all(correlation_taper(z, np.ones((1000, 1))) == 0.0)


@pytest.mark.parametrize('change, words', [
    ({'alphas': (5.0,) * 4}, 'sum of 1 / alpha = 0.8; must be 1'),
    ({'noise': np.ones(3)}, r'noise \(3,\); must be'),
    ({'noise': np.zeros(6)}, 'not positive definite'),
    ({'z': np.zeros(4)}, r'members \(4,\); must be'),
    ({'perturbations': np.zeros((5, 9, 9))}, 'perturbations'),
])
def test_refuses_what_does_not_fit(change, words):
    case = GaussLinear(nz=4, nd=6)
    given = {'z': np.eye(6, 4), 'noise': np.ones(6)} | change
    with pytest.raises(InputError, match=words):
        es_mda(given.pop('z'), case.forward, case.d, given.pop('noise'), stream(0, 'e'), **given)


def test_a_forward_map_that_is_not_finite_is_not_passed_on():
    with pytest.raises(NotConverged, match='not finite'):
        es_mda(np.eye(6, 4), lambda z: np.full((6, 6), np.nan), np.zeros(6), np.ones(6),
               stream(0, 'e'))
