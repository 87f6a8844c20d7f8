"""Forces, and stiffness by forces' derivative, of displacement-pressure elements, compiled."""
import numpy as np
from numba import njit

from arm_brachy.prove.generator.law import cofactor, stiffness, stress


@njit(cache=True)
def dot(a, b):
    """Scalar product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def deformation(u, nodes, dn):
    """Deformation gradient (3, 3) of an element with `nodes` (a,) and slopes dn (a, 3)."""
    F = np.eye(3)
    for a in range(nodes.shape[0]):
        for i in range(3):
            for j in range(3):
                F[i, j] += u[nodes[a], i] * dn[a, j]
    return F


@njit(cache=True)
def forces(u, p, tets, cells, dn, vol, psi, mu, kappa, c, d, k, a, s):
    """Nodal forces (n, 3) [N] and volume errors (np,) [m^3] at displacement u, pressure p.

    u (n, 3) [m]; p (np,) [Pa]; tets (m, 10); dn (m, q, 10, 3); vol (m, q); psi (q, b) pressure
    functions of the unknowns cells (m, b); mu, kappa, c, d, k (m, q) [Pa]; a (m, q, 3); s (m, q)
    stretch by swelling [1].
    """
    f = np.zeros(u.shape)
    g = np.zeros(p.shape)
    for e in range(tets.shape[0]):
        for q in range(vol.shape[1]):
            F = deformation(u, tets[e], dn[e, q]) / s[e, q]
            J, C = cofactor(F)
            pq = 0.0
            for b in range(psi.shape[1]):
                pq += psi[q, b] * p[cells[e, b]]
            P = stress(F, J, C, mu[e, q], c[e, q], d[e, q], k[e, q], a[e, q]) + pq * C
            w = vol[e, q] * s[e, q]**2
            for n in range(tets.shape[1]):
                for i in range(3):
                    f[tets[e, n], i] += w * dot(P[i], dn[e, q, n])
            r = vol[e, q] * s[e, q]**3 * (J - 1 - pq / kappa[e, q])
            for b in range(psi.shape[1]):
                g[cells[e, b]] += psi[q, b] * r
    return f, g


@njit(cache=True)
def tangent(u, p, tets, cells, dn, vol, psi, mu, kappa, c, d, k, a, s, where, data):
    """Add the symmetric stiffness at (u, p) into `data`; arguments as in `forces`.

    where (m, d, d) : place in `data` of every entry of an element's matrix, -1 if not kept;
    its rows: three per node, then one per pressure.
    """
    nn, nb = tets.shape[1], psi.shape[1]
    nd = 3 * nn
    K = np.empty((nd + nb, nd + nb))
    AB = np.empty((3, 3, nn, 3))
    for e in range(tets.shape[0]):
        K[:] = 0
        for q in range(vol.shape[1]):
            F = deformation(u, tets[e], dn[e, q]) / s[e, q]
            J, C = cofactor(F)
            pq = 0.0
            for b in range(nb):
                pq += psi[q, b] * p[cells[e, b]]
            A = stiffness(F, J, C, mu[e, q], c[e, q], d[e, q], k[e, q], a[e, q], pq)
            w = vol[e, q] * s[e, q]
            slope = dn[e, q]
            for i in range(3):
                for j in range(3):
                    for n in range(nn):
                        for m in range(3):
                            AB[i, j, n, m] = w * dot(A[i, j, m], slope[n])
            for n in range(nn):
                for i in range(3):
                    row = 3 * n + i
                    for o in range(n, nn):
                        for m in range(3):
                            K[row, 3 * o + m] += (slope[n, 0] * AB[i, 0, o, m]
                                                  + slope[n, 1] * AB[i, 1, o, m]
                                                  + slope[n, 2] * AB[i, 2, o, m])
                    cd = vol[e, q] * s[e, q]**2 * dot(C[i], slope[n])
                    for b in range(nb):
                        K[row, nd + b] += cd * psi[q, b]
            for b in range(nb):
                for o in range(b, nb):
                    K[nd + b, nd + o] -= (vol[e, q] * s[e, q]**3 * psi[q, b] * psi[q, o]
                                          / kappa[e, q])
        for row in range(nd + nb):
            for col in range(row, nd + nb):
                at = where[e, row, col]
                if at >= 0:
                    data[at] += K[row, col]
    return data
