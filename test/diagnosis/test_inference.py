"""Evidence, held-out prediction and separation against dense Gaussian algebra and simulation."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from arm_brachy.diagnosis.statistics.linear_gaussian import (
    detectability,
    log_density,
    posterior,
    separation,
)

N, K = 40, 5


def predictive(U, r, held_out):
    """Return log p(r of the rows held out, given the others).

    held_out : (n,) True for the rows to be predicted. The difference of two joint densities.
    """
    return log_density(U, r) - log_density(U[~held_out], r[~held_out])


def held_out_score(U, r, kinds):
    """Return the sum over kinds of `predictive`: (total, {kind: log density}).

    kinds : (n,) labels, whole kinds of experiment (a pad, a speed, an amplitude), never single
        samples: neighbours in time predict each other under any model
    """
    each = {kind: predictive(U, r, kinds == kind) for kind in np.unique(kinds)}
    return float(sum(each.values())), each


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def drawn(rng, U):
    return U @ rng.normal(size=U.shape[1]) + rng.normal(size=len(U))


def test_density_is_that_of_the_dense_covariance(rng):
    U = rng.normal(size=(N, K))
    r = drawn(rng, U)
    dense = multivariate_normal(np.zeros(N), np.eye(N) + U @ U.T).logpdf(r)
    assert log_density(U, r) == pytest.approx(dense, rel=1e-12)


def test_prediction_is_the_conditional_of_the_dense_covariance(rng):
    U = rng.normal(size=(N, K))
    r, out = drawn(rng, U), np.arange(N) % 3 == 0
    C = np.eye(N) + U @ U.T
    gain = C[np.ix_(out, ~out)] @ np.linalg.inv(C[np.ix_(~out, ~out)])
    mean, spread = gain @ r[~out], C[np.ix_(out, out)] - gain @ C[np.ix_(~out, out)]
    dense = multivariate_normal(mean, 0.5 * (spread + spread.T)).logpdf(r[out])
    assert predictive(U, r, out) == pytest.approx(dense, rel=1e-9)


def test_posterior_covers_the_truth_as_often_as_it_says(rng):
    """400 draws: the share inside 90 % intervals is within 3 sd of a binomial, 0.045."""
    U = rng.normal(size=(N, 1)) * 0.3
    inside = 0
    for _ in range(400):
        z = rng.normal()
        fit = posterior(U, U[:, 0] * z + rng.normal(size=N))
        inside += abs(fit.mean[0] - z) < 1.645 * np.sqrt(fit.covariance()[0, 0])
    assert inside / 400 == pytest.approx(0.9, abs=0.045)


def test_the_cause_predicts_other_kinds_and_a_look_alike_of_one_kind_does_not(rng):
    """Two causes alike in kind 0, different in kind 1: only the true one carries over."""
    kinds = np.repeat([0, 1], N)
    first, other = rng.normal(size=N), rng.normal(size=(2, N))
    true, rival = np.concatenate([first, other[0]]), np.concatenate([first, other[1]])
    r = 3.0 * true + rng.normal(size=2 * N)
    scores = {name: held_out_score(3.0 * column[:, None], r, kinds)[0]
              for name, column in (('true', true), ('rival', rival))}
    nothing = held_out_score(np.zeros((2 * N, 0)), r, kinds)[0]
    assert scores['true'] > nothing + 50.0
    assert scores['rival'] < nothing


def test_without_an_effect_more_columns_cost_evidence(rng):
    """Occam's factor: the mean log ratio under the null is -log det / 2 + trace share, below 0."""
    U = 3.0 * rng.normal(size=(N, 1))
    gains = [log_density(U, r) - log_density(U[:, :0], r)
             for r in rng.normal(size=(200, N))]
    assert np.mean(gains) < -1.5
    assert np.mean(np.array(gains) > 3.0) < 0.05  # e^-3 by Markov's inequality


def test_separation_is_what_the_best_fitted_rival_leaves(rng):
    """By generalised least squares with the dense covariance."""
    U, effect, rival = rng.normal(size=(N, K)), rng.normal(size=N), rng.normal(size=(N, 2))
    weight = np.linalg.cholesky(np.linalg.inv(np.eye(N) + U @ U.T)).T
    best = np.linalg.lstsq(weight @ rival, weight @ effect, rcond=None)[0]
    left = np.linalg.norm(weight @ (effect - rival @ best))
    C = np.linalg.inv(np.eye(N) + U @ U.T)

    def apart(e):
        return separation(e @ C @ e, rival.T @ C @ e, rival.T @ C @ rival)

    assert apart(effect) == pytest.approx(left, rel=1e-9)
    assert apart(rival @ [1.0, -2.0]) == pytest.approx(0.0, abs=1e-6)
    sizes = detectability(U, np.stack([effect, 2.0 * effect], axis=1))
    assert sizes == pytest.approx(np.linalg.norm(weight @ effect) * np.array([1, 2]), rel=1e-9)
