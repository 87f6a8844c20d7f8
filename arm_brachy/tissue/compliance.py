"""How far nodes give way under forces: the inverse tangent, kept while the body changes slowly.

H = A^-1 + W' M W,   W = [S; Z],   M = [[R^-T (D + Y Z') R^-1, -R^-T], [-R^-1, 0]]

A is the tangent as last factorised; S and Y are the rows of steps and of the changes of force
along them seen since, Z those of A^-1 Y, R the upper triangle of S Y' and D its diagonal: BFGS
updates of an inverse in closed form (Byrd, Nocedal & Schnabel 1994, Math Program 63:129, eq. 2.6).
The columns of A^-1 that belong to single nodes are kept too, so that the flexibility between the
few nodes that something touches costs no further back-solve.
"""

import numpy as np

from arm_brachy.tissue import dense
from arm_brachy.tissue.secants import FLATTEST, dot

# Pairs kept: more say little of a tangent that has gone on changing.
PAIRS = 12


class Compliance:
    """Inverse tangent of a body with held nodes; `factorise` first.

    free : free_dofs.FreeDofs. Forces and displacements are (3f,) over its free nodes.
    """

    def __init__(self, free):
        self.free = free
        self._solver = free.solver(single=True)
        self._place = np.full(int(max(free.free.max(initial=-1), free.held.max(initial=-1))) + 1,
                              -1, dtype=np.int64)
        self._place[free.free] = np.arange(len(free.free))
        self.version = 0    # counts tangents
        self._forget()

    def _forget(self):
        size = len(self.free.dofs)
        self._row = np.full(len(self.free.free), -1, dtype=np.int64)
        self._columns, self._kept = np.zeros((0, size)), 0
        self._S, self._Y, self._Z = (np.zeros((0, size)) for _ in range(3))
        self._W, self._M = np.zeros((0, size)), np.zeros((0, 0))

    @property
    def ready(self):
        """True once a tangent is factorised."""
        return self._solver.factorised

    def factorise(self, tangent):
        """Take in a new tangent (3n, 3n) [N/m]; raises FactorisationFailed as `Pardiso.factor`."""
        self._forget()
        self.version += 1
        self._solver.factor(self.free.upper(tangent))

    def raw(self, force):
        """Return A^-1 force (3f,) [m] for a force (3f,) [N], or (3f, m) for m of them."""
        return self._solver.solve(force)

    def updated(self, force, raw):
        """Return H force (3f,) [m], given raw = A^-1 force."""
        if not len(self._S):
            return raw
        return raw + dense.combination(self._W, np.arange(len(self._W)), dense.products(
            self._M, self._with(force, raw)))

    def _with(self, force, raw):
        """[S force; Z force] with Z force taken as Y A^-1 force."""
        return np.concatenate([dense.products(self._S, force), dense.products(self._Y, raw)])

    def learn(self, step, change, raw):
        """Take in a step (3f,) [m], the change of force (3f,) [N] along it, and A^-1 change."""
        if dot(step, change) <= FLATTEST * np.sqrt(dot(step, step) * dot(change, change)):
            return
        self._S, self._Y, self._Z = (np.vstack([old, new])[-PAIRS:] for old, new in (
            (self._S, step), (self._Y, change), (self._Z, raw)))
        self._W = np.vstack([self._S, self._Z])
        SY = np.array([dense.products(self._Y, s) for s in self._S])
        YZ = np.array([dense.products(self._Z, y) for y in self._Y])
        inverse = dense.solve(np.triu(SY), np.eye(len(SY)))
        corner = inverse.T @ (np.diag(np.diag(SY)) + 0.5 * (YZ + YZ.T)) @ inverse
        self._M = np.block([[corner, -inverse.T], [-inverse, np.zeros_like(inverse)]])

    def among(self, nodes):
        """Return H (3k, 3k) [m/N] between nodes (k,); held ones have zero rows and columns."""
        there = self._place[nodes] >= 0
        dofs = (3 * self._place[nodes][there][:, None] + np.arange(3)).ravel()
        rows = self._rows(nodes[there])
        block = self._columns[np.ix_(rows, dofs)]
        if len(self._S):
            W = np.ascontiguousarray(self._W[:, dofs])
            block = block + dense.product(np.ascontiguousarray(W.T), dense.product(self._M, W))
        out = np.zeros((3 * len(nodes), 3 * len(nodes)))
        at = np.flatnonzero(np.repeat(there, 3))
        out[np.ix_(at, at)] = 0.5 * (block + block.T)
        return out

    def between(self, loads, raw):
        """Return H (m, m) [m/N] between loads (m, 3f), given raw (m, 3f) = A^-1 of each."""
        dofs = np.flatnonzero(loads.any(axis=0))     # loads act on few nodes
        loads = np.ascontiguousarray(loads[:, dofs].T)
        block = dense.product(np.ascontiguousarray(raw[:, dofs]), loads)
        if len(self._S):
            rows = dense.product(np.ascontiguousarray(self._W[:, dofs]), loads)
            block = block + dense.product(np.ascontiguousarray(rows.T),
                                          dense.product(self._M, rows))
        return 0.5 * (block + block.T)

    def of_nodes(self, nodes, force):
        """Return forces (k, 3) [N] on nodes (k,) as a vector (3f,), and A^-1 of it."""
        there = self._place[nodes] >= 0
        rows = self._rows(nodes[there])
        raw = dense.combination(self._columns, rows, force[there].ravel())
        whole = np.zeros(len(raw))
        whole[(3 * self._place[nodes][there][:, None] + np.arange(3)).ravel()] = force[
            there].ravel()
        return whole, raw

    def _rows(self, nodes):
        """Rows of `_columns` of free nodes (k,), three each; back-solved where they are new."""
        at = self._place[nodes]
        new = np.unique(at[self._row[at] < 0])
        if len(new):
            self._row[new] = self._kept // 3 + np.arange(len(new))
            unit = np.zeros((len(self.free.dofs), 3 * len(new)))
            unit[(3 * new[:, None] + np.arange(3)).ravel(), np.arange(3 * len(new))] = 1.0
            self._kept += unit.shape[1]
            if self._kept > len(self._columns):     # room for half as many again
                room = np.empty((self._kept + self._kept // 2, len(unit)))
                room[:self._kept - unit.shape[1]] = self._columns[:self._kept - unit.shape[1]]
                self._columns = room
            self._columns[self._kept - unit.shape[1]:self._kept] = self._solver.solve(unit).T
        return (3 * self._row[at][:, None] + np.arange(3)).ravel()
