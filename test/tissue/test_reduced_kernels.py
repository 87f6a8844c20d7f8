"""Sampled points: the loops against the readable material law, the cubature against NNLS."""

import numpy as np
import pytest
from scipy.optimize import nnls

from arm_brachy.core.errors import NotConverged
from arm_brachy.tissue import material
from arm_brachy.tissue import reduced_kernels as kernels


@pytest.fixture
def points():
    """Five points, three coordinates: F0, B, weights, mu, kappa, S."""
    rng = np.random.default_rng(2)
    S = rng.standard_normal((5, 3, 3))
    return (np.eye(3).ravel() + 0.1 * rng.standard_normal((5, 9)), rng.standard_normal((45, 3)),
            rng.uniform(1.0, 2.0, 5), rng.uniform(1.0, 2.0, 5), rng.uniform(5.0, 9.0, 5),
            S + S.swapaxes(1, 2))


def test_loops_equal_the_numpy_law(points):
    F0, B, weights, mu, kappa, S = points
    y, F, gradient = np.array([0.02, -0.03, 0.01]), np.empty((5, 9)), np.empty(3)
    kernels.deform(F0, np.ascontiguousarray(B.T), y, F)
    np.testing.assert_allclose(F, F0 + (B @ y).reshape(5, 9), rtol=1e-14)
    energy, min_J = kernels.potential(F, B, weights, mu, kappa, S, gradient)
    square = F.reshape(5, 3, 3)
    strain = 0.5 * (square.swapaxes(1, 2) @ square - np.eye(3))
    stored = material.energy(square, mu, kappa) + np.sum(S * strain, axis=(1, 2))
    P = kernels.point_stress(square, mu, kappa, S)
    assert energy == pytest.approx(weights @ stored, rel=1e-13)
    assert min_J == pytest.approx(np.linalg.det(square).min(), rel=1e-13)
    np.testing.assert_allclose(
        gradient, np.einsum('s,sk,skj->j', weights, P.reshape(5, 9), B.reshape(5, 9, 3)),
        rtol=1e-12)


def test_material_tangents_equal_the_numpy_law(points):
    F, _, _, mu, kappa, S = points
    found = kernels.material_tangents(F.reshape(5, 3, 3), mu, kappa, 0.0 * S)
    swap = np.arange(9).reshape(3, 3).T.ravel()  # row by row <- column by column
    for s in range(5):
        expected = material.tangent(F[s].reshape(3, 3), mu[s], kappa[s])[np.ix_(swap, swap)]
        np.testing.assert_allclose(found[s], expected, rtol=1e-11, atol=1e-11)


def test_inversion_is_an_infinite_energy(points):
    F0, B, weights, mu, kappa, S = points
    F0[2] *= -1.0
    energy, min_J = kernels.potential(F0, B, weights, mu, kappa, S, np.empty(3))
    assert energy == np.inf and min_J < 0.0


def test_cubature_run_to_the_end_is_the_non_negative_least_squares():
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((30, 12))
    total = columns @ np.maximum(rng.standard_normal(12), 0.0)
    points, factors = kernels.cubature(columns, total, 1e-6)
    expected = nnls(columns, total)[0]
    found = np.zeros(12)
    found[points] = factors
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert (factors > 0.0).all() and (np.diff(points) > 0).all()


@pytest.mark.parametrize('tolerance', [0.3, 0.1, 0.03])
def test_cubature_meets_its_tolerance_with_few_points(tolerance):
    rng = np.random.default_rng(6)
    smooth = np.cos(np.outer(np.arange(12), np.linspace(0.0, np.pi, 400)))
    columns = smooth * rng.uniform(0.5, 1.5, 400)
    total = columns.sum(axis=1)
    points, factors = kernels.cubature(columns, total, tolerance)
    assert np.linalg.norm(columns[:, points] @ factors - total) <= tolerance * np.linalg.norm(
        total)
    assert len(points) <= 13  # a vertex of the cone needs no more points than rows
    assert len(kernels.cubature(columns, total, 1e-6, max_points=3)[0]) == 3


def test_cubature_that_cannot_reach_its_tolerance_says_so():
    columns = np.eye(3)[:, :2]
    with pytest.raises(NotConverged, match='asked for 0.01'):
        kernels.cubature(columns, np.ones(3), 0.01)
