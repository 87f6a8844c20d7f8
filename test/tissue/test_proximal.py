"""The local step of ADMM, its sums, and its weights against NumPy and a general optimiser."""

import numpy as np
import pytest
from scipy.optimize import minimize

from arm_brachy.tissue import admm_kernels, proximal
from arm_brachy.tissue.admm_weights import (
    Weights,
    curvature_weights,
    elastic_stress,
    published_weights,
)
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import linear_tet
from arm_brachy.tissue.material import energy, moduli, stress, tangent

MU, KAPPA = moduli(6e3, 0.48)
VOLUME = 3e-7  # m^3
ROWS = np.arange(9).reshape(3, 3).T.ravel()  # component of the row-wise order at column-wise place


def gradients(count, spread, seed=7):
    """Deformation gradients (9, count) around the identity."""
    rng = np.random.default_rng(seed)
    return np.eye(3).reshape(9, 1) + spread * rng.normal(size=(9, count))


def weights(count, seed=2):
    rng = np.random.default_rng(seed)
    n = rng.normal(size=(9, count))
    return Weights(VOLUME * KAPPA * rng.uniform(0.3, 3.0, count),
                   VOLUME * KAPPA * rng.uniform(0.0, 5.0, count), n / np.linalg.norm(n, axis=0))


def local(Y, w, tolerance=1e-9):
    """Minimisers (9, m) from the identity, and the sweeps."""
    m = Y.shape[1]
    z, u = np.repeat(np.eye(3).reshape(9, 1), m, axis=1), np.empty_like(Y)
    sweeps = np.zeros((m + proximal.CHUNK - 1) // proximal.CHUNK)
    moduli_of = (np.full(m, k) for k in (VOLUME, MU, KAPPA))
    proximal.local_step(Y, z, u, w.n, w.alpha, w.beta, *moduli_of, tolerance, sweeps)
    assert np.array_equal(u, Y - z)
    return z, sweeps


@pytest.mark.parametrize('spread', [0.05, 0.3, 0.8])
def test_local_step_is_a_minimum(spread):
    """At the minimiser found, a simplex search around it finds nothing lower."""
    Y, w = gradients(12, spread), weights(12)
    found, sweeps = local(Y, w)
    assert sweeps.max() < proximal.MAX_NEWTON
    for e in range(Y.shape[1]):
        W = w.alpha[e] * np.eye(9) + w.beta[e] * np.outer(w.n[:, e], w.n[:, e])

        def objective(flat, W=W, y=Y[:, e]):
            z = flat.reshape(3, 3)
            if not np.linalg.det(z) > 0.0:
                return np.inf
            pull = 0.5 * (flat - y) @ W @ (flat - y)
            return energy(z, MU, KAPPA) / KAPPA + pull / (VOLUME * KAPPA)

        rng = np.random.default_rng(e)
        best = minimize(objective, found[:, e] + 1e-3 * rng.normal(size=9), method='Nelder-Mead',
                        options={'maxiter': 20000, 'maxfev': 20000, 'xatol': 1e-7,
                                 'fatol': 1e-15})
        assert objective(found[:, e]) <= best.fun + 1e-12
        assert np.abs(found[:, e] - best.x).max() < 1e-4


def test_local_step_is_stationary_for_any_number_of_elements():
    """Lanes past the end, several groups, several chunks: W (Y - z) is V P(z) in all."""
    for m in (1, proximal.LANES, proximal.LANES + 1, 2 * proximal.CHUNK + 5):
        Y, w = gradients(m, 0.2), weights(m)
        z, _ = local(Y, w)
        P = stress(z.T.reshape(m, 3, 3), MU, KAPPA).reshape(m, 9).T
        assert w.apply(Y - z) == pytest.approx(VOLUME * P, abs=1e-9 * VOLUME * KAPPA)


def test_local_step_commutes_with_rotations():
    """With a scalar weight the minimiser for Q Y is Q times that for Y."""
    Y = gradients(40, 0.2)
    w = published_weights(np.full(40, VOLUME), np.full(40, KAPPA), 1.0)
    Q = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    Q *= np.linalg.det(Q)
    turned = np.einsum('ij,jkm->ikm', Q, Y.reshape(3, 3, -1)).reshape(9, -1)
    plain, rotated = local(Y, w)[0], local(turned, w)[0]
    assert rotated == pytest.approx(
        np.einsum('ij,jkm->ikm', Q, plain.reshape(3, 3, -1)).reshape(9, -1), abs=1e-8)


def test_sums_and_pulls_against_numpy():
    mesh = box_mesh((0.06,) * 3, (3, 3, 3))
    g, rng = linear_tet(mesh.nodes, mesh.tets), np.random.default_rng(4)
    G, V, m = np.ascontiguousarray(g.gradients[:, 0]), g.weights[:, 0].copy(), len(mesh.tets)
    x = mesh.nodes + 1e-3 * rng.normal(size=mesh.nodes.shape)
    z, u, w = gradients(m, 0.05), 0.1 * gradients(m, 0.05, seed=8), weights(m)
    S = rng.normal(size=(m, 3, 3))
    S = 100.0 * (S + np.swapaxes(S, 1, 2))
    mu, kappa = np.full(m, MU), np.full(m, KAPPA)
    F, sums = np.empty((9, m)), np.zeros(((m + proximal.CHUNK - 1) // proximal.CHUNK, 3))
    admm_kernels.look(x, g.connectivity, G, z, u, w.n, w.alpha, w.beta, V, mu, kappa, S, F, sums)
    D = np.einsum('mai,mak->mik', x[mesh.tets], G)
    assert F == pytest.approx(D.reshape(m, 9).T, abs=1e-14)
    r = F - z
    green = 0.5 * (np.swapaxes(D, 1, 2) @ D - np.eye(3))
    merit = (np.sum(V * energy(z.T.reshape(m, 3, 3), MU, KAPPA)) + np.sum(w.apply(u) * r)
             + 0.5 * np.sum(w.apply(r) * r) + np.sum(V[:, None, None] * S * green))
    assert sums[:, 0].sum() == pytest.approx(merit, rel=1e-12)
    assert sums[:, 1].sum() == pytest.approx(np.sum(w.apply(r) * r), rel=1e-12)
    assert sums[:, 2].max() == np.abs(r).max()
    parts = np.empty((m, 4, 3))
    admm_kernels.pulls(F, z, u, w.n, w.alpha, w.beta, V, S, G, parts)
    q = w.apply(z - u - F).T.reshape(m, 3, 3) - V[:, None, None] * (D @ S)
    expected = np.einsum('mik,mak->mai', q, G)
    assert parts == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


def test_weights_solve_undoes_apply():
    w, t = weights(30), gradients(30, 1.0)
    assert w.solve(w.apply(t)) == pytest.approx(t, rel=1e-10)


def test_stress_twin():
    z = gradients(50, 0.1)
    expected = stress(z.T.reshape(50, 3, 3), MU, KAPPA).reshape(50, 9).T
    mu, kappa = np.full(50, MU), np.full(50, KAPPA)
    assert elastic_stress(z, mu, kappa) == pytest.approx(expected, rel=1e-9, abs=1e-9 * KAPPA)
    assert np.isnan(elastic_stress(-z, mu, kappa)).all()


def test_curvature_weights_bound_the_tangent():
    """Along n exactly its curvature; across n no eigenvalue of the tangent is larger."""
    m = 60
    z = gradients(m, 0.12)
    ones = np.ones(m)
    w = curvature_weights(z, ones, MU * ones, KAPPA * ones, 1.0, 0.0)
    for e in range(m):
        H = tangent(z[:, e].reshape(3, 3), MU, KAPPA)[np.ix_(ROWS, ROWS)]
        n = w.n[:, e]
        across = np.eye(9) - np.outer(n, n)
        largest = np.abs(np.linalg.eigvalsh(across @ H @ across)).max()
        assert largest <= w.alpha[e] * (1.0 + 1e-9)
        assert max(n @ H @ n, w.alpha[e]) == pytest.approx(w.alpha[e] + w.beta[e], rel=1e-9)


def test_curvature_weights_at_rest():
    """2 mu across, 3 kappa along: the eigenvalues of the linear law."""
    rest = np.eye(3).reshape(9, 1)
    w = curvature_weights(rest, np.ones(1), MU * np.ones(1), KAPPA * np.ones(1), 1.0, 0.0)
    assert w.alpha[0] == pytest.approx(2.0 * MU)
    assert w.alpha[0] + w.beta[0] == pytest.approx(3.0 * KAPPA)
    w = curvature_weights(rest, np.ones(1), MU * np.ones(1), KAPPA * np.ones(1), 2.0, 10.0)
    assert w.alpha[0] == pytest.approx(20.0 * MU)
