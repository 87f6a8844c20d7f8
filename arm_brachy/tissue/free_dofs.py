"""Elimination of held nodes: the reduced matrix over the free degrees of freedom."""

import numpy as np

from arm_brachy.tissue.linear_solver import Pardiso


class FreeDofs:
    """What is left of an Assembler's equations when some nodes are held.

    assembler : Assembler;  held : node indices with prescribed positions (all three components)
    free : (f,) the other nodes, ascending;  dofs : (3f,) their rows in the full system
    diagonal : (3f,) positions of the diagonal entries in `upper`
    """

    def __init__(self, assembler, held):
        self.held = np.unique(np.asarray(held, dtype=np.int64))
        self.free = np.setdiff1d(np.arange(assembler.n), self.held)
        self.dofs = (3 * self.free[:, None] + np.arange(3)).ravel()
        indptr, indices = assembler.pattern
        number = np.full(3 * assembler.n, -1, dtype=np.int64)
        number[self.dofs] = np.arange(len(self.dofs))
        rows = np.repeat(number, np.diff(indptr))
        cols = number[indices]
        self._take = np.flatnonzero((rows >= 0) & (cols >= rows))
        self.indices = cols[self._take]
        self.indptr = np.searchsorted(rows[self._take], np.arange(len(self.dofs) + 1))
        self.diagonal = self.indptr[:-1]

    def upper(self, matrix):
        """Return the upper-triangle entries (nnz,) of the reduced matrix, as `solver` takes them.

        matrix : full (3n, 3n) matrix on the assembler's pattern (`Assembler.tangent`)
        """
        return matrix.data[self._take]

    def solver(self, *, positive_definite=True, single=False):
        """Return a Pardiso analysed for the reduced pattern.

        positive_definite, single : as in `Pardiso`
        """
        return Pardiso(self.indptr, self.indices, positive_definite=positive_definite,
                       single=single)


def held_nodes(body):
    """Return the nodes of a SoftBody with prescribed positions: fixed and pad nodes, sorted."""
    return np.unique(np.concatenate([np.asarray(body.fixed, dtype=np.int64),
                                     *(p.nodes for p in body.pads)]))


def moved_from_rest(body, pad_displacement, base=None):
    """Return the rest positions (n, 3) [m] of a SoftBody with held nodes where they are to be.

    pad_displacement : (p, 3) [m], rows as `body.pads`
    base : (3,) [m] displacement of the fixed nodes, None = they stay
    """
    x = body.mesh.nodes.copy()
    if base is not None:
        x[body.fixed] += base
    for pad, displacement in zip(body.pads, pad_displacement, strict=True):
        x[pad.nodes] += displacement
    return x
