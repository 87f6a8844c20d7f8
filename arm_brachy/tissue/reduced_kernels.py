"""The sampled quadrature points of a reduced model: loops over them, and how they are chosen.

A point is a deformation gradient F = F0 + B y (9 numbers, row by row) of the reduced coordinates
y (w,), a weight and two moduli: nothing of the element it came from is left.
Arrays: F0 (s, 9); B (9s, w) and its transpose Bt (w, 9s); weights, mu, kappa (s,); S (s, 3, 3).
The loops are serial and in a fixed order. Inner ones run along contiguous rows and never sum along
them, so that they vectorise without changing the order of any sum.
"""

import numpy as np
from numba import njit
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from arm_brachy.core.errors import NotConverged
from arm_brachy.tissue.kernels import add_dyads, write_blocks
from arm_brachy.tissue.material import (
    NEO_HOOKE,
    inverse_transpose,
    stress,
    stress_kernel,
    tangent_vectors,
)


@njit(cache=True, error_model='numpy')
def deform(F0, Bt, y, F):
    """Write F = F0 + B y into `F` (s, 9)."""
    flat = F.reshape(-1)
    flat[:] = F0.reshape(-1)
    for j in range(y.shape[0]):
        row, scale = Bt[j], y[j]
        for k in range(flat.shape[0]):
            flat[k] += scale * row[k]


@njit(cache=True, error_model='numpy')
def potential(F, B, weights, mu, kappa, S, gradient):
    """Sum the stored energy and write its gradient sum_s weight B' P into `gradient` (w,).

    Returns (energy [J], smallest J); the energy is inf if a J is not positive.
    """
    energy, min_J = 0.0, np.inf
    inv_T, P = np.empty((3, 3)), np.empty((3, 3))
    gradient[:] = 0.0
    for s in range(weights.shape[0]):
        Fs = F[s].reshape(3, 3)
        J = inverse_transpose(Fs, inv_T)
        min_J = min(min_J, J)
        if not J > 0.0:
            energy = np.inf
            continue
        I1 = 0.0
        for i in range(9):
            I1 += F[s, i] * F[s, i]
        energy += stress_kernel(Fs, inv_T, J, I1, mu[s], kappa[s], 0.0, NEO_HOOKE, weights[s],
                                S[s], P)
        for i in range(9):
            pull, row = P[i // 3, i % 3], B[9 * s + i]
            for j in range(gradient.shape[0]):
                gradient[j] += pull * row[j]
    return energy, min_J


@njit(cache=True, error_model='numpy')
def stiffen(F, B, weights, mu, kappa, S, convex, AB):
    """Write weight (dP/dF) B into `AB` (9s, c); every J must be positive.

    B : (9s, c), any columns of it;  convex : as in `material.tangent_vectors`
    B' AB (`project`) is the tangent. The kernel of (3.24), given unit vectors for shape gradients,
    is dP/dF itself: its block (K, L) has the entries d P_iK / d F_jL.
    """
    unit, inv_T, vectors = np.eye(3), np.empty((3, 3)), np.empty((1, 6, 9))
    sums, blocks, A = np.empty((2, 9, 9)), np.empty((6, 3, 3)), np.empty((9, 9))
    swap, bundle = np.empty(1), np.empty(1)
    for s in range(weights.shape[0]):
        Fs = F[s].reshape(3, 3)
        J = inverse_transpose(Fs, inv_T)
        I1 = 0.0
        for i in range(9):
            I1 += F[s, i] * F[s, i]
        swap[0], bundle[0] = tangent_vectors(unit, Fs, inv_T, J, I1, mu[s], kappa[s], 0.0,
                                             NEO_HOOKE, weights[s], S[s], convex, vectors[0])
        add_dyads(3, 1, vectors, swap, bundle, sums)
        write_blocks(3, 1, unit.reshape(1, 3, 3), vectors, sums, blocks)
        block = 0
        for K in range(3):
            for L in range(K, 3):
                for i in range(3):
                    for j in range(3):
                        A[3 * i + K, 3 * j + L] = A[3 * j + L, 3 * i + K] = blocks[block, i, j]
                block += 1
        for p in range(9):
            _combine(A[p].reshape(3, 3), B[9 * s:9 * s + 9], AB[9 * s + p])


@njit(cache=True, error_model='numpy')
def _combine(factors, rows, out):
    """out (c,) = sum of nine rows (9, c) times factors (3, 3), in one pass."""
    a0, a1, a2 = factors[0, 0], factors[0, 1], factors[0, 2]
    a3, a4, a5 = factors[1, 0], factors[1, 1], factors[1, 2]
    a6, a7, a8 = factors[2, 0], factors[2, 1], factors[2, 2]
    for j in range(out.shape[0]):
        out[j] = (a0 * rows[0, j] + a1 * rows[1, j] + a2 * rows[2, j]
                  + a3 * rows[3, j] + a4 * rows[4, j] + a5 * rows[5, j]
                  + a6 * rows[6, j] + a7 * rows[7, j] + a8 * rows[8, j])


@njit(cache=True, error_model='numpy')
def project(B, AB, H):
    """Write B' AB into `H` (c, c), known to be symmetric: the upper triangle, and its mirror.

    B, AB : (9s, c). Not left to BLAS, whose sums depend on its number of threads.
    """
    c = H.shape[0]
    H[:] = 0.0
    for first in range(0, B.shape[0], 9):
        for i in range(c):
            left, right = B[first:first + 9, i], AB[first:first + 9]
            a0, a1, a2, a3, a4 = left[0], left[1], left[2], left[3], left[4]
            a5, a6, a7, a8 = left[5], left[6], left[7], left[8]
            for j in range(i, c):
                H[i, j] += (a0 * right[0, j] + a1 * right[1, j] + a2 * right[2, j]
                            + a3 * right[3, j] + a4 * right[4, j] + a5 * right[5, j]
                            + a6 * right[6, j] + a7 * right[7, j] + a8 * right[8, j])
    for i in range(c):
        for j in range(i):
            H[i, j] = H[j, i]


def point_stress(F, mu, kappa, S):
    """Return P + F S (..., s, 3, 3) [Pa] at F (..., s, 3, 3); mu, kappa, S as above."""
    return stress(F, mu, kappa) + F @ S


def material_tangents(F, mu, kappa, S):
    """Return dP/dF (s, 9, 9) [Pa] at F (s, 3, 3), rows and columns row by row of F.

    mu, kappa, S : as above
    """
    unit = np.tile(np.eye(9), (len(F), 1))
    out = np.empty_like(unit)
    stiffen(F.reshape(-1, 9), unit, np.ones(len(F)), mu, kappa, S, False, out)
    return out.reshape(-1, 9, 9)


def sampled_stiffness(F, B, weights, mu, kappa, S):
    """Return sum_s weight B' (dP/dF) B (w, w) [N/m] at F (s, 3, 3); the rest as above."""
    AB = np.empty_like(B)
    stiffen(F.reshape(-1, 9), B, weights, mu, kappa, S, False, AB)
    return B.T @ AB


def cubature(columns, total, tolerance, *, max_points=None):
    """Return (points (s,) ascending, factors (s,) > 0): columns[:, points] @ factors ~ total.

    columns : (rows, m) share of each of m candidates in each row;  total : (rows,) to be matched,
        usually columns.sum(axis=1), for which factors of 1 at every candidate would be exact
    tolerance : stop when the residual is below this fraction of |total|; at least 1e-6, since
        the normal equations know its square
    max_points : stop when so many are taken, whatever the residual; None = no limit
    Raises NotConverged if no candidate improves the fit any more and it is still above tolerance.

    Non-negative least squares by the active set of Lawson & Hanson (1974), chapter 23, stopped
    early, which is what makes it sparse (Chapman, Avery, Collins & Farhat 2017, Int J Numer Meth
    Engng 109:1623, algorithm 1). Serial choices, so equal arguments give equal points.
    """
    fit = _ActiveSet(columns, total)
    goal = (tolerance * np.linalg.norm(total)) ** 2
    while fit.squared_residual() > goal and len(fit.taken) != max_points:
        gain = fit.gain()
        gain[fit.taken] = -np.inf
        best = int(gain.argmax())
        if not gain[best] > 0.0:
            left = np.sqrt(max(0.0, fit.squared_residual())) / np.linalg.norm(total)
            raise NotConverged(f'cubature stopped at {len(fit.taken)} points with a residual of '
                               f'{left:.2g}; asked for {tolerance:g}; allow more')
        fit.take(best)
    order = np.argsort(fit.taken)
    return np.array(fit.taken, dtype=np.int64)[order], fit.factors[order]


class _ActiveSet:
    """Columns in use, their non-negative factors and their normal equations."""

    def __init__(self, columns, total):
        self.columns, self.taken, self.factors = columns, [], np.zeros(0)
        self._right, self._square = total @ columns, total @ total
        self._products = np.empty((0, columns.shape[1]))  # of columns taken with all

    def gain(self):
        """(m,) how fast the residual falls with each factor."""
        return self._right - self.factors @ self._products

    def squared_residual(self):
        """Of the present factors, which are the least squares of the columns taken."""
        return self._square - self.factors @ self._right[self.taken]

    def take(self, new):
        """Add a column and solve; columns whose factor would be negative are dropped."""
        column = np.ascontiguousarray(self.columns[:, new])
        self._products = np.vstack([self._products, column @ self.columns])
        self.taken.append(new)
        self.factors = np.append(self.factors, 0.0)
        while True:
            best = self._least_squares()
            negative = best <= 0.0
            if not negative.any():
                self.factors = best
                return
            at, to = self.factors[negative], best[negative]
            share = np.min(at / (at - to))  # as far as the first factor allows
            self.factors = self.factors + share * (best - self.factors)
            vanished = negative & (self.factors <= 1e-14 * self.factors.max(initial=1e-300))
            self._drop(np.flatnonzero(~vanished))

    def _drop(self, keep):
        self.taken = [self.taken[i] for i in keep]
        self.factors, self._products = self.factors[keep], self._products[keep]

    def _least_squares(self):
        normal = self._products[:, self.taken]
        scale = 1.0 / np.sqrt(np.diag(normal))
        try:
            factor = cho_factor(normal * scale[:, None] * scale, lower=True)
        except LinAlgError:
            raise NotConverged(f'cubature: {len(self.taken)} points depend on each other to '
                               'rounding; allow a larger residual or train on more states'
                               ) from None
        return scale * cho_solve(factor, scale * self._right[self.taken])
