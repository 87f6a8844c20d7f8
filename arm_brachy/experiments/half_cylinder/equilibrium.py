"""Newton's method for the equilibria of a body some of whose nodes are carried along.

Matrices are factorised by MKL as pypardiso calls it. An equilibrium is checked by its forces.
"""

import weakref

import numpy as np
from pypardiso import PyPardisoSolver
from scipy.sparse import csr_matrix

from arm_brachy.core.errors import NotConverged
from arm_brachy.experiments.half_cylinder.elements import NONE

MOST = 25           # iterations
LEFT = 2e-6         # N: no free node has more force left
THERE = 1e-12       # m: held nodes are where they should be
THIN = 0.03         # of its volume at rest: a point that is less is as good as inside out
INDEFINITE = -2     # MKL's number of real symmetric matrices


class Solver:
    """Equilibria of an elements.Body with the degrees of freedom `held` (h,) prescribed.

    Test: experiments/half_cylinder/test_equilibrium.py
    """

    def __init__(self, body, held):
        self._body, self._held = body, held
        self._free = np.setdiff1d(np.arange(body.size), held)
        self._matrix = _Matrix(self._blocks(), self._free, body.size)

    def _blocks(self):
        """Degrees of freedom of the tetrahedra, and of the ground under them if there is any."""
        ground = self._body.ground
        return [self._body.dofs, *([] if ground is None else [ground.dofs])]

    def solve(self, held, u, past=NONE):
        """Equilibrium (3 n,) near u (3 n,), its held displacements changed to `held` (h,) [m].

        The tangent at u carries the free nodes along with the held ones.
        past : elements.Past.  Raises NotConverged.
        """
        for _ in range(MOST):
            ahead = np.zeros(self._body.size)
            ahead[self._held] = held - u[self._held]
            forces = self._body.forces(u, past)
            left = np.abs(forces[self._free]).max()
            if left < LEFT and np.abs(ahead).max() < THERE:
                return u
            du = self._correction(u, past, forces, ahead)
            u = u + self._allowed(u, du) * du
        raise NotConverged(f'{left:.2g} N are left at a free node after {MOST} corrections; must '
                           f'be below {LEFT:g} N; go in shorter steps')

    def _correction(self, u, past, forces, ahead):
        """Newton's step (3 n,) from u, with its held part given by `ahead` (3 n,)."""
        tangents = [self._body.tangents(u, past)]
        if self._body.ground is not None:
            tangents.append(self._body.ground.tangents(u))
        right = forces + sum(
            self._body.gathered(dofs, np.matmul(each, ahead[dofs][..., None])[..., 0])
            for dofs, each in zip(self._blocks(), tangents, strict=True))
        du = ahead.copy()
        du[self._free] = -self._matrix.solve(tangents, right[self._free])
        return du

    def _allowed(self, u, du):
        """Largest of 1, 1/2, 1/4, ... of the step that leaves every point some volume."""
        length = 1.0
        while np.linalg.det(self._body.gradient(u + length * du)).min() <= THIN:
            length /= 2.0
            if length < 1e-3:
                raise NotConverged('no part of a correction leaves all tetrahedra some volume; '
                                   'start from an equilibrium')
        return length


class _Matrix:
    """The symmetric matrix of all elements, rows and columns of held unknowns left out.

    blocks : arrays (m, d) of the elements' degrees of freedom, of `size` in all
    free : (f,) those that are kept
    """

    def __init__(self, blocks, free, size):
        number = np.full(size, -1)
        number[free] = np.arange(len(free))
        keys, self._kept = [], []
        for dofs in blocks:
            rows, columns = np.broadcast_arrays(number[dofs][:, :, None], number[dofs][:, None])
            kept = (rows >= 0) & (rows <= columns)
            keys.append(rows[kept] * len(free) + columns[kept])
            self._kept.append(kept)
        unique, self._place = np.unique(np.concatenate(keys), return_inverse=True)
        starts = np.searchsorted(unique, np.arange(len(free) + 1) * len(free))
        self._upper = csr_matrix((np.zeros(len(unique)), unique % len(free), starts))
        self._solver = PyPardisoSolver(mtype=INDEFINITE)
        weakref.finalize(self, self._solver.free_memory, everything=True)   # MKL's, not Python's

    def solve(self, tangents, right):
        """Solution (f,) with elements' matrices (m, d, d), in the order of `blocks`."""
        values = np.concatenate([each[kept] for each, kept in zip(tangents, self._kept,
                                                                  strict=True)])
        self._upper.data[:] = np.bincount(self._place, values)
        return self._solver.solve(self._upper, right)
