"""Newton's method for the equilibria of a block some of whose nodes are carried along.

The sparse factorisation is MKL's, through the module that the tissue's model uses too.
"""

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.tissue.linear_solver import Pardiso

MOST = 14           # iterations
SMALL = 1e-6        # m: the last correction of any node is less
LEFT = 2e-5         # N: no free node has more force left
THIN = 0.02         # of its volume at rest: a point that is less is as good as inside out
SHORTENED = 3       # corrections that may be cut short before a shorter way is tried
HALVINGS = 3        # of the way


class Solver:
    """Equilibria of an elements.Block with the degrees of freedom `held` prescribed.

    held : (h,) indices into a nodal vector
    """

    def __init__(self, block, held):
        self._block, self._held = block, held
        self._free = np.setdiff1d(np.arange(block.size), held)
        number = np.full(block.size, -1)
        number[self._free] = np.arange(len(self._free))
        self._pattern = _Pattern(number[block.dofs], len(self._free))
        self._factor = Pardiso(self._pattern.indptr, self._pattern.indices,
                               positive_definite=False)
        self.iterations = 0

    def along(self, begin, end, u, *, halvings=HALVINGS):
        """Equilibrium (3 n,) with the held displacements `end` (h,) [m].

        u : that with held displacements `begin`. Where Newton's method fails, it goes half way
        first. Raises NotConverged if even an eighth of the way is too far.
        """
        try:
            return self.solve(end, u)
        except NotConverged:
            if not halvings:
                raise
        middle = 0.5 * (begin + end)
        u = self.along(begin, middle, u, halvings=halvings - 1)
        return self.along(middle, end, u, halvings=halvings - 1)

    def solve(self, held, u):
        """Equilibrium (3 n,) near u (3 n,), its held displacements changed to `held` (h,) [m].

        The tangent at u carries the free nodes along with the held ones. Raises NotConverged.
        """
        shortened = 0
        for _ in range(MOST):
            ahead = np.zeros_like(u)
            ahead[self._held] = held - u[self._held]
            du = self._correction(u, ahead)
            length = self._allowed(u, du)
            shortened += length < 1.0
            if shortened > SHORTENED:
                raise NotConverged(f'{shortened} of {self.iterations} corrections turned bricks '
                                   f'inside out; at most {SHORTENED} may; go in shorter steps')
            u = u + length * du
            if np.abs(du).max() < SMALL and length == 1.0:
                return self._checked(u)
        raise NotConverged(f'the last of {MOST} corrections moves a node by '
                           f'{1e3 * np.abs(du).max():.2g} mm; must be below {1e3 * SMALL:g} mm; '
                           'go in shorter steps')

    def _correction(self, u, ahead):
        """Newton's step (3 n,) from u, with its held part given by `ahead` (3 n,)."""
        self.iterations += 1
        each, ground = self._block.tangents(u)
        carried = np.matmul(each, ahead[self._block.dofs][..., None])[..., 0]
        right = self._block.forces(u) + self._block.gathered(carried)
        self._factor.factor(self._pattern.summed(each, ground[self._free]))
        du = ahead.copy()
        du[self._free] = -self._factor.solve(right[self._free])
        return du

    def _allowed(self, u, du):
        """Largest of 1, 1/2, 1/4, ... of the step that leaves every point some volume."""
        length = 1.0
        while self._block.volume_ratio(u + length * du) <= THIN:
            length /= 2.0
            if length < 1e-6:
                raise NotConverged('no part of a correction leaves all bricks some volume; start '
                                   'from an equilibrium')
        return length

    def _checked(self, u):
        left = np.abs(self._block.forces(u)[self._free]).max()
        if left > LEFT:
            raise NotConverged(f'{left:.2g} N are left at a free node; must be below {LEFT:g} N; '
                               'go in shorter steps')
        return u


class _Pattern:
    """Upper triangle of the matrix of all bricks, rows and columns of held unknowns left out."""

    def __init__(self, dofs, size):
        """dofs : (e, d) numbers among the free unknowns, -1 = held;  size : how many are free."""
        rows, columns = (np.broadcast_to(some, (*dofs.shape, dofs.shape[1])).ravel()
                         for some in (dofs[:, :, None], dofs[:, None, :]))
        self._kept = np.flatnonzero((rows >= 0) & (rows <= columns))
        keys, self._place = np.unique(rows[self._kept] * size + columns[self._kept],
                                      return_inverse=True)
        self.indptr = np.searchsorted(keys, np.arange(size + 1) * size)
        self.indices = keys % size

    def summed(self, each, diagonal):
        """Entries of the sum of bricks' matrices (e, d, d) and a diagonal (size,)."""
        data = np.bincount(self._place, each.ravel()[self._kept], minlength=len(self.indices))
        data[self.indptr[:-1]] += diagonal
        return data
