"""The local step (3.14) of ADMM: each element's deformation gradient pulled towards its energy.

Minimises V Psi(z) + |z - Y|_W^2 / 2 over 3 x 3 matrices z, Psi the Neo-Hookean law (3.18) and W a
positive definite weight alpha I + beta n n' (n a unit vector among the nine components; beta = 0
is the scalar weight of the thesis), by Newton from the last z.

A matrix is nine components, row by row; arrays are (9, m), the element last, and the compiled
loops run over a group of elements innermost, so that the processor's vector units do several
elements at once. No sum crosses elements except in fixed chunks: equal arguments give equal bits
for any number of threads.
"""

import numpy as np
from numba import njit, prange

LANES = 64         # elements done together: their work arrays (76 kB) stay in the second cache
CHUNK = 2 * LANES  # elements of one task; fixed, because sums are grouped by it
MAX_NEWTON = 60
ARMIJO = 1e-4          # Nocedal & Wright (2006), sec. 3.1
FIRST_SHIFT = 0.1      # times alpha, then tenfold, until a Newton step descends
ROUNDING = 1e-13       # of an element's objective, relative to it plus V mu
# Rows of the work array, one column per lane: Hessian and factor (81), trial z, step, cofactor, z,
# Y and n (9 each); then one row each.
_H, _T, _D, _C, _Z, _Y, _N = 0, 81, 90, 99, 108, 117, 126
_ALPHA, _BETA, _MU, _KAPPA = 135, 136, 137, 138   # the moduli times V
_S, _P, _B, _M, _Q = 139, 140, 141, 142, 143      # scalars of one step
_F, _NEW, _SHIFT, _OPEN, _BAD = 144, 145, 146, 147, 148
_ROWS = 149


@njit(cache=True, error_model='numpy')
def _load(Y, z, n, lo, alpha, beta, V, mu, kappa, work):
    """Copy the elements from lo into the lanes; lanes past the end repeat the last element."""
    for q in range(LANES):
        e = min(lo + q, z.shape[1] - 1)
        for i in range(9):
            work[_Z + i, q], work[_Y + i, q], work[_N + i, q] = z[i, e], Y[i, e], n[i, e]
        work[_ALPHA, q], work[_BETA, q] = alpha[e], beta[e]
        work[_MU, q], work[_KAPPA, q] = V[e] * mu[e], V[e] * kappa[e]
        work[_SHIFT, q], work[_OPEN, q] = 0.0, 1.0


@njit(cache=True, error_model='numpy')
def _objective(z, work, out):
    """Row `out`: V Psi(z) + |z - Y|_W^2 / 2, inf where det z <= 0; z is the first row of one.

    Overwrites _S, _P and _Q.
    """
    for q in range(LANES):
        work[_S, q] = work[_P, q] = work[_Q, q] = 0.0
    for i in range(9):
        for q in range(LANES):
            d = work[z + i, q] - work[_Y + i, q]
            work[_S, q] += work[z + i, q] * work[z + i, q]
            work[_P, q] += d * d
            work[_Q, q] += work[_N + i, q] * d
    z0, z1, z2 = work[z:z + 3], work[z + 3:z + 6], work[z + 6:z + 9]
    for q in range(LANES):
        J = (z0[0, q] * (z1[1, q] * z2[2, q] - z1[2, q] * z2[1, q])
             + z0[1, q] * (z1[2, q] * z2[0, q] - z1[0, q] * z2[2, q])
             + z0[2, q] * (z1[0, q] * z2[1, q] - z1[1, q] * z2[0, q]))
        energy = (work[_MU, q] * (np.cbrt(J) ** -2 * work[_S, q] - 3.0)
                  + work[_KAPPA, q] * (J - 1.0) ** 2)
        tie = work[_ALPHA, q] * work[_P, q] + work[_BETA, q] * work[_Q, q] ** 2
        work[out, q] = 0.5 * (energy + tie) if J > 0.0 else np.inf


@njit(cache=True, error_model='numpy')
def _scalars(work):
    """Cofactor of z, and what stress and tangent need: stress is _S z + _P cof z (times V)."""
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for k in range(3):
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            for q in range(LANES):
                work[_C + 3 * i + k, q] = (
                    work[_Z + 3 * i1 + k1, q] * work[_Z + 3 * i2 + k2, q]
                    - work[_Z + 3 * i1 + k2, q] * work[_Z + 3 * i2 + k1, q])
    for q in range(LANES):
        work[_Q, q] = work[_S, q] = 0.0
    for i in range(9):
        for q in range(LANES):
            work[_S, q] += work[_Z + i, q] * work[_Z + i, q]
            work[_Q, q] += work[_N + i, q] * (work[_Z + i, q] - work[_Y + i, q])
    for q in range(LANES):
        I1 = work[_S, q]
        J = (work[_Z, q] * work[_C, q] + work[_Z + 1, q] * work[_C + 1, q]
             + work[_Z + 2, q] * work[_C + 2, q])
        s = work[_MU, q] * np.cbrt(J) ** -2
        work[_S, q] = s
        work[_P, q] = work[_KAPPA, q] * (J - 1.0) - s * I1 / (3.0 * J)
        work[_B, q] = work[_KAPPA, q] + 5.0 / 9.0 * s * I1 / (J * J)
        work[_M, q] = -2.0 / 3.0 * s / J


@njit(cache=True, error_model='numpy')
def _newton_system(work):
    """Minus the gradient into _D and _T, the shifted Hessian (lower triangle) into _H."""
    for i in range(9):
        for q in range(LANES):
            work[_D + i, q] = -(work[_S, q] * work[_Z + i, q] + work[_P, q] * work[_C + i, q]
                                + work[_ALPHA, q] * (work[_Z + i, q] - work[_Y + i, q])
                                + work[_BETA, q] * work[_Q, q] * work[_N + i, q])
            work[_T + i, q] = work[_D + i, q]
        for j in range(i + 1):
            for q in range(LANES):
                work[_H + 9 * i + j, q] = (
                    work[_B, q] * work[_C + i, q] * work[_C + j, q]
                    + work[_M, q] * (work[_C + i, q] * work[_Z + j, q]
                                     + work[_Z + i, q] * work[_C + j, q])
                    + work[_BETA, q] * work[_N + i, q] * work[_N + j, q])
        for q in range(LANES):
            work[_H + 10 * i, q] += work[_S, q] + work[_ALPHA, q] + work[_SHIFT, q]
    # derivative of the cofactor: entries (i a), (j b) with i != j, a != b hold +- z_kc
    for i in range(1, 3):
        for j in range(i):
            for a in range(3):
                for b in range(3):
                    if a != b:
                        row = 3 * (3 - i - j) + 3 - a - b
                        sign = 1.0 if (j - i) % 3 == (b - a) % 3 else -1.0
                        for q in range(LANES):
                            work[_H + 9 * (3 * i + a) + 3 * j + b, q] += (
                                sign * work[_P, q] * work[_Z + row, q])


@njit(cache=True, error_model='numpy')
def _solve(work):
    """_D becomes the Newton step by H = L D L'; _BAD is 1 where a pivot is not positive."""
    for q in range(LANES):
        work[_BAD, q] = 0.0
    for j in range(9):
        for i in range(j, 9):  # below the diagonal L D, above it L'; two products per pass
            a, b = _H + 9 * i, _H + j
            for k in range(0, j - 1, 2):
                for q in range(LANES):
                    work[a + j, q] -= (work[a + k, q] * work[b + 9 * k, q]
                                       + work[a + k + 1, q] * work[b + 9 * k + 9, q])
            for k in range(j - j % 2, j):
                for q in range(LANES):
                    work[a + j, q] -= work[a + k, q] * work[b + 9 * k, q]
        for q in range(LANES):
            pivot = work[_H + 10 * j, q]
            work[_BAD, q] = work[_BAD, q] if pivot > 0.0 else 1.0
            work[_H + 10 * j, q] = 1.0 / pivot
        for i in range(j + 1, 9):
            for q in range(LANES):
                work[_H + 9 * j + i, q] = work[_H + 9 * i + j, q] * work[_H + 10 * j, q]
    for i in range(9):
        for k in range(i):
            for q in range(LANES):
                work[_D + i, q] -= work[_H + 9 * k + i, q] * work[_D + k, q]
    for i in range(8, -1, -1):
        for q in range(LANES):
            work[_D + i, q] *= work[_H + 10 * i, q]
        for k in range(i + 1, 9):
            for q in range(LANES):
                work[_D + i, q] -= work[_H + 9 * i + k, q] * work[_D + k, q]


@njit(cache=True, error_model='numpy')
def _advance(tolerance, work):
    """Take the steps that descend, shift the Hessian of the others; returns the lanes not done."""
    for q in range(LANES):
        work[_B, q] = work[_M, q] = 0.0
    for i in range(9):
        for q in range(LANES):
            step = work[_D + i, q]
            work[_B, q] -= step * work[_T + i, q]  # slope; _T holds minus the gradient
            work[_M, q] = max(work[_M, q], abs(step))
            work[_T + i, q] = work[_Z + i, q] + step
    _objective(_T, work, _NEW)
    left = 0
    for q in range(LANES):
        if work[_OPEN, q] == 0.0:
            continue
        limit = (work[_F, q] + ARMIJO * work[_B, q]
                 + ROUNDING * (work[_F, q] + work[_MU, q]))
        if work[_BAD, q] == 0.0 and work[_NEW, q] <= limit:
            for i in range(9):
                work[_Z + i, q] = work[_T + i, q]
            work[_F, q] = work[_NEW, q]
            if work[_SHIFT, q] == 0.0 and work[_M, q] <= tolerance:
                work[_OPEN, q] = 0.0
            work[_SHIFT, q] = 0.0
        else:
            work[_SHIFT, q] = max(10.0 * work[_SHIFT, q], FIRST_SHIFT * work[_ALPHA, q])
        left += 1 if work[_OPEN, q] > 0.0 else 0
    return left


@njit(cache=True, error_model='numpy')
def _minimise(tolerance, work):
    """Newton on all lanes from _Z; returns the sweeps made, MAX_NEWTON if not all ended.

    A step that does not descend, or a Hessian that is not positive definite, leaves z and adds a
    multiple of the identity (Levenberg-Marquardt).
    """
    _objective(_Z, work, _F)
    for sweep in range(1, MAX_NEWTON):
        _scalars(work)
        _newton_system(work)
        _solve(work)
        if _advance(tolerance, work) == 0:
            return sweep
    return MAX_NEWTON


@njit(cache=True, parallel=True, error_model='numpy')
def local_step(Y, z, u, n, alpha, beta, V, mu, kappa, tolerance, sweeps):
    """(3.12)-(3.13) for every element: z the minimiser of (3.14), u = Y - z.

    Y, n : (9, m);  z, u : (9, m), updated in place;  alpha, beta : (m,) [J]
    V : (m,) [m^3];  mu, kappa : (m,) [Pa];  tolerance : last Newton step, absolute
    sweeps : (chunks,) gets the largest number of Newton steps; MAX_NEWTON = stopped short
    """
    m = z.shape[1]
    for chunk in prange((m + CHUNK - 1) // CHUNK):
        work = np.empty((_ROWS, LANES))
        sweeps[chunk] = 0
        for lo in range(chunk * CHUNK, min(m, (chunk + 1) * CHUNK), LANES):
            _load(Y, z, n, lo, alpha, beta, V, mu, kappa, work)
            sweeps[chunk] = max(sweeps[chunk], _minimise(tolerance, work))
            for q in range(min(LANES, m - lo)):
                for i in range(9):
                    z[i, lo + q] = work[_Z + i, q]
                    u[i, lo + q] = Y[i, lo + q] - work[_Z + i, q]
