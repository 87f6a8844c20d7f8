"""Mixtures of Gaussians: each component by the batch formula, weights by Bayes' rule."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from arm_brachy.core.errors import NotConverged
from arm_brachy.estimation.gaussian import condition
from arm_brachy.estimation.mixture import Mixture

RNG = np.random.default_rng(0)
S, M = 7, 4
H = RNG.normal(size=(M, S))
NOISE = np.array([0.1, 0.2, 0.3, 0.4])
Z = RNG.normal(size=M)
SCALE = np.array([np.ones(S), np.linspace(0.1, 3.0, S)])
B = RNG.normal(size=(3, S))


def conditioned(mixture, trust=1.0, z=Z):
    return mixture.measured(H).conditioned(z, NOISE, trust)


def test_every_component_is_the_closed_form_update():
    found = conditioned(Mixture.prior(SCALE))
    for scale, mean, known in zip(SCALE, found.mean, found.known, strict=True):
        one = condition(np.zeros(S), np.diag(scale**2), Z, H, np.diag(NOISE))
        np.testing.assert_allclose(mean, one.mean, rtol=1e-10)
        np.testing.assert_allclose(np.diag(scale**2) - known @ known.T, one.covariance, atol=1e-12)


def test_weights_are_those_of_bayes_rule():
    found = conditioned(Mixture.prior(SCALE))
    density = np.array([multivariate_normal(np.zeros(M), (H * s**2) @ H.T + np.diag(NOISE)).pdf(Z)
                        for s in SCALE])
    np.testing.assert_allclose(found.weights, density / density.sum(), rtol=1e-9)
    blunt = conditioned(Mixture.prior(SCALE), trust=0.5)
    np.testing.assert_allclose(blunt.weights, density**0.5 / (density**0.5).sum(), rtol=1e-9)


def test_mean_and_covariance_are_those_of_the_mixture():
    """Against draws: pick a component by its weight, then a state from it."""
    found = conditioned(Mixture.prior(SCALE))
    rng, parts = np.random.default_rng(1), []
    for weight, scale, mean, known in zip(found.weights, SCALE, found.mean, found.known,
                                          strict=True):
        parts.append(rng.multivariate_normal(mean, np.diag(scale**2) - known @ known.T,
                                             round(2e5 * weight)) @ B.T)
    drawn = np.vstack(parts)
    np.testing.assert_allclose(B @ found.average(), drawn.mean(axis=0), atol=0.03)
    np.testing.assert_allclose(found.covariance(B), np.cov(drawn.T), atol=0.15)


def test_two_measurements_after_each_other_are_one_of_both():
    twice = conditioned(conditioned(Mixture.prior(SCALE)), z=-Z)
    wide = Mixture.prior(SCALE).measured(np.vstack([H, H])).conditioned(
        np.concatenate([Z, -Z]), np.tile(NOISE, 2), 1.0)
    np.testing.assert_allclose(twice.mean, wide.mean, atol=1e-10)
    np.testing.assert_allclose(twice.covariance(B), wide.covariance(B), atol=1e-10)
    np.testing.assert_allclose(twice.weights, wide.weights, rtol=1e-8)


def test_forgetting_leads_back_to_the_prior():
    found, prior = conditioned(Mixture.prior(SCALE)), Mixture.prior(SCALE)
    half = found.forgotten(0.5)
    np.testing.assert_allclose(half.mean, 0.5 * found.mean)
    inner = half.scale[:, :, None]**2 * np.eye(S) - half.known @ np.swapaxes(half.known, 1, 2)
    was = found.scale[:, :, None]**2 * np.eye(S) - found.known @ np.swapaxes(found.known, 1, 2)
    np.testing.assert_allclose(inner, 0.25 * was + 0.75 * SCALE[:, :, None]**2 * np.eye(S))
    gone = found.forgotten(0.0)
    np.testing.assert_allclose(gone.covariance(B), prior.covariance(B))
    np.testing.assert_allclose(gone.weights, prior.weights)


def test_many_measurements_keep_the_state_small():
    mixture = Mixture.prior(SCALE)
    for _ in range(5):
        mixture = conditioned(mixture)
    assert mixture.known.shape == (2, S, S)


def test_no_noise_at_all_is_refused():
    with pytest.raises(NotConverged, match='not positive'):
        Mixture.prior(np.zeros((1, S))).measured(H).conditioned(Z, np.zeros(M), 1.0)
