"""How the material turns around each node: what carries an old factor along with a moving body."""

import numpy as np
from numba import njit
from scipy.sparse import coo_array, csr_array

from arm_brachy.tissue.material import inverse_transpose

POLAR_STEPS = 5  # from a stretch of 1.5 to rounding


def mean_gradient(body, nodes):
    """Return the sparse (3k, n) matrix that takes positions (n, 3) to F' of `nodes` (k,).

    The mean over the elements around a node, weighted by volume.
    """
    geometry, n = body.geometry, len(body.mesh.nodes)
    conn, volume = geometry.connectivity, geometry.weights.sum(axis=1)
    a = conn.shape[1]
    slopes = np.einsum('mq,mqaj->maj', geometry.weights, geometry.gradients)
    rows, cols = np.repeat(conn, a, axis=1).ravel(), np.tile(conn, (1, a)).ravel()
    around = np.bincount(conn.ravel(), np.repeat(volume, a), minlength=n)
    parts = [coo_array((np.tile(slopes[:, :, j], (1, a)).ravel() / around[rows],
                        (3 * rows + j, cols)), shape=(3 * n, n)) for j in range(3)]
    keep = (3 * nodes[:, None] + np.arange(3)).ravel()
    return csr_array(sum(part.tocsr() for part in parts))[keep]


@njit(cache=True, error_model='numpy')
def polar(F):
    """Return the rotations (n, 3, 3) of F (n, 3, 3) = R U, det F > 0.

    Newton's iteration, R <- (R + R^-T) / 2; valid for stretches within a factor of two or so.
    Source: Higham 1986, SIAM J Sci Stat Comput 7:1160.
    """
    R, inv_T = F.copy(), np.empty((3, 3))
    for i in range(R.shape[0]):
        for _ in range(POLAR_STEPS):
            inverse_transpose(R[i], inv_T)
            for j in range(3):
                for k in range(3):
                    R[i, j, k] = 0.5 * (R[i, j, k] + inv_T[j, k])
    return R
