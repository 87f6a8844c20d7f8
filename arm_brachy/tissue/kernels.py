"""Loops over elements and their fixed-order gathers; the only compiled code of `assembly`.

Each element writes into its own slot and each node or matrix block then sums its slots in a
fixed order, so results do not depend, to the last bit, on the number of threads.
Arrays: x (n, 3); conn (m, a); G (m, q, a, 3); w (m, q); mu, kappa (m,); S (m, q, 3, 3).
"""

import numpy as np
from numba import njit, prange

from arm_brachy.tissue.material import (
    inverse_transpose,
    mirror_blocks,
    stiffness_kernel,
    stress_kernel,
)

CHUNK = 64  # elements that share one set of work arrays


@njit(cache=True, error_model='numpy')
def deformation_gradient(x, nodes, G, F):
    """Write F = sum_a x_a (x) dN_a/dX into `F` (3, 3) and return I1 = tr(F' F)."""
    I1 = 0.0
    for i in range(3):
        for k in range(3):
            value = 0.0
            for a in range(nodes.shape[0]):
                value += x[nodes[a], i] * G[a, k]
            F[i, k] = value
            I1 += value * value
    return I1


@njit(cache=True, parallel=True, error_model='numpy')
def element_forces(x, conn, G, w, mu, kappa, S, energy, force, min_J):
    """Energy (m,), nodal forces dU/dx (m, a, 3) and smallest J (m,) of every element.

    Where J <= 0 the energy is inf and the forces are zero.
    """
    m = conn.shape[0]
    for chunk in prange((m + CHUNK - 1) // CHUNK):
        F, inv_T, P = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
        for e in range(chunk * CHUNK, min(m, (chunk + 1) * CHUNK)):
            energy[e] = 0.0
            force[e] = 0.0
            min_J[e] = np.inf
            for q in range(w.shape[1]):
                I1 = deformation_gradient(x, conn[e], G[e, q], F)
                J = inverse_transpose(F, inv_T)
                min_J[e] = min(min_J[e], J)
                if not J > 0.0:
                    energy[e] = np.inf
                    continue
                energy[e] += w[e, q] * stress_kernel(F, inv_T, J, I1, mu[e], kappa[e],
                                                   S[e, q], P)
                for a in range(conn.shape[1]):
                    for i in range(3):
                        force[e, a, i] += w[e, q] * (P[i, 0] * G[e, q, a, 0]
                                                     + P[i, 1] * G[e, q, a, 1]
                                                     + P[i, 2] * G[e, q, a, 2])


@njit(cache=True, parallel=True, error_model='numpy')
def element_stiffness(x, conn, G, w, mu, kappa, S, convex, out):
    """Element tangents (m, a, a, 3, 3) [N/m]; every J must be positive; see `stiffness_kernel`."""
    m, n_local = conn.shape
    for chunk in prange((m + CHUNK - 1) // CHUNK):
        F, inv_T = np.empty((3, 3)), np.empty((3, 3))
        work = np.empty((5, n_local, 3))
        for e in range(chunk * CHUNK, min(m, (chunk + 1) * CHUNK)):
            out[e] = 0.0
            for q in range(w.shape[1]):
                I1 = deformation_gradient(x, conn[e], G[e, q], F)
                J = inverse_transpose(F, inv_T)
                stiffness_kernel(G[e, q], F, inv_T, J, I1, mu[e], kappa[e], S[e, q],
                                 w[e, q], convex, work, out[e])
            mirror_blocks(out[e])


@njit(cache=True, parallel=True)
def gather(start, slots, parts, out):
    """out[r] = sum of parts[slots[start[r]:start[r + 1]]] in that order; parts (s, c)."""
    for r in prange(start.shape[0] - 1):
        out[r] = 0.0
        for p in range(start[r], start[r + 1]):
            for c in range(parts.shape[1]):
                out[r, c] += parts[slots[p], c]


@njit(cache=True, parallel=True)
def scatter_blocks(block_start, block_slots, parts, indptr, constant, data):
    """Sum element blocks (s, 9) into the values of a CSR matrix of 3 x 3 blocks.

    Row r of blocks covers matrix rows 3 r .. 3 r + 2;  indptr (n + 1,) counts blocks per row
    constant : (blocks, 9) what every block starts from (springs)
    """
    for r in prange(indptr.shape[0] - 1):
        width = 3 * (indptr[r + 1] - indptr[r])
        block = np.empty(9)
        for b in range(indptr[r], indptr[r + 1]):
            for c in range(9):
                block[c] = constant[b, c]
            for p in range(block_start[b], block_start[b + 1]):
                for c in range(9):
                    block[c] += parts[block_slots[p], c]
            at = 9 * indptr[r] + 3 * (b - indptr[r])
            for i in range(3):
                for j in range(3):
                    data[at + i * width + j] = block[3 * i + j]
