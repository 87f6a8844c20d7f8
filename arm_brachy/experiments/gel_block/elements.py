"""A block of bricks with quadratic Lagrange shape functions (27 nodes): energy, forces, tangent.

Shape functions and quadrature are scikit-fem's; nothing is shared with arm_brachy.tissue.
"""

import numpy as np
from skfem import Basis, ElementHex2, FacetBasis, LinearForm, MeshHex

DEGREE = 5              # that the quadrature is exact for: 27 points an element
BATCH = 64              # elements worked on together: what fits a processor's cache
GROUND = 2e8            # Pa/m: gives way by 5 um under 1 kPa
NEAR = 1e-9             # m: on a plane


@LinearForm
def _shape(v, w):
    return v


class Block:
    """A block of graded bricks, its lower face on rigid ground.

    lines : x, y, z of the planes between bricks, three increasing arrays [m]
    law : law.Law;  stiffness : points (n, 3) [m] -> factor (n,) on its moduli, or None
    loose : centres (n, 3) of brick faces on the ground -> (n,) bool, those that are not glued but
        lie on the ground, without friction; None = all are glued
    Nodal vectors are flat, (3 n,): x y z of node 0, then of node 1.
    nodes : (n, 3) [m];  glued : indices of the nodes that cannot move
    Test: experiments/gel_block/test_elements.py
    """

    def __init__(self, lines, law, *, stiffness=None, loose=None):
        self._mesh = MeshHex.init_tensor(*lines)
        self._basis = Basis(self._mesh, ElementHex2(), intorder=DEGREE)
        self._cells = self._basis.element_dofs.T
        self.nodes = np.ascontiguousarray(self._basis.doflocs.T)
        self.dofs = (3 * self._cells[:, :, None] + np.arange(3)).reshape(len(self._cells), -1)
        gradients = [self._basis.basis[a][0].grad for a in range(self._basis.Nbfun)]
        self._gradients = np.ascontiguousarray(np.stack(gradients).transpose(2, 3, 0, 1))
        self._weights = self._basis.dx
        self._law = law.scaled(np.ones(self._weights.shape) if stiffness is None
                               else self._at_points(stiffness))
        self.glued, self._loose, self._ground = self._on_ground(loose)

    def _at_points(self, stiffness):
        at = np.asarray(self._basis.global_coordinates())
        return stiffness(at.reshape(3, -1).T).reshape(self._weights.shape)

    def _on_ground(self, loose):
        """Nodes that are glued, nodes that rest, and the stiffness under each of these [N/m]."""
        low = self.nodes[:, 2].min()
        ground = self._mesh.facets_satisfying(lambda x: np.abs(x[2] - low) < NEAR, True)
        off = np.zeros(len(ground), bool)
        if loose is not None:
            off = loose(self._mesh.p[:, self._mesh.facets[:, ground]].mean(axis=1).T)
        held, lying = (self._nodes_of(some) for some in (ground[~off], ground[off]))
        free = np.setdiff1d(lying, held)
        if not len(free):
            return held, free, np.zeros(0)
        faces = FacetBasis(self._mesh, ElementHex2(), facets=ground[off], intorder=DEGREE)
        return held, free, GROUND * _shape.assemble(faces)[free]

    def _nodes_of(self, facets):
        return self._basis.get_dofs(facets=facets).flatten() if len(facets) else np.zeros(0, int)

    @property
    def size(self):
        """Length of a nodal vector."""
        return 3 * len(self.nodes)

    def volume_ratio(self, u):
        """Least det F of all points of quadrature at displacements u; <= 0 is inside out."""
        return float(np.linalg.det(self._gradient(u, slice(None))).min())

    def energy(self, u):
        """Elastic energy and that of the ground at displacements u (3 n,) [m], [J]."""
        held = 0.5 * self._ground @ np.minimum(u[3 * self._loose + 2], 0.0) ** 2
        return float((self._weights * self._law.energy(self._gradient(u, slice(None)))).sum()
                     + held)

    def forces(self, u):
        """Derivative of `energy`, (3 n,) [N]: what holds the nodes at displacements u."""
        P = self._law.stress(self._gradient(u, slice(None)))
        P *= self._weights[..., None, None]
        each = np.einsum('eqiJ,eqaJ->eai', P, self._gradients, optimize=True)
        out = self.gathered(each.reshape(len(self._cells), -1))
        up = 3 * self._loose + 2
        out[up] += self._ground * np.minimum(u[up], 0.0)
        return out

    def tangents(self, u):
        """Derivative of `forces`: matrices of bricks (e, 81, 81), the ground's diagonal (3 n,)."""
        each = np.empty((*self.dofs.shape, self.dofs.shape[1]))
        for start in range(0, len(each), BATCH):
            each[start:start + BATCH] = self._tangents(u, slice(start, start + BATCH))
        up = 3 * self._loose + 2
        ground = np.zeros(self.size)
        ground[up] = np.where(u[up] < 0.0, self._ground, 0.0)
        return each, ground

    def _tangents(self, u, part):
        """Bricks' matrices G_aJ A_iJkL G_bL as two products, (J) (i b k) after (J i k) (L)."""
        G, A = self._gradients[part], self._part_of_law(part).tangent(self._gradient(u, part))
        A *= self._weights[part][..., None, None, None, None]
        e, q, shapes = G.shape[:3]
        inner = np.matmul(A.transpose(0, 1, 3, 2, 4, 5).reshape(e, q, 27, 3),
                          np.swapaxes(G, -1, -2)).reshape(e, q, 3, 3, 3, shapes)
        inner = inner.transpose(0, 1, 2, 3, 5, 4).reshape(e, 3 * q, 9 * shapes)
        outer = G.transpose(0, 2, 1, 3).reshape(e, shapes, 3 * q)
        return np.matmul(outer, inner).reshape(e, 3 * shapes, 3 * shapes)

    def _part_of_law(self, part):
        return type(self._law)(self._law.shear[part], self._law.bulk[part], self._law.stiffening)

    def gathered(self, each):
        """Sum over bricks of their nodal values (e, 81); returns (3 n,)."""
        return np.bincount(self.dofs.ravel(), each.ravel(), minlength=self.size)

    def _gradient(self, u, part):
        """F (e, q, 3, 3) of bricks `part`."""
        moved = u.reshape(-1, 3)[self._cells[part]]
        return np.eye(3) + np.einsum('eai,eqaJ->eqiJ', moved, self._gradients[part],
                                     optimize=True)

    def probe(self, points):
        """Matrix (k, n) from values at nodes to values at points (k, 3) [m] of the block."""
        middle = 0.5 * (self.nodes.min(axis=0) + self.nodes.max(axis=0))
        inside = middle + (points - middle) * (1.0 - 1e-9)     # a search fails on the surface
        return self._basis.probes(inside.T)
