"""Anderson extrapolation against what is known of it on linear problems."""

import numba
import numpy as np
import pytest

from arm_brachy.tissue.anderson import CHUNK, Anderson

SHAPE = (3, 2)


def contraction(seed=0):
    """An affine map on 6 unknowns with eigenvalues up to 0.95, and its fixed point (3, 2)."""
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    A, b = Q @ np.diag(np.linspace(-0.4, 0.95, 6)) @ Q.T, rng.normal(size=6)
    fixed = np.linalg.solve(np.eye(6) - A, b).reshape(SHAPE)
    return (lambda s: (A @ s.ravel() + b).reshape(SHAPE)), fixed


def errors(depth, count, weight=(1.0, 1.0)):
    image_of, fixed = contraction()
    s, out, found = np.zeros(SHAPE), np.empty(SHAPE), []
    anderson = Anderson(SHAPE, depth)
    anderson.restart(np.array(weight))
    for _ in range(count):
        image = image_of(s)
        anderson.propose(image, image - s, out)
        s = out.copy()
        found.append(np.abs(s - fixed).max())
    return np.array(found)


@pytest.mark.parametrize('weight', [(1.0, 1.0), (0.2, 5.0)])
def test_solves_a_linear_problem_in_as_many_steps_as_unknowns(weight):
    """Walker & Ni 2011, theorem 2.2: as GMRES, whatever the norm."""
    found = errors(6, 8, weight)
    assert found[4] > 1e-3
    assert found[7] < 1e-6


def test_depth_zero_is_the_plain_iteration():
    image_of, fixed = contraction()
    s = np.zeros(SHAPE)
    for _ in range(8):
        s = image_of(s)
    assert errors(0, 8)[-1] == np.abs(s - fixed).max()


def test_short_memory_still_accelerates():
    assert errors(3, 40)[-1] < 1e-3 * errors(0, 40)[-1]


def test_first_proposal_and_fixed_point_are_the_image():
    anderson, out = Anderson(SHAPE, 4), np.empty(SHAPE)
    image = np.arange(6.0).reshape(SHAPE)
    assert not anderson.propose(image, np.ones(SHAPE), out)
    assert np.array_equal(out, image)
    assert not anderson.propose(image, np.ones(SHAPE), out)  # nothing changed
    assert np.array_equal(out, image)


def test_restart_forgets():
    rng = np.random.default_rng(3)
    anderson, out = Anderson(SHAPE, 4), np.empty(SHAPE)
    for _ in range(6):
        anderson.propose(*rng.normal(size=(2, *SHAPE)), out)
    fresh, expected = Anderson(SHAPE, 4), np.empty(SHAPE)
    anderson.restart()
    for pair in rng.normal(size=(5, 2, *SHAPE)):
        anderson.propose(*pair, out)
        fresh.propose(*pair, expected)
    assert np.array_equal(out, expected)


def test_same_bits_for_any_number_of_threads():
    shape, results = (9, 3 * CHUNK + 7), []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        rng, anderson, out = np.random.default_rng(5), Anderson(shape, 4), np.empty(shape)
        for _ in range(7):
            anderson.propose(*rng.normal(size=(2, *shape)), out)
        results.append(out)
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    assert np.array_equal(*results)
