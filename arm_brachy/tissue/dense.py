"""Products and solutions of dense matrices whose bits do not depend on BLAS, threads or memory.

Rows of A (k, n) are vectors over the degrees of freedom of a body; k is a few hundred at most.
"""

import numpy as np
from numba import njit

from arm_brachy.tissue.secants import dot


@njit(cache=True)
def products(A, b):
    """Return A b (k,) for A (k, n) and b (n,)."""
    out = np.empty(A.shape[0])
    for i in range(A.shape[0]):
        out[i] = dot(A[i], b)
    return out


@njit(cache=True)
def combination(A, rows, c):
    """Return the sum (n,) of rows (k,) of A (m, n), each c (k,) times."""
    out = np.zeros(A.shape[1])
    for i in range(len(rows)):
        if c[i] != 0.0:
            for j in range(len(out)):
                out[j] += c[i] * A[rows[i], j]
    return out


@njit(cache=True)
def product(A, B):
    """Return A B (k, m) for A (k, n), which may be mostly zero, and B (n, m)."""
    out = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            if A[i, j] != 0.0:
                a = A[i, j]
                for m in range(B.shape[1]):
                    out[i, m] += a * B[j, m]
    return out


@njit(cache=True, error_model='numpy')
def solve(A, B):
    """Return A^-1 B (k, m) for A (k, k), B (k, m): elimination with row pivoting.

    A singular matrix gives values that are not finite.
    """
    U, X, k = A.copy(), B.copy(), A.shape[0]
    for c in range(k):
        p = c + np.argmax(np.abs(U[c:, c]))
        if p != c:
            for j in range(k):
                U[c, j], U[p, j] = U[p, j], U[c, j]
            for j in range(X.shape[1]):
                X[c, j], X[p, j] = X[p, j], X[c, j]
        for i in range(c + 1, k):
            if U[i, c] != 0.0:
                f = U[i, c] / U[c, c]
                for j in range(c + 1, k):
                    U[i, j] -= f * U[c, j]
                for j in range(X.shape[1]):
                    X[i, j] -= f * X[c, j]
    for c in range(k - 1, -1, -1):
        for j in range(X.shape[1]):
            X[c, j] /= U[c, c]
        for i in range(c):
            if U[i, c] != 0.0:
                for j in range(X.shape[1]):
                    X[i, j] -= U[i, c] * X[c, j]
    return X
