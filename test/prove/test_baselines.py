"""Test of prove/baselines.py on a residual made by hand."""

import numpy as np
import pytest

from arm_brachy.diagnosis.selection.judge import Explanation, Problem
from arm_brachy.prove.baselines import answers, gaussian_process, lasso, projected

N = 300


def problem(amount, seed=3):
    """Thirty causes of random shape, of which number 4 is in the residual; a strong nuisance."""
    rng = np.random.default_rng(seed)
    shapes = rng.normal(size=(30, N, 2)) / np.sqrt(N)
    nuisances = rng.normal(size=(N, 3))
    noise = rng.normal(size=N)
    explanations = tuple(Explanation(f'cause_{i}', '', 10.0 * shape)
                         for i, shape in enumerate(shapes))
    r = noise + 2.0 * nuisances[:, 0] + amount * shapes[4, :, 0]
    return Problem(r, nuisances, np.zeros(N), np.zeros((N, 1)), explanations, np.zeros(N, int))


def test_a_strong_effect_is_found_by_those_that_look():
    said = answers(problem(30.0))
    assert said['LASSO'] == 'cause_4'
    assert said['nearest cosine'] == 'cause_4'
    assert said['recalibrate only'] == said['Gaussian process'] == ''
    assert said['always the modulus'] == 'stiffness_scale'


def test_noise_alone_is_no_cosine():
    """One null in a hundred is longer than noise should be; of ten, none or one."""
    named = [answers(problem(0.0, seed))['nearest cosine'] for seed in range(10)]
    assert sum(bool(name) for name in named) <= 1


def test_nuisances_are_taken_out_as_their_covariance_asks():
    one = problem(5.0)
    r, columns, _ = projected(one)
    inverse = np.linalg.inv(np.eye(N) + one.U @ one.U.T)
    assert r @ r == pytest.approx(one.r @ inverse @ one.r)
    first = one.explanations[0].columns
    np.testing.assert_allclose(columns[:, :2].T @ r, first.T @ inverse @ one.r, atol=1e-9)


def test_lasso_shrinks_orthogonal_columns_by_its_weight():
    X = np.eye(6)[:, :4]
    r = np.array([5.0, -3.0, 0.5, 1.5, 7.0, 0.0])
    np.testing.assert_allclose(lasso(X, r, 1.0), [4.0, -2.0, 0.0, 0.5])


def test_lasso_meets_its_optimality_conditions():
    rng = np.random.default_rng(1)
    X = rng.normal(size=(50, 20))
    X /= np.linalg.norm(X, axis=0)
    r = rng.normal(size=50) * 3.0
    b = lasso(X, r, 1.2)
    pull = X.T @ (r - X @ b)
    assert 0 < np.count_nonzero(b) < 20
    np.testing.assert_allclose(pull[b != 0], 1.2 * np.sign(b[b != 0]), atol=1e-4)
    assert np.all(np.abs(pull[b == 0]) <= 1.2 + 1e-4)


def test_a_process_learns_a_smooth_field():
    """A quadratic of two travels from 60 noisy samples: better than they are themselves."""
    rng = np.random.default_rng(2)

    def field(q):
        return np.column_stack([q[:, 0]**2 - q[:, 1], q[:, 0] * q[:, 1]])
    q = rng.uniform(0.0, 5e-3, (60, 2)) * 1e3
    noise = 0.3
    seen = field(q) + noise * rng.normal(size=(60, 2))
    new = rng.uniform(0.5, 4.5, (40, 2))
    error = gaussian_process(q, seen - seen.mean(axis=0), new) + seen.mean(axis=0) - field(new)
    assert np.sqrt(np.mean(error**2)) < 0.7 * noise
