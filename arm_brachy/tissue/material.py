"""Compressible Neo-Hookean law (3.18): energy, stress and tangent, in NumPy and in numba.

Psi = mu/2 (J^(-2/3) I1 - 3) + kappa/2 (J - 1)^2,   J = det F,   I1 = tr(F' F).
Printed with J = I3 / 2, which would leave stress in the rest state; J = sqrt(I3) = det F here.
The NumPy functions are the readable reference; the kernels below them do the work.
"""

import numpy as np
from numba import njit


def moduli(E, nu):
    """Return (mu, kappa) [Pa] from Young's modulus E [Pa] and Poisson's ratio nu (below 3.18)."""
    return E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu))


def energy(F, mu, kappa):
    """Return the stored energy per reference volume [J/m^3], (3.18).

    F : (..., 3, 3), det F > 0;  mu, kappa : scalars or (...,) [Pa]
    """
    J = np.linalg.det(F)
    I1 = np.sum(F * F, axis=(-2, -1))
    return 0.5 * mu * (J ** (-2.0 / 3.0) * I1 - 3.0) + 0.5 * kappa * (J - 1.0) ** 2


def stress(F, mu, kappa):
    """Return the first Piola-Kirchhoff stress P = dPsi/dF (..., 3, 3) [Pa].

    F : (..., 3, 3), det F > 0;  mu, kappa : scalars or (...,) [Pa]
    """
    J = np.linalg.det(F)[..., None, None]
    I1 = np.sum(F * F, axis=(-2, -1))[..., None, None]
    mu, kappa = np.asarray(mu)[..., None, None], np.asarray(kappa)[..., None, None]
    inv_T = np.swapaxes(np.linalg.inv(F), -1, -2)
    return mu * J ** (-2.0 / 3.0) * (F - I1 / 3.0 * inv_T) + kappa * J * (J - 1.0) * inv_T


def tangent(F, mu, kappa):
    """Return A = dvec(P)/dvec(F) (9, 9) [Pa], vec column by column: entry 3 K + i is F_iK.

    F : (3, 3), det F > 0;  mu, kappa : [Pa]
    The bracket of (3.24) with four slips of the print put right: the coefficient of the identity
    is mu (not mu/3), the last kappa term is positive, the 4 mu/3 term is split so that A is
    symmetric, and J = det F. The printed form disagrees with finite differences of the stress.
    """
    J, I1 = np.linalg.det(F), np.sum(F * F)
    inv_T = np.linalg.inv(F).T
    f, g = F.ravel(order='F'), inv_T.ravel(order='F')
    scale = mu * J ** (-2.0 / 3.0)
    swap = np.eye(9).reshape(3, 3, 3, 3).transpose(0, 1, 3, 2).reshape(9, 9)  # Q of (3.24)
    return (scale * np.eye(9)
            + (scale * I1 / 3.0 - kappa * J * (J - 1.0)) * swap @ np.kron(inv_T, inv_T.T)
            - 2.0 / 3.0 * scale * (np.outer(g, f) + np.outer(f, g))
            + (2.0 / 9.0 * scale * I1 + kappa * J * (2.0 * J - 1.0)) * np.outer(g, g))


@njit(cache=True, error_model='numpy')
def inverse_transpose(F, out):
    """Write F^-T (3, 3) into `out` and return J = det F; `out` is meaningless if J is 0."""
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for k in range(3):
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            out[i, k] = F[i1, k1] * F[i2, k2] - F[i1, k2] * F[i2, k1]
    J = F[0, 0] * out[0, 0] + F[0, 1] * out[0, 1] + F[0, 2] * out[0, 2]
    inverse = 1.0 / J
    for i in range(3):
        for k in range(3):
            out[i, k] *= inverse
    return J


@njit(cache=True, error_model='numpy')
def stress_kernel(F, inv_T, J, I1, mu, kappa, S, P):
    """Twin of `energy` and `stress`: write P(F) + F S (3, 3) [Pa] into `P`.

    inv_T, J : from `inverse_transpose`, J > 0;  I1 : tr(F' F)
    S : (3, 3) added second Piola-Kirchhoff stress [Pa], held fixed
    Returns Psi(F) + S : E [J/m^3], E = (F' F - I) / 2.
    """
    scale = mu * np.cbrt(J) ** -2
    pressure = kappa * J * (J - 1.0) - scale * I1 / 3.0
    added = -S[0, 0] - S[1, 1] - S[2, 2]
    for i in range(3):
        for k in range(3):
            FS = F[i, 0] * S[0, k] + F[i, 1] * S[1, k] + F[i, 2] * S[2, k]
            added += F[i, k] * FS
            P[i, k] = scale * F[i, k] + pressure * inv_T[i, k] + FS
    return 0.5 * (scale * I1 - 3.0 * mu + kappa * (J - 1.0) ** 2 + added)


@njit(cache=True, error_model='numpy')
def stiffness_kernel(G, F, inv_T, J, I1, mu, kappa, S, weight, g, h, out):
    """Twin of `tangent`, contracted with shape gradients: add to the element stiffness.

    G : (a, 3) shape gradients [1/m];  weight : [m^3];  S : (3, 3) as in `stress_kernel`
    g, h : (a, 3) work space for F^-T G_a and F G_a
    out : (a, a, 3, 3) [N/m], out[a, b, i, j] += d force_ai / d x_bj
    """
    scale = mu * np.cbrt(J) ** -2
    c_swap = scale * I1 / 3.0 - kappa * J * (J - 1.0)
    c_mixed = -2.0 / 3.0 * scale
    c_outer = 2.0 / 9.0 * scale * I1 + kappa * J * (2.0 * J - 1.0)
    n = G.shape[0]
    for a in range(n):
        for i in range(3):
            g[a, i] = inv_T[i, 0] * G[a, 0] + inv_T[i, 1] * G[a, 1] + inv_T[i, 2] * G[a, 2]
            h[a, i] = F[i, 0] * G[a, 0] + F[i, 1] * G[a, 1] + F[i, 2] * G[a, 2]
    for a in range(n):
        for b in range(a, n):
            diagonal = 0.0
            for k in range(3):
                SG = S[k, 0] * G[b, 0] + S[k, 1] * G[b, 1] + S[k, 2] * G[b, 2]
                diagonal += G[a, k] * (scale * G[b, k] + SG)
            for i in range(3):
                for j in range(3):
                    value = (c_swap * g[b, i] * g[a, j]
                             + c_mixed * (g[a, i] * h[b, j] + h[a, i] * g[b, j])
                             + c_outer * g[a, i] * g[b, j])
                    if i == j:
                        value += diagonal
                    out[a, b, i, j] += weight * value
                    if a != b:
                        out[b, a, j, i] += weight * value
