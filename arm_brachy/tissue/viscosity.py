"""Kelvin-Voigt stress: what resists the rate of deformation, and nothing a rigid motion."""

import numpy as np
from numba import njit, prange

from arm_brachy.tissue.kernels import CHUNK, deformation_gradient
from arm_brachy.tissue.material import inverse_transpose


@njit(cache=True, parallel=True, error_model='numpy')
def viscous_stress(x, v, conn, G, shear, bulk, before, out):
    """Write `before` (m, q, 3, 3) plus 2 shear dev E' + bulk J' J C^-1 into `out`.

    x, v : (n, 3) positions, velocities;  conn : (m, a);  G : (m, q, a, 3) shape gradients
    shear, bulk : (m, q) [Pa s] viscosities. Of no use where det F <= 0.
    """
    m = conn.shape[0]
    for chunk in prange((m + CHUNK - 1) // CHUNK):
        F, dF, inv_T = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
        for e in range(chunk * CHUNK, min(m, (chunk + 1) * CHUNK)):
            for q in range(G.shape[1]):
                deformation_gradient(x, conn[e], G[e, q], F)
                deformation_gradient(v, conn[e], G[e, q], dF)
                J = inverse_transpose(F, inv_T)
                growth, trace = 0.0, 0.0  # J' / J, tr E'
                for i in range(3):
                    for j in range(3):
                        growth += inv_T[i, j] * dF[i, j]
                        trace += F[i, j] * dF[i, j]
                for i in range(3):
                    for j in range(3):
                        twice_rate, inverse = 0.0, 0.0  # 2 E', C^-1
                        for k in range(3):
                            twice_rate += F[k, i] * dF[k, j] + dF[k, i] * F[k, j]
                            inverse += inv_T[k, i] * inv_T[k, j]
                        out[e, q, i, j] = (before[e, q, i, j] + shear[e, q] * twice_rate
                                           + bulk[e, q] * growth * J * J * inverse)
                    out[e, q, i, i] -= 2.0 / 3.0 * shear[e, q] * trace
