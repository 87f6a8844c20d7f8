"""Hyperelastic law: energy, stress and tangent, in NumPy and in numba.

Psi = mu/2 (Ib - 3) + c (Ib - 3)^2 + k/2 (I4 - 1)^2 + kappa/2 (J - 1)^2,
J = det F,  Ib = J^(-2/3) tr(F' F),  I4 = |F a0|^2.

With c = k = 0 this is the compressible Neo-Hookean law (3.18), printed there with J = I3 / 2,
which would leave stress in the rest state; J = sqrt(I3) = det F here. c: second term of Yeoh 1993,
Rubber Chem Technol 66:754. k: standard fibre reinforcement in I4 itself, not its isochoric part,
which would give the wrong volume change under tension (Helfenstein et al. 2010, Int J Solids
Struct 47:2056); the fibres resist shortening as they resist stretch.
The NumPy functions are the readable reference; the kernels below them do the work.
"""

import numpy as np
from numba import njit

BEYOND = 5  # numbers that say how a law departs from Neo-Hooke: c, k [Pa], a0 (3,)
NEO_HOOKE = np.zeros(BEYOND)


def moduli(E, nu):
    """Return (mu, kappa) [Pa] from Young's modulus E [Pa] and Poisson's ratio nu (below 3.18)."""
    return E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu))


def energy(F, mu, kappa, beyond=NEO_HOOKE):
    """Return the stored energy per reference volume [J/m^3], (3.18) and what goes beyond it.

    F : (..., 3, 3), det F > 0;  mu, kappa : scalars or (...,) [Pa];  beyond : (..., BEYOND)
    """
    J, excess, beyond = np.linalg.det(F), _isochoric_invariant(F) - 3.0, np.asarray(beyond)
    along = np.sum(_fibre(F, beyond) ** 2, axis=-1)
    return (0.5 * mu * excess + beyond[..., 0] * excess**2
            + 0.5 * beyond[..., 1] * (along - 1.0) ** 2 + 0.5 * kappa * (J - 1.0) ** 2)


def stress(F, mu, kappa, beyond=NEO_HOOKE):
    """Return the first Piola-Kirchhoff stress P = dPsi/dF (..., 3, 3) [Pa].

    F : (..., 3, 3), det F > 0;  mu, kappa : scalars or (...,) [Pa];  beyond : (..., BEYOND)
    """
    J, beyond = np.linalg.det(F)[..., None, None], np.asarray(beyond)
    I1 = np.sum(F * F, axis=(-2, -1))[..., None, None]
    stiffened = mu + 4.0 * beyond[..., 0] * (_isochoric_invariant(F) - 3.0)
    inv_T = np.swapaxes(np.linalg.inv(F), -1, -2)
    d = _fibre(F, beyond)
    pull = 2.0 * beyond[..., 1] * (np.sum(d * d, axis=-1) - 1.0)
    return (np.asarray(stiffened)[..., None, None] * J ** (-2.0 / 3.0) * (F - I1 / 3.0 * inv_T)
            + np.asarray(kappa)[..., None, None] * J * (J - 1.0) * inv_T
            + pull[..., None, None] * d[..., :, None] * beyond[..., None, 2:])


def _isochoric_invariant(F):
    """J^(-2/3) tr(F' F) of F (..., 3, 3)."""
    return np.linalg.det(F) ** (-2.0 / 3.0) * np.sum(F * F, axis=(-2, -1))


def _fibre(F, beyond):
    """Fibres F a0 (..., 3); unit vectors wherever there are none."""
    none = beyond[..., 1, None] == 0.0
    return np.where(none, [1.0, 0.0, 0.0], np.einsum('...ij,...j->...i', F, beyond[..., 2:]))


def tangent(F, mu, kappa):
    """Return A = dvec(P)/dvec(F) (9, 9) [Pa] of the Neo-Hookean law, vec column by column.

    F : (3, 3), det F > 0;  mu, kappa : [Pa].  Entry 3 K + i of vec is F_iK.
    The bracket of (3.24) with four slips of the print put right: the coefficient of the identity
    is mu (not mu/3), the last kappa term is positive, the 4 mu/3 term is split so that A is
    symmetric, and J = det F. The printed form disagrees with finite differences of the stress.
    """
    J, I1 = np.linalg.det(F), np.sum(F * F)
    inv_T = np.linalg.inv(F).T
    f, g = F.ravel(order='F'), inv_T.ravel(order='F')
    scale = mu * J ** (-2.0 / 3.0)
    swap = np.eye(9).reshape(3, 3, 3, 3).transpose(0, 1, 3, 2).reshape(9, 9)  # Q of (3.24)
    return (scale * np.eye(9)
            + (scale * I1 / 3.0 - kappa * J * (J - 1.0)) * swap @ np.kron(inv_T, inv_T.T)
            - 2.0 / 3.0 * scale * (np.outer(g, f) + np.outer(f, g))
            + (2.0 / 9.0 * scale * I1 + kappa * J * (2.0 * J - 1.0)) * np.outer(g, g))


@njit(cache=True, error_model='numpy')
def inverse_transpose(F, out):
    """Write F^-T (3, 3) into `out` and return J = det F; `out` is meaningless if J is 0."""
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for k in range(3):
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            out[i, k] = F[i1, k1] * F[i2, k2] - F[i1, k2] * F[i2, k1]
    J = F[0, 0] * out[0, 0] + F[0, 1] * out[0, 1] + F[0, 2] * out[0, 2]
    inverse = 1.0 / J
    for i in range(3):
        for k in range(3):
            out[i, k] *= inverse
    return J


@njit(cache=True, error_model='numpy')
def stress_kernel(F, inv_T, J, I1, mu, kappa, shear, beyond, w, S, P):
    """Twin of `energy` and `stress`: write w (P(F) + F S) (3, 3) into `P`.

    inv_T, J : from `inverse_transpose`, J > 0;  I1 : tr(F' F);  w : [m^3] weight of the point
    shear : 0 switches `beyond` (BEYOND,) off, 1 leaves it
    S : (3, 3) added second Piola-Kirchhoff stress [Pa], held fixed
    Returns the energy [J], S : E with E = (F' F - I) / 2 included.
    """
    root = np.cbrt(J) ** -2
    excess, c, k4 = root * I1 - 3.0, shear * beyond[0], shear * beyond[1]
    scale = w * (mu + 4.0 * c * excess) * root
    pressure = w * kappa * J * (J - 1.0) - scale * I1 / 3.0
    added = w * (-S[0, 0] - S[1, 1] - S[2, 2])
    for i in range(3):
        for k in range(3):
            FS = w * (F[i, 0] * S[0, k] + F[i, 1] * S[1, k] + F[i, 2] * S[2, k])
            added += F[i, k] * FS
            P[i, k] = scale * F[i, k] + pressure * inv_T[i, k] + FS
    stored = w * ((mu + 2.0 * c * excess) * excess + kappa * (J - 1.0) ** 2)
    if k4 != 0.0:
        stretch = _along(F, beyond) - 1.0
        stored += w * k4 * stretch**2
        pull = 2.0 * w * k4 * stretch
        for i in range(3):
            d = F[i, 0] * beyond[2] + F[i, 1] * beyond[3] + F[i, 2] * beyond[4]
            for k in range(3):
                P[i, k] += pull * d * beyond[2 + k]
    return 0.5 * (stored + added)


@njit(cache=True, error_model='numpy')
def _along(F, beyond):
    """I4 = |F a0|^2."""
    total = 0.0
    for i in range(3):
        d = F[i, 0] * beyond[2] + F[i, 1] * beyond[3] + F[i, 2] * beyond[4]
        total += d * d
    return total


@njit(cache=True, error_model='numpy')
def tangent_vectors(G, F, inv_T, J, I1, mu, kappa, shear, beyond, w, S, convex, out):
    """Twin of `tangent`, contracted with shape gradients G (a, 3): what element stiffness sums.

    The derivative of force a by node b is, with g = F^-T G, h = F G and f = (G . a0) F a0,
        swap (g_b g_a') + g_a right_b' + h_a left_b' + bundle f_a f_b' + (G_a . load_b) I
    shear, w, S : as in `stress_kernel`
    convex : leave out the volumetric pressure's geometric part, kappa J (J - 1) d2J/dF2, which is
        indefinite and large where J is far from 1 (Gauss-Newton of kappa/2 (J - 1)^2)
    out : (6, 3a), written: g, h, right, left, load, f, node by node
    Returns (swap, bundle) [N m].
    """
    root, c, k4 = np.cbrt(J) ** -2, shear * beyond[0], shear * beyond[1]
    scale = w * (mu + 4.0 * c * (root * I1 - 3.0)) * root
    c_hh = 8.0 * w * c * root * root  # second derivative by the invariant
    pressure = 0.0 if convex else w * kappa * (J - 1.0)
    c_gh = -2.0 / 3.0 * scale - c_hh * I1 / 3.0
    c_gg = 2.0 / 9.0 * scale * I1 + (w * kappa * J + pressure) * J + c_hh * I1 * I1 / 9.0
    pull, d0, d1, d2 = 0.0, 0.0, 0.0, 0.0
    if k4 != 0.0:
        pull = 2.0 * w * k4 * (_along(F, beyond) - 1.0)
        d0 = F[0, 0] * beyond[2] + F[0, 1] * beyond[3] + F[0, 2] * beyond[4]
        d1 = F[1, 0] * beyond[2] + F[1, 1] * beyond[3] + F[1, 2] * beyond[4]
        d2 = F[2, 0] * beyond[2] + F[2, 1] * beyond[3] + F[2, 2] * beyond[4]
    for a in range(G.shape[0]):
        along = G[a, 0] * beyond[2] + G[a, 1] * beyond[3] + G[a, 2] * beyond[4]
        out[5, 3 * a], out[5, 3 * a + 1], out[5, 3 * a + 2] = along * d0, along * d1, along * d2
        for i in range(3):
            at = 3 * a + i
            g = inv_T[i, 0] * G[a, 0] + inv_T[i, 1] * G[a, 1] + inv_T[i, 2] * G[a, 2]
            h = F[i, 0] * G[a, 0] + F[i, 1] * G[a, 1] + F[i, 2] * G[a, 2]
            out[0, at], out[1, at] = g, h
            out[2, at] = c_gg * g + c_gh * h
            out[3, at] = c_gh * g + c_hh * h
            out[4, at] = (scale * G[a, i] + pull * along * beyond[2 + i]
                          + w * (S[i, 0] * G[a, 0] + S[i, 1] * G[a, 1] + S[i, 2] * G[a, 2]))
    return scale * I1 / 3.0 - pressure * J, 4.0 * w * k4
