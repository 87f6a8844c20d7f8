"""Element loops of ADMM beside the local step: from nodes to matrices and back.

Arrays and grouping as in `proximal`: sums are over fixed chunks, so bits do not depend on threads.
"""

import numpy as np
from numba import njit, prange

from arm_brachy.tissue.proximal import CHUNK


@njit(cache=True, parallel=True, error_model='numpy')
def look(x, conn, G, z, u, n, alpha, beta, V, mu, kappa, S, F, sums):
    """Deformation gradients at x, and the elements' part of the augmented Lagrangian.

    x : (n, 3) [m];  conn : (m, 4);  G : (m, 4, 3) [1/m]
    S : (m, 3, 3) [Pa] added stress, or (0, 3, 3) for none
    F : (9, m) gets D x
    sums : (chunks, 3) gets, with r = F - z, the sums of
        V Psi(z) + (W u).r + |r|_W^2 / 2 + V S : (F'F - I) / 2 and of |r|_W^2, and max |r|
    """
    m, stressed = z.shape[1], S.shape[0] > 0
    for chunk in prange((m + CHUNK - 1) // CHUNK):
        merit, square, largest = 0.0, 0.0, 0.0
        lo, hi = chunk * CHUNK, min(m, (chunk + 1) * CHUNK)
        for e in range(lo, hi):
            a0, a1, a2, a3 = conn[e, 0], conn[e, 1], conn[e, 2], conn[e, 3]
            for i in range(3):
                for k in range(3):
                    F[3 * i + k, e] = (x[a0, i] * G[e, 0, k] + x[a1, i] * G[e, 1, k]
                                       + x[a2, i] * G[e, 2, k] + x[a3, i] * G[e, 3, k])
        rows = np.zeros((6, CHUNK))
        I1, rr, ur, nr, nu, far = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
        for c in range(9):
            Fc, zc, uc, nc = F[c, lo:hi], z[c, lo:hi], u[c, lo:hi], n[c, lo:hi]
            for q in range(hi - lo):
                r = Fc[q] - zc[q]
                I1[q] += zc[q] * zc[q]
                rr[q] += r * r
                ur[q] += uc[q] * r
                nr[q] += nc[q] * r
                nu[q] += nc[q] * uc[q]
                far[q] = max(far[q], abs(r))
        for q in range(hi - lo):
            e = lo + q
            J = (z[0, e] * (z[4, e] * z[8, e] - z[5, e] * z[7, e])
                 + z[1, e] * (z[5, e] * z[6, e] - z[3, e] * z[8, e])
                 + z[2, e] * (z[3, e] * z[7, e] - z[4, e] * z[6, e]))
            added = 0.0
            for k in range(3 if stressed else 0):
                added -= S[e, k, k]
                for p in range(3):
                    added += S[e, k, p] * (F[k, e] * F[p, e] + F[3 + k, e] * F[3 + p, e]
                                           + F[6 + k, e] * F[6 + p, e])
            weighted = alpha[e] * rr[q] + beta[e] * nr[q] * nr[q]
            merit += (0.5 * V[e] * (mu[e] * (np.cbrt(J) ** -2 * I1[q] - 3.0)
                                    + kappa[e] * (J - 1.0) ** 2 + added)
                      + alpha[e] * ur[q] + beta[e] * nu[q] * nr[q] + 0.5 * weighted)
            square += weighted
            largest = max(largest, far[q])
        sums[chunk, 0], sums[chunk, 1], sums[chunk, 2] = merit, square, largest


@njit(cache=True, parallel=True, error_model='numpy')
def pulls(F, z, u, n, alpha, beta, V, S, G, parts):
    """Write D' (W (z - u - F) - V F S) (m, 4, 3) [N] into `parts`; arguments as in `look`."""
    m, stressed = z.shape[1], S.shape[0] > 0
    for chunk in prange((m + CHUNK - 1) // CHUNK):
        t = np.empty(9)
        for e in range(chunk * CHUNK, min(m, (chunk + 1) * CHUNK)):
            along = 0.0
            for c in range(9):
                t[c] = z[c, e] - u[c, e] - F[c, e]
                along += n[c, e] * t[c]
            along *= beta[e]
            for c in range(9):
                t[c] = alpha[e] * t[c] + along * n[c, e]
            for i in range(3 if stressed else 0):
                for k in range(3):
                    FS = (F[3 * i, e] * S[e, 0, k] + F[3 * i + 1, e] * S[e, 1, k]
                          + F[3 * i + 2, e] * S[e, 2, k])
                    t[3 * i + k] -= V[e] * FS
            for a in range(4):
                for i in range(3):
                    parts[e, a, i] = (t[3 * i] * G[e, a, 0] + t[3 * i + 1] * G[e, a, 1]
                                      + t[3 * i + 2] * G[e, a, 2])
