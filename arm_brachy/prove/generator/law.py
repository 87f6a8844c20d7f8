"""Stress and stiffness of the tissue at one integration point, compiled.

Energy per volume at rest, with Ib = J^(-2/3) tr(F^T F) and I4 = |F a|^2,

    W = mu/2 (Ib - 3) + c (Ib - 3)^2 + d (Ib - 3)^3 + k/2 (I4 - 1)^2 + p (J - 1) - p^2 / (2 kappa)

the stationary value of which over the pressure p is the compressible law with kappa/2 (J - 1)^2.
"""
import numpy as np
from numba import njit


@njit(cache=True)
def cofactor(F):
    """J and J F^-T of F (3, 3)."""
    C = np.empty((3, 3))
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            C[i, j] = F[i1, j1] * F[i2, j2] - F[i1, j2] * F[i2, j1]
    return F[0, 0] * C[0, 0] + F[0, 1] * C[0, 1] + F[0, 2] * C[0, 2], C


@njit(cache=True)
def stress(F, J, C, mu, c, d, k, a):
    """First Piola-Kirchhoff stress (3, 3) [Pa] less its pressure part, F (3, 3).

    J, C : of `cofactor`; mu, c, d, k [Pa]; a (3,) fibre, unit vector.
    """
    j23 = J ** (-2.0 / 3.0)
    i1 = (F * F).sum()
    off = j23 * i1 - 3
    alpha = mu + 4 * c * off + 6 * d * off**2
    P = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            P[i, j] = alpha * j23 * (F[i, j] - i1 / 3 * C[i, j] / J)
    if k != 0:
        f = F @ a
        stretch = 2 * k * ((f * f).sum() - 1)
        for i in range(3):
            for j in range(3):
                P[i, j] += stretch * f[i] * a[j]
    return P


@njit(cache=True)
def stiffness(F, J, C, mu, c, d, k, a, p):
    """Derivative (3, 3, 3, 3) [Pa] of the whole stress by F at fixed pressure p."""
    j23 = J ** (-2.0 / 3.0)
    i1 = (F * F).sum()
    off = j23 * i1 - 3
    alpha = (mu + 4 * c * off + 6 * d * off**2) * j23
    bend = 2 * c + 6 * d * off
    H = C / J
    G = 2 * j23 * (F - i1 / 3 * H)
    f = F @ a
    stretch = 2 * k * ((f * f).sum() - 1)
    A = np.empty((3, 3, 3, 3))
    for i in range(3):
        for j in range(3):
            for m in range(3):
                for n in range(3):
                    v = alpha * (-2.0 / 3.0 * (F[i, j] * H[m, n] + H[i, j] * F[m, n])
                                 + 2.0 / 9.0 * i1 * H[i, j] * H[m, n]
                                 + i1 / 3 * H[i, n] * H[m, j])
                    v += bend * G[i, j] * G[m, n]
                    v += p * J * (H[i, j] * H[m, n] - H[i, n] * H[m, j])
                    v += 4 * k * f[i] * a[j] * f[m] * a[n]
                    if i == m:
                        v += stretch * a[j] * a[n]
                        if j == n:
                            v += alpha
                    A[i, j, m, n] = v
    return A
