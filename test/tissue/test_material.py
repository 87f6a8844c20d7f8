"""The Neo-Hookean law against finite differences, invariance, and its compiled twin."""

import numpy as np
import pytest

from arm_brachy.tissue import material

MU, KAPPA = 2000.0, 60_000.0
EPS = 1e-6


def deformations(count, size=0.3):
    rng = np.random.default_rng(3)
    F = np.eye(3) + rng.uniform(-size, size, (4 * count, 3, 3))
    return F[np.linalg.det(F) > 0.3][:count]


def rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def central(function, F):
    """d function / dF_iK by central differences, columns ordered as vec(F)."""
    columns = []
    for k in range(3):
        for i in range(3):
            step = np.zeros((3, 3))
            step[i, k] = EPS
            columns.append((function(F + step) - function(F - step)) / (2 * EPS))
    return np.array(columns)


def test_rest_state_has_no_energy_and_no_stress():
    assert material.energy(np.eye(3), MU, KAPPA) == 0.0
    np.testing.assert_allclose(material.stress(np.eye(3), MU, KAPPA), 0.0, atol=1e-12)


def test_rest_tangent_is_isotropic_linear_elasticity():
    lam = KAPPA - 2.0 / 3.0 * MU
    d = np.eye(3)
    expected = (lam * np.einsum('ik,jl->kilj', d, d)
                + MU * (np.einsum('ij,kl->kilj', d, d) + np.einsum('il,kj->kilj', d, d)))
    np.testing.assert_allclose(material.tangent(np.eye(3), MU, KAPPA), expected.reshape(9, 9),
                               atol=1e-9 * KAPPA)


@pytest.mark.parametrize('F', deformations(10))
def test_stress_is_the_derivative_of_energy(F):
    numeric = central(lambda G: material.energy(G, MU, KAPPA), F).reshape(3, 3).T
    stress = material.stress(F, MU, KAPPA)
    np.testing.assert_allclose(numeric, stress, atol=1e-7 * np.abs(stress).max())


@pytest.mark.parametrize('F', deformations(10))
def test_tangent_is_the_derivative_of_stress_and_symmetric(F):
    numeric = central(lambda G: material.stress(G, MU, KAPPA).ravel(order='F'), F)
    A = material.tangent(F, MU, KAPPA)
    np.testing.assert_allclose(numeric, A, atol=1e-7 * np.abs(A).max())
    np.testing.assert_allclose(A, A.T, atol=1e-12 * np.abs(A).max())


def test_objectivity_and_isotropy():
    rng = np.random.default_rng(4)
    for F in deformations(5):
        Q, R = rotation(rng), rotation(rng)
        energy = material.energy(F, MU, KAPPA)
        np.testing.assert_allclose(material.energy(Q @ F @ R, MU, KAPPA), energy, rtol=1e-10)
        np.testing.assert_allclose(material.stress(Q @ F, MU, KAPPA),
                                   Q @ material.stress(F, MU, KAPPA), rtol=1e-9, atol=1e-8)


def test_moduli_give_the_uniaxial_stiffness():
    E, nu = 6000.0, 0.45
    A = material.tangent(np.eye(3), *material.moduli(E, nu))
    strain = np.diag([1.0, -nu, -nu]).ravel(order='F')
    np.testing.assert_allclose((A @ strain).reshape(3, 3), np.diag([E, 0, 0]), atol=1e-8 * E)


@pytest.mark.parametrize('F', deformations(10))
def test_kernels_equal_their_numpy_twins(F):
    F = np.ascontiguousarray(F)
    inv_T, P = np.empty((3, 3)), np.empty((3, 3))
    J, I1 = material.inverse_transpose(F, inv_T), np.sum(F * F)
    np.testing.assert_allclose(inv_T, np.linalg.inv(F).T, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(J, np.linalg.det(F), rtol=1e-13)
    S = np.diag([300.0, -200.0, 100.0]) + 50.0
    density = material.stress_kernel(F, inv_T, J, I1, MU, KAPPA, S, P)
    added = 0.5 * np.sum(S * (F.T @ F - np.eye(3)))
    np.testing.assert_allclose(density, material.energy(F, MU, KAPPA) + added, rtol=1e-11)
    np.testing.assert_allclose(P, material.stress(F, MU, KAPPA) + F @ S, rtol=1e-10, atol=1e-8)


@pytest.mark.parametrize('F', deformations(5))
def test_stiffness_kernel_contracts_the_tangent(F):
    rng = np.random.default_rng(5)
    F = np.ascontiguousarray(F)
    G, S = rng.normal(size=(4, 3)), 1000.0 * np.array([[1, 0.2, 0], [0.2, -1, 0.1], [0, 0.1, 2]])
    inv_T = np.empty((3, 3))
    J = material.inverse_transpose(F, inv_T)
    out = np.zeros((4, 4, 3, 3))
    material.stiffness_kernel(G, F, inv_T, J, np.sum(F * F), MU, KAPPA, S, 0.5, False,
                              np.empty((5, 4, 3)), out)
    material.mirror_blocks(out)
    A = material.tangent(F, MU, KAPPA) + np.kron(S, np.eye(3))  # d(F S)/dF
    expected = 0.5 * np.einsum('ak,kilj,bl->abij', G, A.reshape(3, 3, 3, 3), G)
    np.testing.assert_allclose(out, expected, atol=1e-10 * np.abs(expected).max())
