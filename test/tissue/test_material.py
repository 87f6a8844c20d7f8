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


LAWS = (material.NEO_HOOKE, np.array([700.0, 0.0, 0.0, 0.0, 0.0]),
        np.array([0.0, 900.0, 0.6, 0.0, 0.8]), np.array([700.0, 900.0, 0.0, 1.0, 0.0]))


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
    added = 0.5 * np.sum(S * (F.T @ F - np.eye(3)))
    for beyond in LAWS:
        for on in (0.0, 1.0):
            stored = material.stress_kernel(F, inv_T, J, I1, MU, KAPPA, on, beyond, 0.5, S, P)
            law = MU, KAPPA, on * beyond
            np.testing.assert_allclose(2.0 * stored, material.energy(F, *law) + added, rtol=1e-11)
            np.testing.assert_allclose(2.0 * P, material.stress(F, *law) + F @ S, rtol=1e-10,
                                       atol=1e-8)


@pytest.mark.parametrize('F', deformations(5))
def test_stiffness_kernel_contracts_the_tangent(F):
    rng = np.random.default_rng(5)
    F = np.ascontiguousarray(F)
    G, S = rng.normal(size=(4, 3)), 1000.0 * np.array([[1, 0.2, 0], [0.2, -1, 0.1], [0, 0.1, 2]])
    A = material.tangent(F, MU, KAPPA) + np.kron(S, np.eye(3))  # d(F S)/dF
    expected = 0.5 * np.einsum('ak,kilj,bl->abij', G, A.reshape(3, 3, 3, 3), G)
    out = element_blocks(F, G, S, LAWS[0])
    np.testing.assert_allclose(out, expected, atol=1e-10 * np.abs(expected).max())


def element_blocks(F, G, S, beyond):
    """What `tangent_vectors` stands for, put together as its docstring says: (a, a, 3, 3)."""
    inv_T, out = np.empty((3, 3)), np.empty((6, 3 * len(G)))
    J = material.inverse_transpose(F, inv_T)
    swap, bundle = material.tangent_vectors(G, F, inv_T, J, np.sum(F * F), MU, KAPPA, 1.0, beyond,
                                            0.5, S, False, out)
    g, h, right, left, load, f = out.reshape(6, -1, 3)
    return (swap * np.einsum('bi,aj->abij', g, g) + np.einsum('ai,bj->abij', g, right)
            + np.einsum('ai,bj->abij', h, left) + bundle * np.einsum('ai,bj->abij', f, f)
            + np.einsum('ak,bk,ij->abij', G, load, np.eye(3)))


@pytest.mark.parametrize('F', deformations(5))
@pytest.mark.parametrize('law', [1, 2, 3])
def test_tangent_beyond_neo_hooke_is_the_derivative_of_the_stress(F, law):
    """Central differences of the NumPy stress, step 1e-6: rounding 1e-16 x 1e5 / 1e-6 left."""
    F, h = np.ascontiguousarray(F), 1e-6
    G = np.random.default_rng(6).normal(size=(4, 3))
    rate = np.empty((4, 3, 3, 3))  # of P_iK by moving node b along j
    for b in range(4):
        for j in range(3):
            step = h * np.outer(np.eye(3)[j], G[b])
            ahead, back = (material.stress(F + s * step, MU, KAPPA, LAWS[law]) for s in (1, -1))
            rate[b, :, :, j] = (ahead - back) / (2.0 * h)
    expected = 0.5 * np.einsum('ak,bikj->abij', G, rate)
    out = element_blocks(F, G, np.zeros((3, 3)), LAWS[law])
    np.testing.assert_allclose(out, expected, atol=3e-7 * np.abs(expected).max())


def test_fibres_stiffen_their_own_direction_by_four_k():
    """Small strain: uniaxial strain e along a0 adds W = k/2 (2 e)^2, hence stress 4 k e."""
    e, k = 1e-6, 500.0
    F = np.eye(3) + e * np.outer([0, 0, 1.0], [0, 0, 1.0])
    with_fibres = material.stress(F, MU, KAPPA, np.array([0.0, k, 0.0, 0.0, 1.0]))
    added = with_fibres - material.stress(F, MU, KAPPA)
    np.testing.assert_allclose(added, np.diag([0.0, 0.0, 4.0 * k * e]), atol=1e-5 * k * e)


def test_yeoh_uniaxial_stress_in_closed_form():
    """Incompressible: P = 2 (l - l^-2) (W1), W1 = mu/2 + 2 c (I1 - 3); pressure fits the sides."""
    stretch, c = 1.4, 800.0
    F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
    P = material.stress(F, MU, 0.0, np.array([c, 0.0, 0.0, 0.0, 0.0]))
    free = P - P[1, 1] * F[1, 1] * np.linalg.inv(F).T
    I1 = stretch**2 + 2.0 / stretch
    exact = 2.0 * (stretch - stretch**-2) * (0.5 * MU + 2.0 * c * (I1 - 3.0))
    assert free[0, 0] == pytest.approx(exact, rel=1e-12)
