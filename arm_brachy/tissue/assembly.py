"""Energy, forces and tangent of a whole body, on a sparsity pattern made once."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.tissue import kernels
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.element import point_moduli
from arm_brachy.tissue.pattern import block_columns
from arm_brachy.tissue.supports import SupportForces


class InvertedElement(ArmBrachyError):
    """Forces or tangent asked for in a state with det F <= 0 somewhere."""


@dataclass(frozen=True)
class Evaluation:
    """The body in one state.

    energy : total potential [J], inf if an element is inverted
    forces : (n, 3) [N] as `Assembler.forces`, without the inverted elements' share
    min_J : smallest det F;  worst : the element it is found in
    """

    energy: float
    forces: np.ndarray
    min_J: float
    worst: int


class Assembler:
    """Sums element contributions of a SoftBody over all its nodes, supports not yet applied.

    Total potential, x the node positions and X those at rest:
        Pi(x) = sum_e V_e (Psi(F_e) + S_e : E_e) + 1/2 sum_s w_s' k_s w_s - f . u + `supports`
    with u = x - X, w = u less the displacement of the base, and f the nodal force of the step
    plus gravity on tissue and carried masses (dead loads).
    Results are identical to the last bit for any number of threads.
    """

    def __init__(self, body):
        self.body = body
        self.geometry = body.geometry
        self.n = len(body.mesh.nodes)
        self._weight = (self.heavy_mass(body.density, body.nodal_mass)[:, None]
                        * np.asarray(body.gravity, dtype=float))
        conn = self.geometry.connectivity
        self._node_start, self._node_slots = _grouped(conn.ravel(), self.n)
        self._make_pattern(conn)
        m, a = conn.shape
        self._energy, self._J = np.zeros(m), np.zeros(m)
        self._force = np.zeros((m, a, 3))
        self._stiffness = np.zeros((m, a * (a + 1) // 2, 3, 3))
        shape = a, self.geometry.weights.shape[1]
        self._element_forces = kernels.element_forces(*shape)
        self._element_stiffness = kernels.element_stiffness(*shape)

    def _make_pattern(self, conn):
        """CSR pattern of 3 x 3 node blocks, and for each block the element blocks it sums."""
        keys = (conn[:, :, None] * self.n + conn[:, None, :]).ravel()
        diagonal = np.arange(self.n) * (self.n + 1)  # there even for a node without elements
        keys = np.concatenate([keys, diagonal])
        order = np.argsort(keys, kind='stable')  # the one sort; it groups the blocks as well
        first = np.flatnonzero(np.diff(keys[order], prepend=-1))
        unique, count = keys[order[first]], len(keys) - self.n
        within = order < count
        self._block_slots = _upper_slots(*conn.shape)[order[within]]
        self._block_start = np.concatenate([[0], np.cumsum(np.add.reduceat(within, first))])
        rows, cols = np.divmod(unique, self.n)
        self._row_blocks = np.searchsorted(rows, np.arange(self.n + 1))
        self._indptr, self._indices = _expand(self._row_blocks, cols)
        at = np.searchsorted(unique, diagonal[self.body.springs.nodes])
        self._spring_entries = _entries(self._row_blocks, at, self.body.springs.nodes)
        supports = self.body.supports
        self._supports = SupportForces(supports, block_columns(self.pattern, supports.nodes),
                                       self._indptr)

    def lumped_mass(self):
        """Return (n,) [kg]: tissue mass by `ElementGeometry.lumping`, plus nodal_mass."""
        return self._nodal(np.outer(self.element_mass(), self.geometry.lumping),
                           self.body.nodal_mass)

    def element_mass(self):
        """Return (m,) [kg]."""
        return self.body.density * self.geometry.weights.sum(axis=1)

    def heavy_mass(self, density, nodal_mass=None):
        """Return (n,) [kg] that gravity pulls on: integral of rho N_a, plus nodal_mass (n,).

        density : (m,) [kg/m^3]. Negative at the corners of quadratic elements, as it should be:
        not the lumped mass of dynamics.
        """
        share = np.einsum('m,mq,qa->ma', density, self.geometry.weights, self.geometry.shape)
        return self._nodal(share, nodal_mass)

    def _nodal(self, share, carried):
        mass = np.bincount(self.geometry.connectivity.ravel(), share.ravel(), minlength=self.n)
        return mass if carried is None else mass + carried

    def evaluate(self, x, fields=None):
        """Return the Evaluation at node positions x (n, 3) [m]; never raises on inversion.

        fields : StepFields of the step; None = `StepFields.of(body)`
        """
        fields = StepFields.of(self.body) if fields is None else fields
        x = np.ascontiguousarray(x, dtype=float)
        self._element_forces(x, *self._integrands(fields), self._energy, self._force, self._J)
        forces = np.empty((self.n, 3))
        kernels.gather(self._node_start, self._node_slots, self._force.reshape(-1, 3), forces)
        u = x - self.body.mesh.nodes
        springs = self.body.springs
        stretch = u[springs.nodes] - fields.base
        spring_force = np.einsum('sij,sj->si', springs.stiffness, stretch)
        forces[springs.nodes] += spring_force
        load = fields.nodal_force + self._weight
        energy = (self._energy.sum() - np.sum(load * u) + 0.5 * np.sum(spring_force * stretch)
                  + self._supports.add_forces(u, fields.base, forces))
        worst = int(self._J.argmin())
        return Evaluation(float(energy), forces - load, float(self._J[worst]), worst)

    def element_forces(self, x, fields):
        """Return the forces (m, a, 3) [N] of every element alone, without springs and loads.

        x, fields : as in `evaluate`
        """
        energy, force, J = (np.empty_like(v) for v in (self._energy, self._force, self._J))
        self._element_forces(x, *self._integrands(fields), energy, force, J)
        return force

    def reference(self, fields):
        """Return shape gradients (m, q, a, 3) and weights (m, q) of the stress-free shape.

        fields : StepFields; a swollen body has a larger one than its mesh
        """
        g, grown = self.geometry, fields.swelling
        if grown == 1.0:
            return g.gradients, g.point_weights
        return g.gradients / grown, g.point_weights * grown**3

    def _integrands(self, fields):
        """What the element loops integrate."""
        g = self.geometry
        return (g.connectivity, *self.reference(fields), *point_moduli(g, fields), g.shear,
                fields.beyond, fields.stress)

    def energy(self, x, fields=None):
        """Return the total potential [J] at x (n, 3) [m]; inf if an element is inverted.

        fields : as in `evaluate`
        """
        return self.evaluate(x, fields).energy

    def forces(self, x, fields=None):
        """Return dPi/dx (n, 3) [N]: what must be applied from outside to hold each node at x.

        x : (n, 3) [m];  fields : as in `evaluate`
        Zero at the free nodes in equilibrium; at held nodes, the force of the support on the
        tissue. Raises InvertedElement.
        """
        state = self.evaluate(x, fields)
        if not state.min_J > 0.0:
            raise InvertedElement(f'element {state.worst} has det F = {state.min_J:.3g}; must be '
                                  'positive; push less far or in smaller steps')
        return state.forces

    def tangent(self, x, fields=None, *, convex=False):
        """Return d forces / d x as a sparse symmetric (3n, 3n) matrix [N/m], rows 3 node + axis.

        x : (n, 3) [m], no element inverted;  fields : as in `evaluate`
        convex : not the derivative but a matrix near it that is positive definite far more often,
            equal to it where no volume changes (`material.tangent_vectors`)
        Every call returns the same pattern; the data array is fresh.
        """
        fields = StepFields.of(self.body) if fields is None else fields
        self._element_stiffness(np.ascontiguousarray(x, dtype=float),
                                *self._integrands(fields), convex, self._stiffness)
        data = np.empty(len(self._indices))
        kernels.scatter_blocks(self._block_start, self._block_slots,
                               self._stiffness.reshape(-1, 9), self._row_blocks, data)
        data[self._spring_entries] += self.body.springs.stiffness
        self._supports.add_tangent(x - self.body.mesh.nodes, fields.base, data)
        matrix = csr_array((data, self._indices, self._indptr), shape=(3 * self.n, 3 * self.n))
        matrix.has_canonical_format = True
        return matrix

    def support_tangent(self, x, fields):
        """Return the values (nnz,) that the body's one-sided supports add to `tangent`.

        x, fields : as there
        """
        data = np.zeros(len(self._indices))
        self._supports.add_tangent(x - self.body.mesh.nodes, fields.base, data)
        return data

    @property
    def pattern(self):
        """(indptr, indices) of every `tangent`."""
        return self._indptr, self._indices


def _upper_slots(m, a):
    """Where the kernels put each block (e, b, c) of m elements, as `kernels.scatter_blocks` reads.

    (m a a,) in the order of e, b, c; blocks below the diagonal are mirror images.
    """
    b, c = np.triu_indices(a)
    slot = np.empty((a, a), dtype=np.int64)
    slot[b, c] = 2 * np.arange(len(b))
    slot[c, b] = 2 * np.arange(len(b)) + (c > b)
    return (2 * len(b) * np.arange(m)[:, None] + slot.ravel()).ravel()


def _grouped(labels, count):
    """Slots sorted by label, order kept within: (start (count + 1,), slots (k,))."""
    slots = np.argsort(labels, kind='stable')
    return np.searchsorted(labels[slots], np.arange(count + 1)), slots


def _entries(row_blocks, blocks, rows):
    """Where the 3 x 3 entries of some blocks (k,), in these rows of blocks, lie: (k, 3, 3)."""
    first, width = row_blocks[rows], 3 * (row_blocks[rows + 1] - row_blocks[rows])
    corner = 9 * first + 3 * (blocks - first)
    return (corner[:, None, None] + width[:, None, None] * np.arange(3)[:, None] + np.arange(3))


def _expand(row_blocks, cols):
    """CSR (indptr, indices) of scalars from the pattern of 3 x 3 blocks."""
    width = np.repeat(3 * np.diff(row_blocks), 3)  # entries of each scalar row
    indptr = np.concatenate([[0], np.cumsum(width)])
    begin = np.repeat(3 * row_blocks[:-1], 3)      # of the row's columns among `block_cols`
    block_cols = (3 * cols[:, None] + np.arange(3)).ravel()
    at = np.arange(indptr[-1]) + np.repeat(begin - indptr[:-1], width)
    return indptr.astype(np.int32), block_cols[at].astype(np.int32)
