"""ADMM with scalar weights over quadrature points: the state model (4.1) of KF-ADMM.

The thesis ties one matrix z to each linear element. Here z belongs to a quadrature point, so that
quadratic elements can be used, which do not lock: each point has its own moduli
(`element.point_moduli`), and with it its own term of the energy. With scalar weights w the matrix
L = D' W D of (4.1) is a graph operator times I3, three equal systems of a third of the size.
"""

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from arm_brachy.core.errors import ConfigError
from arm_brachy.estimation import volume_prox
from arm_brachy.tissue import proximal
from arm_brachy.tissue.admm_weights import elastic_stress
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.element import point_moduli
from arm_brachy.tissue.free_dofs import held_nodes

LAST_STEP = 1e-3    # of the local Newton, absolute in a matrix near I; it squares the error


class AdmmPoints:
    """State, matrices and iteration (4.1), (3.12)-(3.13) of a SoftBody.

    body : SoftBody, Neo-Hookean, held by nodes alone;  step : [s] dt of one iteration
    weight : c of w = c (kappa + 4/3 mu) V, the modulus of a uniaxial strain, where a point has
        both;  volume_weight : of w = volume_weight kappa V where it has kappa alone
    free : (f,) nodes not held;  L : (f, f) sparse [N/m];  mass : (f,) [kg]
    x, before : (n, 3) [m] of this iteration and the last;  z, u : (9, P)
    Equal arguments give equal bits. Raises ConfigError for a body beyond this form.
    """

    def __init__(self, body, step, weight, volume_weight):
        _refuse(body)
        assembler, fields = Assembler(body), StepFields.of(body)
        order, split, (self._mu, self._kappa, self._V) = _points(assembler.geometry, fields)
        self._shear, self._volume = slice(0, split), slice(split, len(order))
        self._D = _gradient(assembler.geometry, assembler.n, order)
        self._w = self._V * np.where(self._mu > 0.0,
                                     weight * (self._kappa + 4.0 / 3.0 * self._mu),
                                     volume_weight * self._kappa)
        held = held_nodes(body)
        self.free = np.setdiff1d(np.arange(assembler.n), held)
        self._body, self._rest, self._h2 = body, body.mesh.nodes, step**2
        mass = assembler.lumped_mass()
        heavy = assembler.heavy_mass(body.density, body.nodal_mass)
        self._load = (fields.nodal_force + np.outer(heavy, body.gravity))[self.free]
        self._DT = self._D.T.tocsr()[self.free]
        whole = self._DT @ diags_array(np.repeat(self._w, 3)) @ self._D
        self.L, self.mass = csc_array(whole.tocsc()[:, self.free]), mass[self.free]
        self._solve = splu(csc_array(self.L + diags_array(self.mass / self._h2))).solve
        self._no_beta, self._n = np.zeros(split), np.zeros((9, split))
        self._n[0] = 1.0
        self._sweeps = np.zeros((split + proximal.CHUNK - 1) // proximal.CHUNK)

    def start(self, x):
        """Begin at an equilibrium x (n, 3) [m]: z = D x, and multipliers that carry its stress."""
        self.x, self.before = x.copy(), x.copy()
        self._F = self.z = self._gradients()
        self.u = self._V * elastic_stress(self.z, self._mu, self._kappa) / self._w

    def local_step(self):
        """(3.12)-(3.13): every point's z, then its multiplier."""
        self._F = self._gradients()
        Y, z, u = self.u + self._F, [], []
        for part, step in ((self._shear, self._shear_step), (self._volume, self._volume_step)):
            own = [np.ascontiguousarray(a[:, part]) for a in (Y, self.z, self.u)]
            step(*own)
            z.append(own[1])
            u.append(own[2])
        self.z, self.u = np.hstack(z), np.hstack(u)

    def _shear_step(self, Y, z, u):
        mu, kappa, V, w = (a[self._shear] for a in (self._mu, self._kappa, self._V, self._w))
        proximal.local_step(Y, z, u, self._n, w, self._no_beta, V, mu, kappa, LAST_STEP,
                            self._sweeps)

    def _volume_step(self, Y, z, u):
        kappa, V, w = (a[self._volume] for a in (self._kappa, self._V, self._w))
        volume_prox.local_step(Y, z, u, kappa * V / w, LAST_STEP)

    def predict(self, pad_displacement):
        """(4.1): x of the next iteration, before the measurement; held nodes go where pads are.

        pad_displacement : (p, 3) [m]. `local_step` comes before.
        """
        flown = 2.0 * self.x[self.free] - self.before[self.free]
        self.before, self.x = self.x, self.x.copy()
        for pad, shift in zip(self._body.pads, pad_displacement, strict=True):
            self.x[pad.nodes] = self._rest[pad.nodes] + shift
        # around the present x, so that only the change is solved for
        moved = not np.array_equal(self.x, self.before)
        pull = self.z - self.u - (self._gradients() if moved else self._F)
        force = self._DT @ _as_rows(self._w * pull) + self._load
        force += (self.mass / self._h2)[:, None] * (flown - self.x[self.free])
        self.x[self.free] += self._solve(force)

    def correct(self, shift):
        """Add shift (2 f, 3) [m] to the state (4.2): this iterate, then the last one."""
        self.x[self.free] += shift[:len(self.free)]
        self.before = self.before.copy()
        self.before[self.free] += shift[len(self.free):]

    def transition(self):
        """P (f, f) = (M + dt^2 L)^-1 M, dense: A = 2 P and B = -P of (4.4)."""
        return self._solve(np.diag(self.mass / self._h2))

    def smooth(self, right):
        """L^-1 right, for right (f, k)."""
        return splu(self.L).solve(right)

    def _gradients(self):
        """Deformation gradients (9, P), row by row."""
        F = (self._D @ self.x).reshape(-1, 3, 3)    # point, k of dX_k, i of x_i
        return np.ascontiguousarray(F.transpose(2, 1, 0).reshape(9, -1))


def _as_rows(matrices):
    """(9, P) row by row to (3 P, 3), as D x comes."""
    return matrices.reshape(3, 3, -1).transpose(2, 1, 0).reshape(-1, 3)


def _points(geometry, fields):
    """Which points act, those with a shear modulus first, how many these are, mu, kappa, V.

    Numbers of points run element by element; moduli and volumes are (P,) in the order returned.
    """
    mu, kappa = (a.ravel() for a in point_moduli(geometry, fields))
    V = geometry.point_weights.ravel()
    shear = np.flatnonzero(mu > 0.0)
    order = np.concatenate([shear, np.flatnonzero((mu <= 0.0) & (kappa > 0.0))])
    return order, len(shear), tuple(np.ascontiguousarray(a[order]) for a in (mu, kappa, V))


def _gradient(geometry, n, order):
    """Sparse D (3 P, n) of the points `order` (P,): row 3 p + k is d/dX_k at point p."""
    G, conn = geometry.gradients, geometry.connectivity
    m, q, a, _ = G.shape
    G = G.reshape(m * q, a, 3)[order]
    rows = np.broadcast_to(3 * np.arange(len(order))[:, None, None] + np.arange(3), G.shape)
    cols = np.broadcast_to(np.repeat(conn, q, axis=0)[order][:, :, None], G.shape)
    return coo_array((G.ravel(), (rows.ravel(), cols.ravel())), shape=(3 * len(order), n)).tocsr()


def _refuse(body):
    if body.beyond.any():
        raise ConfigError('kf_admm: the model has stiffening tissue or fibres; must be '
                          'Neo-Hookean, as its local step is; leave the term out of model.terms')
    if len(body.supports.nodes) or len(body.springs.nodes):
        raise ConfigError('kf_admm: the model rests on springs or one-sided supports; must be '
                          'held by its nodes, or its filter is not three equal ones; leave the '
                          'term out of model.terms')
