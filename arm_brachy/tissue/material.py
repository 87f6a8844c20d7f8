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
def stiffness_kernel(G, F, inv_T, J, I1, mu, kappa, S, weight, convex, work, out):
    """Twin of `tangent`, contracted with shape gradients: add to the element stiffness.

    G : (a, 3) shape gradients [1/m];  weight : [m^3];  S : (3, 3) as in `stress_kernel`
    convex : leave out the volumetric pressure's geometric part, kappa J (J - 1) d2J/dF2, which is
        indefinite and large where J is far from 1 (Gauss-Newton of kappa/2 (J - 1)^2)
    work : (5, a, 3) work space
    out : (a, a, 3, 3) [N/m], out[a, b, i, j] += d force_ai / d x_bj for b >= a only
    With g = F^-T G and h = F G a block is a sum of three dyads and a multiple of the identity:
        (c_swap g_b) g_a' + g_a (c_outer g_b + c_mixed h_b)' + (c_mixed h_a) g_b' + d_ab I
    """
    scale = mu * np.cbrt(J) ** -2
    pressure = 0.0 if convex else kappa * (J - 1.0)
    c_swap = weight * (scale * I1 / 3.0 - pressure * J)
    c_mixed = weight * -2.0 / 3.0 * scale
    c_outer = weight * (2.0 / 9.0 * scale * I1 + (kappa * J + pressure) * J)
    g, swapped, right, left, load = work
    for a in range(G.shape[0]):
        for i in range(3):
            g[a, i] = inv_T[i, 0] * G[a, 0] + inv_T[i, 1] * G[a, 1] + inv_T[i, 2] * G[a, 2]
            h = F[i, 0] * G[a, 0] + F[i, 1] * G[a, 1] + F[i, 2] * G[a, 2]
            swapped[a, i] = c_swap * g[a, i]
            left[a, i] = c_mixed * h
            right[a, i] = c_outer * g[a, i] + c_mixed * h
            load[a, i] = weight * (scale * G[a, i] + S[i, 0] * G[a, 0] + S[i, 1] * G[a, 1]
                                   + S[i, 2] * G[a, 2])
    for a in range(G.shape[0]):
        for b in range(a, G.shape[0]):
            for i in range(3):
                for j in range(3):
                    out[a, b, i, j] += (swapped[b, i] * g[a, j] + g[a, i] * right[b, j]
                                        + left[a, i] * g[b, j])
            d = G[a, 0] * load[b, 0] + G[a, 1] * load[b, 1] + G[a, 2] * load[b, 2]
            out[a, b, 0, 0] += d
            out[a, b, 1, 1] += d
            out[a, b, 2, 2] += d


@njit(cache=True, error_model='numpy')
def mirror_blocks(out):
    """Fill the lower blocks of a symmetric element matrix (a, a, 3, 3) from the upper ones."""
    for a in range(out.shape[0]):
        for b in range(a + 1, out.shape[0]):
            for i in range(3):
                for j in range(3):
                    out[b, a, j, i] = out[a, b, i, j]
