"""Making a reduced model: pushes solved in full, modes, the quadrature points worth keeping.

Modes: proper orthogonal decomposition of what the linear-elastic answer misses, in the inner
product of the tangent at rest, so that one unit of any coordinate stores the same energy.

Points: ECSW (Farhat, Avery, Chapman & Cortial 2014, Int J Numer Meth Engng 98:625). The sum over
all points becomes a weighted sum over few, the weights non-negative and such that the reduced
forces of sampled states come out. The reduced model is then still the gradient of a potential, its
tangent symmetric, and where each point's own tangent is positive so is the sum. Here quadrature
points are weighed one by one, not elements, as in the empirical cubature of Hernandez, Caicedo &
Ferrer 2017 (Comput Methods Appl Mech Engng 313:687); linear tetrahedra have one point each.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular
from scipy.spatial import cKDTree

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.element import point_moduli
from arm_brachy.tissue.jacobian import Linearisation
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.reduced import ReducedSolver
from arm_brachy.tissue.reduced_basis import (
    ReducedModel,
    body_hash,
    sample_pushes,
    snapshots,
    solve_pushes,
)
from arm_brachy.tissue.reduced_kernels import (
    cubature,
    material_tangents,
    point_stress,
    sampled_stiffness,
)

CHUNK = 512  # elements whose reduced forces are formed at once
FAR = 0.02    # m, where a pad is felt as a force and no longer as a shape


def train(body, domain, *, rng, samples=256, modes=24, points=200):
    """Return the ReducedModel of a SoftBody for pushes in a PushDomain.

    rng : numpy.random.Generator;  samples : full solves, see `reduced_basis.snapshots`
    modes, points : as in `reduce`
    Nearly all its time goes into the full solves. Elastic, static bodies: terms that change
    moduli or stress in a step are not learnt. Raises NotConverged where the full solver does.
    Equal arguments give equal bits for any number of numba threads; those of BLAS must be equal.
    """
    return reduce(body, snapshots(body, domain, samples, rng), modes=modes, points=points)


def reduce(body, data, *, modes, points=None, tolerance=1e-4, states=40, exact_at_rest=True):
    """Return the ReducedModel that Snapshots of a SoftBody give.

    modes : how many;  points : at most so many quadrature points, None = all of them
    tolerance : as in `cubature`, of the forces the samples are fitted to
    states : the points are fitted to so many snapshots, the first: corners, then a Sobol sequence
    exact_at_rest : keep the tangent at rest in full (it is constant) and sample what is left of
        the forces only: the same cost, on linear tetrahedra about half the error or less at 24
        modes, on quadratic ones no clear gain (experiments.reduced_model has both). But the
        constant part is what the samples lack, of either sign, so the tangent is no longer
        positive for being a sum of positive terms; the solver checks it. False: plain ECSW.
    """
    galerkin = Galerkin(body, data, modes, exact_at_rest)
    y = galerkin.coordinates(data)
    every = galerkin.model(data.domain, galerkin.truncation(data, y))
    if points is None:
        return every
    shares = galerkin.shares(y[:states][galerkin.upright(y[:states])])
    total = shares.sum(axis=1)
    taken, factors = cubature(shares, total, tolerance, max_points=points)
    misfit = np.linalg.norm(shares[:, taken] @ factors - total) / np.linalg.norm(total)
    return galerkin.model(data.domain, every.truncation, taken, factors, float(misfit))


class Galerkin:
    """A SoftBody's equations projected on pad translations and modes.

    body : SoftBody;  data : Snapshots of it;  modes : how many (at most as many as snapshots)
    exact_at_rest : as in `reduce`
    Attribute basis : (n, 3, w) as in ReducedModel
    """

    def __init__(self, body, data, modes, exact_at_rest):
        if body.beyond.any():
            raise ConfigError('reduced model: the body has stiffening tissue or fibres; must be '
                              'Neo-Hookean; use the full solver')
        if len(body.supports.nodes):
            raise ConfigError('reduced model: the body rests on one-sided supports; must have '
                              'none; use the full solver')
        self.exact_at_rest = exact_at_rest
        self.body, self.reference = body, data.reference
        self._at_rest = Linearisation(StaticSolver(body), data.reference)
        n = len(data.reference)
        lifts = self._at_rest.state_sensitivity().reshape(3 * n, -1)
        missed = (data.x - data.reference).reshape(-1, 3 * n) - _flat(data) @ lifts.T
        self.basis = np.hstack([lifts, self._pod(missed.T, modes)]).reshape(n, 3, -1)
        self._geometry, self._fields = body.geometry, StepFields.of(body)
        self._weights = body.geometry.point_weights
        self._mu, self._kappa = point_moduli(body.geometry, self._fields)

    def _pod(self, u, count):
        """(3n, count) modes of the columns of u, orthonormal in K, by the method of snapshots."""
        values, vectors = eigh(u.T @ (self._at_rest.K @ u))
        if not 0 <= count <= len(values) or count and values[-count] <= 1e-14 * values[-1]:
            raise InputError(f'{count} modes asked of {len(values)} snapshots; they span '
                             f'{int(np.sum(values > 1e-14 * values[-1]))}; ask for fewer or '
                             'sample more')
        order = np.arange(len(values))[::-1][:count]
        return u @ (vectors[:, order] / np.sqrt(values[order]))

    def coordinates(self, data):
        """Return y = (d, q) (k, w) of Snapshots: displacements and projections on the modes."""
        h, n = 3 * len(self.body.pads), len(self.reference)
        flat = self.basis.reshape(3 * n, -1)
        missed = (data.x - self.reference).reshape(-1, 3 * n) - _flat(data) @ flat[:, :h].T
        return np.hstack([_flat(data), missed @ (self._at_rest.K @ flat[:, h:])])

    def truncation(self, data, y):
        """Return the largest error of a node [m] with Snapshots projected to y (k, w)."""
        left = data.x - self.reference - np.einsum('niw,kw->kni', self.basis, y, optimize=True)
        return float(np.linalg.norm(left, axis=2).max())

    def model(self, domain, truncation, points=None, factors=None, misfit=0.0):
        """Return the ReducedModel with the given quadrature points; None = all, factors 1.

        domain, truncation, misfit : as in ReducedModel;  points (s,) : element * q + point;
        factors (s,) : on their quadrature weights
        """
        q = self._weights.shape[1]
        points = np.arange(self._weights.size) if points is None else points
        factors = np.ones(len(points)) if factors is None else factors
        at = points // q, points % q
        F0, B = self._gradients(*at)
        flat = B.reshape(-1, B.shape[2])
        weights = factors * self._weights[at]
        mu, kappa, S = self._mu[at], self._kappa[at], self._fields.stress[at]
        P0 = point_stress(F0, mu, kappa, S)
        linear, quadratic = self._linear(), self._springs()
        if self.exact_at_rest:
            quadratic = self._stiffness() - sampled_stiffness(F0, flat, weights, mu, kappa, S)
        linear -= np.einsum('s,sk,skw->w', weights, P0.reshape(-1, 9), B)
        return ReducedModel(body_hash(self.body), domain, self.reference, self.basis,
                            np.stack(at, axis=1), weights, mu, kappa, S, F0.reshape(-1, 9),
                            flat, linear, 0.5 * (quadratic + quadratic.T), truncation, misfit)

    def _gradients(self, elements, quadrature):
        """F at the reference (s, 3, 3) and its change per coordinate (s, 9, w)."""
        nodes = self._geometry.connectivity[elements]
        G = self._geometry.gradients[elements, quadrature]
        B = np.einsum('saiw,sak->sikw', self.basis[nodes], G, optimize=True)
        return (np.einsum('sai,sak->sik', self.reference[nodes], G),
                B.reshape(len(elements), 9, -1))

    def _springs(self):
        held = self.body.springs
        at = self.basis[held.nodes]
        return np.einsum('siw,sij,sjv->wv', at, held.stiffness, at, optimize=True)

    def _stiffness(self):
        """Tangent (w, w) of the full potential at the reference, springs included."""
        flat = self.basis.reshape(len(self.basis) * 3, -1)
        return flat.T @ (self._at_rest.K @ flat)

    def _linear(self):
        """Gradient (w,) of the full potential at the reference: pad forces; zero on the modes."""
        forces = self._at_rest.solver.assembler.forces(self.reference, self._fields)
        return np.einsum('niw,ni->w', self.basis, forces)

    def shares(self, y):
        """Return (states * w, points) forces at y (states, w) less those at rest, by point.

        Rows are scaled to unit stiffness at rest, pad forces among themselves by the Cholesky
        factor of the pads' stiffness, so that errors of all rows weigh the same energy.
        """
        h, w = 3 * len(self.body.pads), self.basis.shape[2]
        m, q = self._weights.shape
        out = np.empty((len(y), w, m, q))
        for start in range(0, m, CHUNK):
            part = slice(start, min(m, start + CHUNK))
            elements, quadrature = np.divmod(np.arange(part.start * q, part.stop * q), q)
            out[:, :, part] = self._chunk_shares(y, elements, quadrature).reshape(
                len(y), w, -1, q)
        lifts = self.basis[:, :, :h].reshape(-1, h)
        scale = cholesky(lifts.T @ (self._at_rest.K @ lifts), lower=True)
        pads = np.moveaxis(out[:, :h], 1, 0).reshape(h, -1)
        scaled = solve_triangular(scale, pads, lower=True).reshape(h, len(y), m, q)
        out[:, :h] = np.moveaxis(scaled, 0, 1)
        return out.reshape(len(y) * w, m * q)

    def _chunk_shares(self, y, elements, quadrature):
        """(states, w, points) of some points."""
        F0, B = self._gradients(elements, quadrature)
        at = elements, quadrature
        mu, kappa, S = self._mu[at], self._kappa[at], self._fields.stress[at]
        F = F0 + np.einsum('skw,tw->tsk', B, y, optimize=True).reshape(len(y), -1, 3, 3)
        P = point_stress(F, mu, kappa, S) - point_stress(F0, mu, kappa, S)
        if self.exact_at_rest:
            A = material_tangents(F0, mu, kappa, S)
            P -= np.einsum('skl,tsl->tsk', A, (F - F0).reshape(len(y), -1, 9),
                           optimize=True).reshape(P.shape)
        P *= self._weights[at][:, None, None]
        return np.matmul(P.reshape(len(y), -1, 9).swapaxes(0, 1), B).transpose(1, 2, 0)

    def upright(self, y):
        """Return (states,) booleans: no quadrature point of the body is inverted at y."""
        m, q = self._weights.shape
        good = np.ones(len(y), dtype=bool)
        for start in range(0, m, CHUNK):
            at = np.divmod(np.arange(start * q, min(m, start + CHUNK) * q), q)
            F0, B = self._gradients(*at)
            F = F0 + np.einsum('skw,tw->tsk', B, y, optimize=True).reshape(len(y), -1, 3, 3)
            good &= (np.linalg.det(F) > 0.0).all(axis=1)
        return good


def _flat(data):
    return data.pad_displacement.reshape(len(data.x), -1)


@dataclass(frozen=True)
class Validation:
    """A ReducedModel against full solutions at k pushes.

    ok : (k,) booleans, reduced solve converged; the rest is NaN where it did not
    far : (k,) [m] largest error of a node more than `FAR` from every pad at rest
    anywhere : (k,) [m] largest error of a node;  watched : (k,) [m] of the embedded points asked
        for, NaN if none were
    force : (k,) error of the pad forces over the pad forces, both as Euclidean norms
    """

    ok: np.ndarray
    far: np.ndarray
    anywhere: np.ndarray
    watched: np.ndarray
    force: np.ndarray


def validate(model, body, rng, *, count=32, embedding=None):
    """Return the Validation of a ReducedModel at `count` fresh pushes inside its domain.

    body : SoftBody it was made from;  rng : numpy.random.Generator, not the one of training
    embedding : mesh.Embedding of the points that matter, None = none
    Raises NotConverged where the full solver finds no equilibrium, InputError for another body.
    """
    corners = 2 ** model.n_pads
    pushes = sample_pushes(model.domain, corners + count, rng)[-count:]
    return compare(model, body, solve_pushes(body, model.domain, pushes), embedding)


def compare(model, body, data, embedding=None):
    """Return the Validation of a ReducedModel at Snapshots; the rest as in `validate`."""
    model.require(body)
    solver, whole = ReducedSolver(model), model.watch()
    x, force = np.full_like(data.x, np.nan), np.full_like(data.pad_force, np.nan)
    for k, push in enumerate(data.pad_displacement):
        found = solver.solve(solver.rest, push)
        if found.outcome.ok:
            x[k], force[k] = whole.positions(found), found.pad_force
    return judge(body, data, x, force, embedding)


def judge(body, data, x, force, embedding=None):
    """Return the Validation of any answers to the pushes of Snapshots.

    x : (k, n, 3) [m], NaN where there is no answer;  force : (k, p, 3) [N];  others as above
    """
    pads = np.concatenate([body.mesh.nodes[pad.nodes] for pad in body.pads])
    far = cKDTree(pads).query(body.mesh.nodes)[0] > FAR
    error = np.linalg.norm(x - data.x, axis=2)
    watched = np.full(len(x), np.nan)
    if embedding is not None:
        apart = np.einsum('ta,ktai->kti', embedding.weights, (x - data.x)[:, embedding.nodes])
        watched = np.linalg.norm(apart, axis=2).max(axis=1)
    size = np.linalg.norm(data.pad_force, axis=(1, 2))
    return Validation(np.isfinite(error).all(axis=1), error[:, far].max(axis=1, initial=0.0),
                      error.max(axis=1), watched,
                      np.linalg.norm(force - data.pad_force, axis=(1, 2)) / size)
