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
    A = np.array(S.T, dtype=float, order='F')
    G, X = C.T @ np.linalg.solve(np.atleast_2d(R), C), np.array(Q, dtype=float)
    for _ in range(MOST):
        A, G, change = _double(A, G, X)
        X = symmetric(X + change)
        if not np.isfinite(X).all():
            break
        if np.abs(change).max() <= TOLERANCE * np.abs(X).max():
            return X
    raise NotConverged(f'steady covariance of {len(S)} states: not reached in 2^{MOST} steps; an '
                       'error that grows is not measured; see S and C')


def _double(A, G, X):
    """A and G of twice as many steps, and by how much X grows."""
    factor = lu_factor(np.eye(len(A)) + G @ X, check_finite=False)
    V = lu_solve(factor, np.hstack([A, G]), check_finite=False)
    WA, WG = V[:, :len(A)], V[:, len(A):]     # (I + G X)^-1 A and (I + G X)^-1 G
    return A @ WA, symmetric(G + A @ WG @ A.T), A.T @ X @ WA


def symmetric(X):
    """The symmetric part: rounding otherwise grows from step to step."""
    return 0.5 * (X + X.T)


def plain_step(X, S, C, Q, R):
    """One step of the covariance recursion (4.6)-(4.7), from before a measurement to the next."""
    gain = kalman_gain(X, C, R)
    return symmetric(S @ (X - gain @ C @ X) @ S.T + Q)


def kalman_gain(X, C, R):
    """K = X C' (C X C' + R)^-1, (4.7)."""
    return np.linalg.solve(symmetric(C @ X @ C.T) + R, C @ X).T
