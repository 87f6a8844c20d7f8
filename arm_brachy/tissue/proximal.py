"""The local step (3.14) of ADMM: each element's deformation gradient pulled towards its energy.

Minimises V Psi(z) + w^2/2 |z - Y|^2 over 3 x 3 matrices z, Psi the Neo-Hookean law (3.18) with
J = det z. Both terms depend on rotations only through Y's, so the minimiser shares Y's singular
vectors and three singular values remain to be found (Overby et al., IEEE Trans. Vis. Comput.
Graph. 23(10), 2017, sec. 4).
"""

import numpy as np
from numba import njit, prange

from arm_brachy.tissue.kernels import CHUNK, deformation_gradient

SMALLEST_START = 0.1   # singular value an inverted or flat Y starts from
LAST_STEP = 1e-7        # a full Newton step this small squares its error: below rounding after it
MAX_NEWTON = 60
MAX_HALVINGS = 40
MAX_SWEEPS = 30
VANISHING = 1e-9  # singular value, relative to 1, whose left vector rounding has eaten


@njit(cache=True, error_model='numpy')
def _eigenvectors(A, V):
    """Diagonalise symmetric A (3, 3) in place by cyclic Jacobi rotations; V gets the vectors."""
    for i in range(3):
        for k in range(3):
            V[i, k] = 1.0 if i == k else 0.0
    for _ in range(MAX_SWEEPS):
        if abs(A[0, 1]) + abs(A[0, 2]) + abs(A[1, 2]) == 0.0:
            return
        for p in range(2):
            for q in range(p + 1, 3):
                # below rounding of the diagonal the entry is done with
                if abs(A[p, q]) <= 1e-17 * (abs(A[p, p]) + abs(A[q, q])):
                    A[p, q] = A[q, p] = 0.0
                    continue
                theta = 0.5 * (A[q, q] - A[p, p]) / A[p, q]
                t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                t = -t if theta < 0.0 else t
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(3):
                    a, b = A[k, p], A[k, q]
                    A[k, p], A[k, q] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = A[p, k], A[q, k]
                    A[p, k], A[q, k] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = V[k, p], V[k, q]
                    V[k, p], V[k, q] = c * a - s * b, s * a + c * b


@njit(cache=True, error_model='numpy')
def rotation_svd(Y, U, y, V, A):
    """Y = U diag(y) V' with U and V rotations; y falls in size and y[2] carries the sign of det Y.

    Y, U, V : (3, 3);  y : (3,);  A : (3, 3) work space. Accuracy eps times the squared condition.
    """
    for i in range(3):
        for k in range(3):
            A[i, k] = Y[0, i] * Y[0, k] + Y[1, i] * Y[1, k] + Y[2, i] * Y[2, k]
    _eigenvectors(A, V)
    for i in range(2):  # largest first
        for k in range(2 - i):
            if A[k, k] < A[k + 1, k + 1]:
                A[k, k], A[k + 1, k + 1] = A[k + 1, k + 1], A[k, k]
                for r in range(3):
                    V[r, k], V[r, k + 1] = V[r, k + 1], V[r, k]
    _third_column(V)
    for k in range(2):
        for i in range(3):
            U[i, k] = Y[i, 0] * V[0, k] + Y[i, 1] * V[1, k] + Y[i, 2] * V[2, k]
        if k == 1:
            along = U[0, 0] * U[0, 1] + U[1, 0] * U[1, 1] + U[2, 0] * U[2, 1]
            for i in range(3):
                U[i, 1] -= along * U[i, 0]
        _normalise(U, k)
    _third_column(U)
    for k in range(3):
        y[k] = 0.0
        for i in range(3):
            y[k] += U[i, k] * (Y[i, 0] * V[0, k] + Y[i, 1] * V[1, k] + Y[i, 2] * V[2, k])


@njit(cache=True, error_model='numpy')
def _normalise(U, k):
    """Make column k a unit vector; a vanishing one becomes some unit vector normal to column 0."""
    length = np.sqrt(U[0, k] ** 2 + U[1, k] ** 2 + U[2, k] ** 2)
    if not length > VANISHING:
        if k == 0:
            U[0, 0], U[1, 0], U[2, 0] = 1.0, 0.0, 0.0
            return
        axis = 0
        for i in range(1, 3):
            axis = i if abs(U[i, 0]) < abs(U[axis, 0]) else axis
        along = U[axis, 0]
        for i in range(3):
            U[i, 1] = (1.0 if i == axis else 0.0) - along * U[i, 0]
        length = np.sqrt(1.0 - along * along)
    for i in range(3):
        U[i, k] /= length


@njit(cache=True, error_model='numpy')
def _third_column(R):
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        R[i, 2] = R[j, 0] * R[k, 1] - R[k, 0] * R[j, 1]


@njit(cache=True, error_model='numpy')
def _objective(s, y, a_mu, a_kappa):
    J = s[0] * s[1] * s[2]
    I1 = s[0] ** 2 + s[1] ** 2 + s[2] ** 2
    pull = (s[0] - y[0]) ** 2 + (s[1] - y[1]) ** 2 + (s[2] - y[2]) ** 2
    return 0.5 * (a_mu * (np.cbrt(J) ** -2 * I1 - 3.0) + a_kappa * (J - 1.0) ** 2 + pull)


@njit(cache=True, error_model='numpy')
def _derivatives(s, y, a_mu, a_kappa, g, H):
    """Gradient g (3,) and Hessian H (3, 3) of `_objective`."""
    J = s[0] * s[1] * s[2]
    I1 = s[0] ** 2 + s[1] ** 2 + s[2] ** 2
    c = a_mu * np.cbrt(J) ** -2
    p = a_kappa * J * (J - 1.0)
    for i in range(3):
        g[i] = c * (s[i] - I1 / (3.0 * s[i])) + p / s[i] + s[i] - y[i]
        for j in range(3):
            H[i, j] = (-2.0 / 3.0 * c * (s[i] / s[j] + s[j] / s[i])
                       + (2.0 / 9.0 * c * I1 + a_kappa * J * (2.0 * J - 1.0)) / (s[i] * s[j]))
        H[i, i] += 1.0 + c + (c * I1 / 3.0 - p) / s[i] ** 2


@njit(cache=True, error_model='numpy')
def _cholesky_step(H, shift, g, step):
    """Solve (H + shift I) step = -g; returns False if the matrix is not positive definite."""
    l00 = H[0, 0] + shift
    if not l00 > 0.0:
        return False
    l00 = np.sqrt(l00)
    l10, l20 = H[1, 0] / l00, H[2, 0] / l00
    l11 = H[1, 1] + shift - l10 * l10
    if not l11 > 0.0:
        return False
    l11 = np.sqrt(l11)
    l21 = (H[2, 1] - l20 * l10) / l11
    l22 = H[2, 2] + shift - l20 * l20 - l21 * l21
    if not l22 > 0.0:
        return False
    l22 = np.sqrt(l22)
    a = -g[0] / l00
    b = (-g[1] - l10 * a) / l11
    step[2] = (-g[2] - l20 * a - l21 * b) / (l22 * l22)
    step[1] = (b - l21 * step[2]) / l11
    step[0] = (a - l10 * step[1] - l20 * step[2]) / l00
    return True


@njit(cache=True, error_model='numpy')
def singular_values(y, a_mu, a_kappa, s, g, H, step, trial):
    """Minimise over s > 0 the energy of (3.14) in singular values, by safeguarded Newton.

    y : (3,) singular values of Y;  a_mu, a_kappa : V mu / w^2 and V kappa / w^2
    s : (3,) gets the minimiser;  g, step, trial : (3,), H : (3, 3) work space
    Returns the Newton iterations used; MAX_NEWTON says that it stopped short.
    """
    for i in range(3):
        s[i] = max(y[i], SMALLEST_START)
    value = _objective(s, y, a_mu, a_kappa)
    for iteration in range(1, MAX_NEWTON):
        _derivatives(s, y, a_mu, a_kappa, g, H)
        shift = 0.0
        while not _cholesky_step(H, shift, g, step):
            shift = max(4.0 * shift, 1e-3 * (abs(H[0, 0]) + abs(H[1, 1]) + abs(H[2, 2])))
        if max(abs(step[0]), abs(step[1]), abs(step[2])) <= LAST_STEP:
            for i in range(3):
                s[i] += step[i]
            return iteration
        slope = g[0] * step[0] + g[1] * step[1] + g[2] * step[2]
        length = 1.0
        for _ in range(MAX_HALVINGS):
            for i in range(3):
                trial[i] = s[i] + length * step[i]
            if min(trial[0], trial[1], trial[2]) > 0.0:
                new = _objective(trial, y, a_mu, a_kappa)
                if new <= value + 1e-4 * length * slope:
                    break
            length *= 0.5
        else:
            return iteration  # no decrease left at rounding level
        for i in range(3):
            s[i] = trial[i]
        value = new
    return MAX_NEWTON


@njit(cache=True, parallel=True, error_model='numpy')
def local_step(x, conn, G, V, mu, kappa, w2, z, u, parts):
    """(3.14) for every element, and what the next global step (3.11) needs of it.

    x : (n, 3) [m];  conn : (m, 4);  G : (m, 4, 3) shape gradients [1/m];  V : (m,) [m^3]
    mu, kappa : (m,) [Pa];  w2 : (m,) w_i^2 [J]
    z, u : (m, 3, 3) deformation gradients and scaled multipliers, updated in place
    parts : (m, 4, 3) [N] gets w_i^2 D_i' (z_i - u_i)
    """
    m = conn.shape[0]
    for chunk in prange((m + CHUNK - 1) // CHUNK):
        Y, U, R = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
        A, y, s = np.empty((3, 3)), np.empty(3), np.empty(3)
        g, step, trial = np.empty(3), np.empty(3), np.empty(3)
        for e in range(chunk * CHUNK, min(m, (chunk + 1) * CHUNK)):
            deformation_gradient(x, conn[e], G[e], Y)
            for i in range(3):
                for k in range(3):
                    Y[i, k] += u[e, i, k]
            rotation_svd(Y, U, y, R, A)
            scale = V[e] / w2[e]
            singular_values(y, scale * mu[e], scale * kappa[e], s, g, A, step, trial)
            for i in range(3):
                for k in range(3):
                    z[e, i, k] = (U[i, 0] * s[0] * R[k, 0] + U[i, 1] * s[1] * R[k, 1]
                                  + U[i, 2] * s[2] * R[k, 2])
                    u[e, i, k] = Y[i, k] - z[e, i, k]
            _pull(G[e], w2[e], z[e], u[e], parts[e])


@njit(cache=True, error_model='numpy')
def _pull(G, w2, z, u, out):
    for a in range(4):
        for i in range(3):
            value = 0.0
            for k in range(3):
                value += (z[i, k] - u[i, k]) * G[a, k]
            out[a, i] = w2 * value


@njit(cache=True, parallel=True, error_model='numpy')
def pulls(G, w2, z, u, parts):
    """Write w_i^2 D_i' (z_i - u_i) (m, 4, 3) [N] into `parts`; arguments as in `local_step`."""
    for e in prange(G.shape[0]):
        _pull(G[e], w2[e], z[e], u[e], parts[e])
