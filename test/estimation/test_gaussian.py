"""The closed-form update against the batch formula, and against what it must keep."""

import numpy as np
import pytest

from arm_brachy.core.errors import NotConverged
from arm_brachy.estimation.gaussian import condition, registration_jacobian


def case(rng, k=7, m=12):
    root, noise = rng.normal(size=(k, k)), rng.normal(size=(m, m))
    return (rng.normal(size=k), root @ root.T + np.eye(k), rng.normal(size=m),
            rng.normal(size=(m, k)), noise @ noise.T + np.eye(m))


def test_equals_the_batch_formula():
    mean, P, residual, H, R = case(np.random.default_rng(1))
    found = condition(mean, P, residual, H, R)
    # Information form, one weighted least-squares problem: no gain, no innovation covariance.
    information = np.linalg.inv(P) + H.T @ np.linalg.solve(R, H)
    batch = mean + np.linalg.solve(information, H.T @ np.linalg.solve(R, residual))
    np.testing.assert_allclose(found.mean, batch, atol=1e-10)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(information), atol=1e-10)


def test_two_measurements_one_after_the_other_equal_both_at_once():
    mean, P, residual, H, _ = case(np.random.default_rng(2))
    R = np.diag(np.linspace(0.1, 1.0, len(H)))
    both = condition(mean, P, residual, H, R)
    first = condition(mean, P, residual[:5], H[:5], R[:5, :5])
    left = residual[5:] - H[5:] @ (first.mean - mean)
    second = condition(first.mean, first.covariance, left, H[5:], R[5:, 5:])
    np.testing.assert_allclose(second.mean, both.mean, atol=1e-10)
    np.testing.assert_allclose(second.covariance, both.covariance, atol=1e-10)


def test_a_covariance_that_is_none_is_refused_with_its_eigenvalue():
    mean, P, residual, H, R = case(np.random.default_rng(3))
    with pytest.raises(NotConverged, match='eigenvalue -'):
        condition(mean, P, residual, H, R - 1e3 * np.eye(len(R)))


def test_registration_jacobian_is_the_derivative_of_a_rigid_motion():
    points, small = np.random.default_rng(4).normal(size=(5, 3)), 1e-6
    J = registration_jacobian(points)
    centre = points.mean(axis=0)
    for axis in range(3):
        turn = small * np.eye(3)[axis]
        moved = points + np.cross(turn, points - centre)
        np.testing.assert_allclose(J[:, axis], (moved - points).ravel() / small, atol=1e-9)
        np.testing.assert_array_equal(J[:, 3 + axis].reshape(-1, 3), np.tile(np.eye(3)[axis],
                                                                            (5, 1)))
