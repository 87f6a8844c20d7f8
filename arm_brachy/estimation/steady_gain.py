"""The steady state of a Kalman filter: the discrete algebraic Riccati equation, by doubling.

    X = S (X - X C' (C X C' + R)^-1 C X) S' + Q

X is the covariance before the measurement. Doubling makes of X_k, after k steps from X_0 = 0, the
one after 2 k: log2 of the plain recursion's steps, and no eigenvalues. Source: Chu, Fan, Lin &
Wang 2004, Int J Control 77:767 (structure-preserving doubling algorithm).
Test: estimation/test_steady_gain.py (plain recursion, scipy, filterpy, closed form).
"""

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from arm_brachy.core.errors import NotConverged

TOLERANCE = 1e-12   # of the last change, relative: what is left is its square
MOST = 40           # doublings; 2^40 plain steps


def steady_covariance(S, C, Q, R):
    """Return X (n, n), the covariance before the measurement in the steady state, symmetric.

    S : (n, n) transition, its unobserved part stable;  C : (m, n);  Q : (n, n) and R : (m, m)
        covariances of process and measurement, R positive definite or a number times I
    Raises NotConverged where S lets an unobserved error grow.
    """
    A = np.asfortranarray(S.T, dtype=float)
    G, X = C.T @ np.linalg.solve(np.atleast_2d(R), C), np.asarray(Q, dtype=float)
    for _ in range(MOST):
        A, G, change = _double(A, G, X)
        X = symmetric(X + change)
        largest = max(X.max(), -X.min())
        if not np.isfinite(largest):
            break
        if max(change.max(), -change.min()) <= TOLERANCE * largest:
            return X
    raise NotConverged(f'steady covariance of {len(S)} states: not reached in 2^{MOST} steps; an '
                       'error that grows is not measured; see S and C')


def _double(A, G, X):
    """A and G of twice as many steps, and by how much X grows.

    In pieces that free each other's memory: with 2 k states a matrix has tens of megabytes.
    """
    M = (X @ G).T      # G X, in the order that LAPACK factors in place
    M[np.diag_indices(len(M))] += 1.0
    factor = lu_factor(M, overwrite_a=True, check_finite=False)
    WA = lu_solve(factor, A, check_finite=False)    # (I + G X)^-1 A
    change, A_next = A.T @ (X @ WA), A @ WA
    del WA
    added = lu_solve(factor, G, check_finite=False)
    del factor, M
    added = added @ A.T
    added = A @ added
    added += G
    return A_next, symmetric(added), change


def symmetric(X):
    """The symmetric part: rounding otherwise grows from step to step."""
    out = X + X.T
    out *= 0.5
    return out


def plain_step(X, S, C, Q, R):
    """One step of the covariance recursion (4.6)-(4.7), from before a measurement to the next."""
    gain = kalman_gain(X, C, R)
    return symmetric(S @ (X - gain @ C @ X) @ S.T + Q)


def kalman_gain(X, C, R):
    """K = X C' (C X C' + R)^-1, (4.7)."""
    return np.linalg.solve(symmetric(C @ X @ C.T) + R, C @ X).T
