"""Sparse symmetric matrices of fixed pattern: places of element entries, factors by PARDISO."""
import numpy as np
from pypardiso import PyPardisoSolver
from scipy.sparse import csr_matrix


class Pattern:
    """Upper triangle of the matrix of elements with degrees of freedom `dofs` (m, d), n in all.

    where (m, d, d) int32: place of entry (i, j), j >= i, of every element among the entries.
    """

    def __init__(self, dofs, n):
        m, d = dofs.shape
        i, j = np.triu_indices(d)
        low = np.minimum(dofs[:, i], dofs[:, j])
        keys = low * n + np.maximum(dofs[:, i], dofs[:, j])
        kept, inverse = np.unique(keys, return_inverse=True)
        self.where = np.full((m, d, d), -1, np.int32)
        self.where[:, i, j] = inverse.reshape(m, -1)
        self.n = n
        self.rows = (kept // n).astype(np.int32)
        self.columns = (kept % n).astype(np.int32)
        self.indptr = np.searchsorted(self.rows, np.arange(n + 1)).astype(np.int32)
        self._keys = kept
        self.diagonal = np.searchsorted(kept, np.arange(n) * (n + 1))

    def find(self, rows, columns):
        """Places of the entries at `rows` (k,) and `columns` (k,), rows <= columns."""
        return np.searchsorted(self._keys, rows.astype(np.int64) * self.n + columns)

    def held(self, data, fixed):
        """Entries with the rows and columns of `fixed` (n,) bool replaced by the identity's."""
        data = np.where(fixed[self.rows] | fixed[self.columns], 0.0, data)
        data[self.diagonal[fixed]] = 1.0
        return data

    def matrix(self, data):
        """Upper triangle (n, n) with entries `data`."""
        return csr_matrix((data, self.columns, self.indptr), (self.n, self.n))


def times(upper, x):
    """Product of the symmetric matrix with upper triangle `upper` and x (n,)."""
    return upper @ x + upper.T @ x - upper.diagonal() * x


class Factor:
    """L D L^T of a symmetric matrix given by its upper triangle, rows scaled to unit diagonal."""

    def __init__(self, upper):
        self.scale = 1 / np.sqrt(np.abs(upper.diagonal()))
        rows = np.repeat(np.arange(upper.shape[0]), np.diff(upper.indptr))
        scaled = upper.data * self.scale[rows] * self.scale[upper.indices]
        self._matrix = csr_matrix((scaled, upper.indices, upper.indptr), upper.shape)
        self._solver = PyPardisoSolver(mtype=-2)
        self._solver.set_phase(12)
        self._solver._call_pardiso(self._matrix, np.zeros((upper.shape[0], 1)))

    def solve(self, b):
        """Solution (n,) for the right-hand side b (n,)."""
        self._solver.set_phase(33)
        return self.scale * self._solver._call_pardiso(self._matrix, self.scale * b)

    def __del__(self):
        self._solver.set_phase(-1)
        self._solver._call_pardiso(self._matrix, np.zeros((self._matrix.shape[0], 1)))
