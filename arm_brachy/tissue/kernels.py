"""Loops over elements and their fixed-order gathers; the only compiled code of `assembly`.

Each element writes into its own slot and each node or matrix block then sums its slots in a
fixed order, so results do not depend, to the last bit, on the number of threads.
Arrays: x (n, 3); conn (m, a); G (m, q, a, 3); w, mu, kappa (m, q) as the points carry them; shear
(q,) 1 where they carry `beyond` (m, BEYOND) too; S (m, q, 3, 3).

Element loops are compiled for the numbers of nodes and points of an element: constant bounds let
the compiler unroll and vectorise. Kernels are told in `element_forces`, `element_stiffness`.
No fastmath, not even fused multiply-add: a function just compiled and the same one loaded from
numba's cache would then differ in the last bit.
"""

from functools import cache

import numpy as np
from numba import njit, prange

from arm_brachy.tissue.material import inverse_transpose, stress_kernel, tangent_vectors

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


@cache
def element_forces(a, q):
    """Return the compiled loop for elements of `a` nodes and `q` points.

    loop(x, conn, G, w, mu, kappa, shear, beyond, S, energy, force, min_J) writes energy (m,),
    nodal forces dU/dx (m, a, 3) and smallest J (m,) of every element; where J <= 0 the energy is
    inf and the forces lack that point's share.
    """
    @njit(cache=True, parallel=True, error_model='numpy')
    def loop(x, conn, G, w, mu, kappa, shear, beyond, S, energy, force, min_J):
        m = conn.shape[0]
        for chunk in prange((m + CHUNK - 1) // CHUNK):
            F, inv_T, P = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
            for e in range(chunk * CHUNK, min(m, (chunk + 1) * CHUNK)):
                energy[e] = 0.0
                force[e] = 0.0
                min_J[e] = np.inf
                for p in range(q):
                    I1 = 0.0
                    for i in range(3):
                        for k in range(3):
                            value = 0.0
                            for b in range(a):
                                value += x[conn[e, b], i] * G[e, p, b, k]
                            F[i, k] = value
                            I1 += value * value
                    J = inverse_transpose(F, inv_T)
                    min_J[e] = min(min_J[e], J)
                    if not J > 0.0:
                        energy[e] = np.inf
                        continue
                    energy[e] += stress_kernel(F, inv_T, J, I1, mu[e, p], kappa[e, p],
                                               shear[p], beyond[e], w[e, p], S[e, p], P)
                    for b in range(a):
                        for i in range(3):
                            force[e, b, i] += (P[i, 0] * G[e, p, b, 0] + P[i, 1] * G[e, p, b, 1]
                                               + P[i, 2] * G[e, p, b, 2])
    return loop


@cache
def element_stiffness(a, q):
    """Return the compiled loop for elements of `a` nodes and `q` points.

    loop(x, conn, G, w, mu, kappa, shear, beyond, S, convex, out) writes the element tangents
    (m, a (a + 1) / 2, 3, 3) [N/m], blocks (b, c) with c >= b, row by row; every J must be
    positive; `convex` as in `material.tangent_vectors`.
    """
    n = 3 * a

    @njit(cache=True, parallel=True, error_model='numpy')
    def loop(x, conn, G, w, mu, kappa, shear, beyond, S, convex, out):
        m = conn.shape[0]
        for chunk in prange((m + CHUNK - 1) // CHUNK):
            F, inv_T = np.empty((3, 3)), np.empty((3, 3))
            vectors, swap, bundle = np.empty((q, 6, n)), np.empty(q), np.empty(q)
            sums = np.empty((2, n, n))
            for e in range(chunk * CHUNK, min(m, (chunk + 1) * CHUNK)):
                for p in range(q):
                    I1 = deformation_gradient(x, conn[e], G[e, p], F)
                    J = inverse_transpose(F, inv_T)
                    swap[p], bundle[p] = tangent_vectors(
                        G[e, p], F, inv_T, J, I1, mu[e, p], kappa[e, p], shear[p], beyond[e],
                        w[e, p], S[e, p], convex, vectors[p])
                add_dyads(a, q, vectors, swap, bundle, sums)
                write_blocks(a, q, G[e], vectors, sums, out[e])
    return loop


@njit(cache=True, error_model='numpy', inline='always')
def add_dyads(a, q, vectors, swap, bundle, sums):
    """Sum the dyads of `material.tangent_vectors` over q points.

    vectors : (q, 6, 3a);  swap, bundle : (q,)
    sums : (2, 3a, 3a), written for b >= a: entries (a i, b j), and (a j, b i) of what swaps its
        indices
    """
    n = 3 * a
    for r in range(n):
        for c in range(r - r % 3, n):
            straight, crossed = 0.0, 0.0
            for p in range(q):
                straight += (vectors[p, 0, r] * vectors[p, 2, c]
                             + vectors[p, 1, r] * vectors[p, 3, c])
                crossed += swap[p] * vectors[p, 0, r] * vectors[p, 0, c]
            sums[0, r, c], sums[1, r, c] = straight, crossed
    for p in range(q):
        if bundle[p] != 0.0:
            for r in range(n):
                for c in range(r - r % 3, n):
                    sums[0, r, c] += bundle[p] * vectors[p, 5, r] * vectors[p, 5, c]


@njit(cache=True, error_model='numpy', inline='always')
def write_blocks(a, q, G, vectors, sums, out):
    """Put the sums of `add_dyads` together as blocks `out` (a (a + 1) / 2, 3, 3); G (q, a, 3)."""
    block = 0
    for b in range(a):
        for c in range(b, a):
            load = 0.0
            for p in range(q):
                load += (G[p, b, 0] * vectors[p, 4, 3 * c] + G[p, b, 1] * vectors[p, 4, 3 * c + 1]
                         + G[p, b, 2] * vectors[p, 4, 3 * c + 2])
            for i in range(3):
                for j in range(3):
                    value = sums[0, 3 * b + i, 3 * c + j] + sums[1, 3 * b + j, 3 * c + i]
                    if i == j:
                        value += load
                    out[block, i, j] = value
            block += 1


@njit(cache=True, parallel=True)
def gather(start, slots, parts, out):
    """out[r] = sum of parts[slots[start[r]:start[r + 1]]] in that order; parts (s, c)."""
    for r in prange(start.shape[0] - 1):
        out[r] = 0.0
        for p in range(start[r], start[r + 1]):
            for c in range(parts.shape[1]):
                out[r, c] += parts[slots[p], c]


@njit(cache=True, parallel=True)
def scatter_blocks(block_start, block_slots, parts, indptr, data):
    """Sum element blocks (s, 9) into the values of a CSR matrix of 3 x 3 blocks.

    block_slots : twice the row of `parts`, plus one where it is to be transposed
    Row r of blocks covers matrix rows 3 r .. 3 r + 2;  indptr (n + 1,) counts blocks per row
    """
    for r in prange(indptr.shape[0] - 1):
        width = 3 * (indptr[r + 1] - indptr[r])
        block = np.empty(9)
        for b in range(indptr[r], indptr[r + 1]):
            block[:] = 0.0
            for p in range(block_start[b], block_start[b + 1]):
                part, mirrored = block_slots[p] >> 1, block_slots[p] & 1
                down, right = 3 - 2 * mirrored, 1 + 2 * mirrored
                for i in range(3):
                    for j in range(3):
                        block[3 * i + j] += parts[part, down * i + right * j]
            at = 9 * indptr[r] + 3 * (b - indptr[r])
            for i in range(3):
                for j in range(3):
                    data[at + i * width + j] = block[3 * i + j]
