"""How hard ADMM ties the elements' matrices z to the nodes: the weights W of (3.9).

Per element W = alpha I + beta n n' over the nine components of z, n a unit vector.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Weights:
    """alpha, beta : (m,) [J], beta >= 0;  n : (9, m) unit vectors, components row by row."""

    alpha: np.ndarray
    beta: np.ndarray
    n: np.ndarray

    def apply(self, t):
        """Return W t for t (9, m)."""
        return self.alpha * t + self.beta * np.sum(self.n * t, axis=0) * self.n

    def solve(self, t):
        """Return W^-1 t for t (9, m) (Sherman-Morrison)."""
        along = np.sum(self.n * t, axis=0) * self.beta / (self.alpha + self.beta)
        return (t - along * self.n) / self.alpha


def published_weights(V, kappa, c):
    """Return the scalar Weights of the thesis, w_i^2 = c kappa_i V_i.

    V, kappa : (m,) [m^3], [Pa];  c : 1 is the usual choice (Overby et al. 2017, sec. 5.2)
    """
    n = np.zeros((9, len(V)))
    n[0] = 1.0
    return Weights(c * kappa * V, np.zeros(len(V)), n)


def curvature_weights(z, V, mu, kappa, c, least):
    """Return Weights of c times the size of the energy's curvature at z.

    z : (9, m), det z > 0;  V, mu, kappa : (m,);  c : > 0
    least : smallest curvature assumed across n, times mu
    With P = s z + p C, C = cof z, the second derivative of Psi is s I + p dC/dz plus outer
    products of C and z. Along n = C / |C|, the direction in which volume changes, it is
        -3 s + 2 p J I1 / |C|^2 + (kappa + 5 s I1 / (9 J^2)) |C|^2,
    and across n the products with C drop out and at most s + |p| tau is left. For singular values
    a, b, c of z, dC/dz has eigenvalues +-a, +-b, +-c and those of [[0 c b] [c 0 a] [b a 0]], whose
    smallest, -tau, is at or below the others' (tau = 1 at rest, where the sum is 2 mu exactly); it
    solves tau^3 - I1 tau + 2 J = 0, and what n leaves of that matrix lies within +-tau: its trace
    is negative and no eigenvalue is below -tau. A scalar weight must serve along and across, which
    are a hundred times apart for nu = 0.495.
    """
    C, J, I1, s, p = _stress_parts(z, mu, kappa)
    size = np.sum(C * C, axis=0)
    across = np.maximum(s + np.abs(p) * _largest_root(I1, J), least * mu)
    along = -3.0 * s + 2.0 * p * J * I1 / size + (kappa + 5.0 / 9.0 * s * I1 / J**2) * size
    return Weights(c * V * across, c * V * np.maximum(along - across, 0.0), C / np.sqrt(size))


def elastic_stress(z, mu, kappa):
    """Return dPsi/dF (9, m) [Pa] at z (9, m), mu, kappa (m,) [Pa]; NaN where det z <= 0.

    Twin of `material.stress` for the arrays of this solver.
    """
    C, _, _, s, p = _stress_parts(z, mu, kappa)
    return s * z + p * C


def _stress_parts(z, mu, kappa):
    """Cofactor C (9, m), J (NaN if not positive), I1, and s, p of the stress s z + p C."""
    C = np.empty_like(z)
    for i in range(3):
        for k in range(3):
            i1, i2, k1, k2 = (i + 1) % 3, (i + 2) % 3, (k + 1) % 3, (k + 2) % 3
            C[3 * i + k] = z[3 * i1 + k1] * z[3 * i2 + k2] - z[3 * i1 + k2] * z[3 * i2 + k1]
    J = z[0] * C[0] + z[1] * C[1] + z[2] * C[2]
    J = np.where(J > 0.0, J, np.nan)
    I1 = np.sum(z * z, axis=0)
    s = mu * np.cbrt(J) ** -2
    return C, J, I1, s, kappa * (J - 1.0) - s * I1 / (3.0 * J)


def _largest_root(I1, J):
    """Of tau^3 - I1 tau + 2 J = 0, J > 0, by Viete's trigonometric formula."""
    radius = np.sqrt(I1 / 3.0)
    third = np.arccos(np.clip(J / radius**3, -1.0, 1.0)) / 3.0
    return 2.0 * radius * np.cos(third - np.pi / 3.0)
