"""The direct solver: right, repeatable, clear about what it cannot factorise."""

import gc

import numpy as np
import psutil
import pytest

from arm_brachy.tissue.linear_solver import FactorisationFailed, Pardiso


def upper(matrix):
    """Full upper-triangle pattern and values of a dense symmetric matrix."""
    n = len(matrix)
    rows, cols = np.triu_indices(n)
    return np.searchsorted(rows, np.arange(n + 1)), cols, matrix[rows, cols]


def random_spd(n=30):
    A = np.random.default_rng(0).normal(size=(n, n))
    return A @ A.T + np.eye(n)


@pytest.mark.parametrize('shift', [0.0, -20.0])
def test_agrees_with_dense_algebra_and_repeats_its_bits(shift):
    A = random_spd() + shift * np.eye(30)
    indptr, indices, data = upper(A)
    b = np.random.default_rng(1).normal(size=(30, 4))
    answers = []
    for _ in range(2):
        solver = Pardiso(indptr, indices, positive_definite=shift == 0.0)
        solver.factor(data)
        answers.append(solver.solve(b))
    np.testing.assert_allclose(answers[0], np.linalg.solve(A, b), rtol=1e-9, atol=1e-11)
    assert np.array_equal(*answers)
    np.testing.assert_allclose(solver.solve(b[:, 1]), answers[0][:, 1], rtol=1e-10)
    if shift:
        assert solver.negative_eigenvalues == np.sum(np.linalg.eigvalsh(A) < 0.0)


def test_new_values_on_the_same_pattern():
    A = random_spd()
    indptr, indices, data = upper(A)
    solver = Pardiso(indptr, indices)
    for scale in (1.0, 4.0):
        solver.factor(scale * data)
        np.testing.assert_allclose(solver.solve(scale * A.sum(axis=1)), 1.0, rtol=1e-9)


def test_no_unknowns_is_no_trouble():
    solver = Pardiso(np.zeros(1, dtype=int), np.zeros(0, dtype=int))
    solver.factor(np.zeros(0))
    assert solver.solve(np.zeros(0)).shape == (0,)


def test_memory_is_given_back():
    n = 400
    indptr, indices, data = upper(random_spd(n))
    process, used = psutil.Process(), []
    for more in (10, 50):
        for _ in range(more):
            Pardiso(indptr, indices).factor(data)
        gc.collect()
        used.append(process.memory_info().rss)
    assert used[1] - used[0] < 10 * 8 * n * n  # fifty lost factors would be far more


def test_solver_names_its_failures():
    indptr, indices = np.array([0, 2, 3]), np.array([0, 1, 1])
    solver = Pardiso(indptr, indices)
    with pytest.raises(FactorisationFailed, match='call factor first'):
        solver.solve(np.ones(2))
    with pytest.raises(FactorisationFailed, match='not positive definite'):
        solver.factor(np.array([1.0, 2.0, 1.0]))
    solver.factor(np.array([2.0, 1.0, 2.0]))  # and is usable afterwards
    np.testing.assert_allclose(solver.solve(np.array([3.0, 3.0])), [1.0, 1.0])
    with pytest.raises(ValueError, match='must be 2'):
        solver.solve(np.ones(3))
    with pytest.raises(ValueError, match='diagonal'):
        Pardiso(np.array([0, 1, 2]), np.array([1, 1]))


def test_inertia_of_an_indefinite_matrix():
    solver = Pardiso(np.array([0, 2, 3]), np.array([0, 1, 1]), positive_definite=False)
    solver.factor(np.array([1.0, 2.0, 1.0]))
    assert solver.negative_eigenvalues == 1
