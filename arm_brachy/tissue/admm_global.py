"""The global step (3.11) of ADMM: one symmetric system, factorised when the weights change.

Its matrix is M / dt^2 + sum_i D_i' (W_i + V_i S_i) D_i plus ground springs: the added stress S of
the fields is quadratic in x, so it belongs here and not to the local step.
"""

import numpy as np
from numba import njit, prange

from arm_brachy.tissue import kernels
from arm_brachy.tissue.linear_solver import Pardiso


@njit(cache=True, parallel=True, error_model='numpy')
def _blocks(G, n, alpha, beta, V, S, out):
    """Write D_i' (W_i + V_i S_i) D_i (m, 12, 12) [N/m] of every element into `out`."""
    stressed = S.shape[0] > 0
    for e in prange(G.shape[0]):
        g = np.empty((4, 3))  # n G_a
        for a in range(4):
            for i in range(3):
                g[a, i] = (n[3 * i, e] * G[e, a, 0] + n[3 * i + 1, e] * G[e, a, 1]
                           + n[3 * i + 2, e] * G[e, a, 2])
        for a in range(4):
            for b in range(4):
                same = 0.0
                for k in range(3):
                    same += alpha[e] * G[e, a, k] * G[e, b, k]
                for k in range(3 if stressed else 0):
                    SG = (S[e, k, 0] * G[e, b, 0] + S[e, k, 1] * G[e, b, 1]
                          + S[e, k, 2] * G[e, b, 2])
                    same += V[e] * G[e, a, k] * SG
                for i in range(3):
                    for j in range(3):
                        value = beta[e] * g[a, i] * g[b, j]
                        out[e, 3 * a + i, 3 * b + j] = value + (same if i == j else 0.0)


class GlobalStep:
    """The matrix of (3.11) over the free degrees of freedom.

    body : SoftBody of linear tetrahedra;  conn : (m, 4);  G : (m, 4, 3) [1/m];  V : (m,) [m^3]
    free : (f,) nodes not held
    Not to be shared between threads.
    """

    def __init__(self, body, conn, G, V, free):
        self._G, self._V, self.free = G, V, free
        number = np.full((len(body.mesh.nodes), 3), -1)
        number[free] = np.arange(3 * len(free)).reshape(-1, 3)
        dofs = number[conn].reshape(len(conn), 12)
        rows, cols = np.repeat(dofs, 12, axis=1).ravel(), np.tile(dofs, (1, 12)).ravel()
        size = 3 * len(free)
        diagonal, spring_keys, self._springs = _constants(body.springs, number, size)
        wanted = np.flatnonzero((rows >= 0) & (cols >= rows))
        keys = rows[wanted] * size + cols[wanted]
        unique, which = np.unique(np.concatenate([keys, diagonal, spring_keys]),
                                  return_inverse=True)
        which = which[:len(keys)]
        order = np.argsort(which, kind='stable')
        self._slots = wanted[order]
        self._start = np.searchsorted(which[order], np.arange(len(unique) + 1))
        self._diagonal = np.searchsorted(unique, diagonal)
        self._spring_at = np.searchsorted(unique, spring_keys)
        self._blocks = np.empty((len(conn), 12, 12))
        self._data = np.empty((len(unique), 1))
        indptr = np.searchsorted(unique // max(size, 1), np.arange(size + 1))
        self._solver = Pardiso(indptr, unique % max(size, 1))

    def factor(self, weights, stress, inertia):
        """Factorise for Weights, added stress (m, 3, 3) or (0, 3, 3) [Pa], inertia (n,) [N/m].

        Raises FactorisationFailed where the matrix is not positive definite: loose body, or a
        compressive added stress beyond what the weights carry.
        """
        _blocks(self._G, weights.n, weights.alpha, weights.beta, self._V, stress, self._blocks)
        kernels.gather(self._start, self._slots, self._blocks.reshape(-1, 1), self._data)
        data = self._data[:, 0]
        data[self._diagonal] += np.repeat(inertia[self.free], 3)
        np.add.at(data, self._spring_at, self._springs)
        self._solver.factor(data)

    def solve(self, force):
        """Return the displacements (f, 3) [m] of the free nodes under force (n, 3) [N]."""
        return self._solver.solve(force[self.free].ravel()).reshape(-1, 3)


def _constants(springs, number, size):
    """Keys of the diagonal and of the upper triangle of free nodes' springs, and their values."""
    dofs = number[springs.nodes]
    rows, cols = np.repeat(dofs, 3, axis=1).ravel(), np.tile(dofs, (1, 3)).ravel()
    upper = (rows >= 0) & (cols >= rows)
    return (np.arange(size) * (size + 1), rows[upper] * size + cols[upper],
            springs.stiffness.ravel()[upper])
