"""What a support does that the model does not have: condensed to the few nodes that it acts on.

A compliant or debonded base frees held nodes, an obstacle presses on free ones; neither is small,
and pressure sets in at a threshold. The tissue behind those nodes is taken as linear,

    r + S w + p(u + w) = 0,

w their displacement beside the baseline, r the forces of the support that is gone, u where the
baseline has them, p what springs and supports of the term add, S the stiffness of the body
condensed to them (Schur complement; static condensation, Guyan 1965, AIAA J 3:380), of a wall to
the one direction in which it presses. It is found at the state that is loaded least and used at
all. Against full runs on the breast, pads at 2 to 8 mm:
debonding and obstacles within 4 %, a compliant base within 8 % in positions and 12 % in forces.
Of a base of more than MANY nodes the corners of its elements carry the middles of edges, which
takes a twentieth of the time and makes answers of the same shape smaller by 8 to 13 %.
The potential is convex, so that a balance does not depend on where it is looked for from.
Test: diagnosis/forward/test_responses.py
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import bsr_array, coo_array, csr_array, eye_array, kron

from arm_brachy.tissue.element import EDGES
from arm_brachy.tissue.free_dofs import held_nodes
from arm_brachy.tissue.jacobian import Linearisation
from arm_brachy.tissue.pattern import block_columns
from arm_brachy.tissue.supports import SupportForces, chosen

# Pressure comes in over some micrometres: steps are halved until the residual falls.
ITERATIONS, HALVINGS = 60, 30
CLOSE = 1e-8        # m, of the last Newton step
MANY = 800          # nodes of a base: of more, corners carry the middles of edges
PACE = 0.1          # of the residual that may be left after a step by an old factor


@dataclass(frozen=True)
class Law:
    """Springs and one-sided supports of a term on k nodes, of which m numbers say how they move.

    nodes : (k,) the nodes, also those that stay held;  moves : (k,) False for these
    along : (d, 3) the axes, or the one direction in which nothing but pressure acts on free nodes
    carriers : (a, c) shares of the motion of the a nodes that move, of each of those that carry it
    springs : (3k, 3k) sparse [N/m];  supports : Supports, nodes as 0 to k - 1
    """

    nodes: np.ndarray
    moves: np.ndarray
    along: np.ndarray
    carriers: csr_array
    springs: csr_array
    supports: object

    def forces(self, u, base):
        """Return (m,) [N] along w at displacements u (k, 3) [m] from rest.

        As `Assembler.forces`, that is what must be applied from outside.
        """
        out = (self.springs @ (u - base).ravel()).reshape(-1, 3)
        self._kernel.add_forces(u, base, out)
        return self._back @ out.ravel()

    def tangent(self, u, base):
        """Return the derivative (m, m) [N/m] of `forces` by w."""
        indptr, indices = self._pattern
        data = np.zeros(len(indices))
        self._kernel.add_tangent(u, base, data)
        K = csr_array((data, indices, indptr), shape=self.springs.shape)
        if self.springs.nnz:
            K = K + self.springs
        return (self._back @ K @ self._by).toarray()

    def motion(self, w):
        """Return the motion (k, 3) [m] of all nodes by w (m,) [m]."""
        return (self._by @ w).reshape(-1, 3)

    @cached_property
    def spread(self):
        """(3a, m) sparse: motion of the nodes that move, by w."""
        return kron(self.carriers, self.along.T, format='csr')

    @cached_property
    def _by(self):
        every = coo_array(self.spread)
        rows = _rows(np.flatnonzero(self.moves))[every.row]
        return csr_array((every.data, (rows, every.col)),
                         shape=(self.moves.size * 3, every.shape[1]))

    @cached_property
    def _back(self):
        return self._by.T.tocsr()

    @cached_property
    def _pattern(self):
        """(indptr, indices) of the tangent in rows of the k nodes: blocks of those that meet."""
        nodes, k = self.supports.nodes, len(self.nodes)
        pairs = np.unique(nodes[:, :, None] * k + nodes[:, None, :])
        starts = np.searchsorted(pairs // k, np.arange(k + 1))
        blocks = bsr_array((np.ones((len(pairs), 3, 3)), pairs % k, starts),
                           shape=self.springs.shape).tocsr()
        blocks.sort_indices()
        return blocks.indptr, blocks.indices

    @cached_property
    def _kernel(self):
        columns = block_columns(self._pattern, self.supports.nodes)
        return SupportForces(self.supports, columns, self._pattern[0])


def law_between(old, new):
    """Return the Law that takes one SoftBody to another and the nodes it frees, or None.

    Returns (Law, freed (f,)); None where the two differ in more than supports: mesh, pads.
    """
    if not np.array_equal(old.mesh.nodes, new.mesh.nodes) or not all(
            np.array_equal(a.nodes, b.nodes) and np.array_equal(a.direction, b.direction)
            for a, b in zip(old.pads, new.pads, strict=True)):
        return None
    before = len(old.supports.nodes)
    if len(old.springs.nodes) or np.setdiff1d(new.fixed, old.fixed).size:
        return None
    added = chosen(new.supports, np.arange(len(new.supports.nodes)) >= before)
    freed = np.setdiff1d(old.fixed, new.fixed)
    nodes = np.unique(np.concatenate([freed, new.springs.nodes, added.nodes.ravel()]))
    local = np.full(len(old.mesh.nodes), -1)
    local[nodes] = np.arange(len(nodes))
    at = _rows(local[new.springs.nodes]).reshape(-1, 3)
    springs = csr_array((new.springs.stiffness.ravel(), (
        np.repeat(at, 3, axis=1).ravel(), np.tile(at, (1, 3)).ravel())),
        shape=(3 * len(nodes), 3 * len(nodes)))
    moves = ~np.isin(nodes, held_nodes(new))
    pressed = not len(freed) and not len(new.springs.nodes) and not added.glue.any()
    corners = added.nodes if len(added.nodes) else np.zeros((0, 3), dtype=np.int64)
    return Law(nodes, moves, _shared(added.normal) if pressed else np.eye(3),
               _carriers(new.mesh, nodes[moves], bool(len(freed)) and len(old.fixed) > MANY),
               springs, replace(added, nodes=local[corners])), freed


def _shared(normal):
    """Directions (d, 3) that the normals (s, 3) of supports span: the one, if it is one."""
    return normal[:1] if len(normal) and (normal == normal[0]).all() else np.eye(3)


def _carriers(mesh, nodes, by_corners):
    """Shares (a, c) of the motion of nodes (a,): each carries itself, or the corners carry all.

    The middle of an edge goes then as the mean of its ends, of which those not in `nodes` stay.
    """
    corner = np.isin(nodes, mesh.tets)
    if not by_corners or mesh.midside is None or not corner.any():
        return csr_array(eye_array(len(nodes)))
    local = np.full(len(mesh.nodes), -1)
    local[nodes[corner]] = np.arange(corner.sum())
    middles, first = np.unique(mesh.midside, return_index=True)
    ends = mesh.tets[:, EDGES].reshape(-1, 2)[first]
    of_middle = local[ends[np.searchsorted(middles, nodes[~corner])]]
    rows = np.repeat(np.flatnonzero(~corner), 2)
    known = of_middle.ravel() >= 0
    return csr_array((
        np.concatenate([np.ones(corner.sum()), np.full(known.sum(), 0.5)]),
        (np.concatenate([np.flatnonzero(corner), rows[known]]),
         np.concatenate([np.arange(corner.sum()), of_middle.ravel()[known]]))),
        shape=(len(nodes), int(corner.sum())))


class Condensed:
    """Stiffness of the body of a linearised.Baseline condensed to some nodes, at its least load.

    In single precision: off by less than 1e-3 of what full runs differ by.
    """

    def __init__(self, baseline):
        self._fixed, self._base = baseline.model.body.fixed, None
        i = int(np.argmin(np.abs(baseline.trajectory.pads[baseline.at]).sum(axis=(1, 2))))
        self._linear = Linearisation(baseline.solver, baseline.x(i), baseline.fields[i],
                                     single=True)

    def held(self, law):
        """Return S (m, m) [N/m] of held nodes that a Law frees, all other held ones staying."""
        if self._base is None:
            self._base = self._linear.stiffness(_rows(self._fixed))
        where = _rows(np.searchsorted(self._fixed, law.nodes[law.moves]))
        return law.spread.T @ (law.spread.T @ self._base[np.ix_(where, where)]).T

    def free(self, law):
        """Return S (m, m) [N/m] of the free nodes of a Law, the inverse of their compliance."""
        nodes, d = law.nodes[law.moves], len(law.along)
        rows = np.repeat(_rows(nodes), d)
        columns = np.arange(d * len(nodes)).reshape(-1, 1, d).repeat(3, axis=1)
        loads = csr_array((np.tile(law.along.T.ravel(), len(nodes)), (rows, columns.ravel())),
                          shape=(self._linear.x.size, d * len(nodes)))
        compliance = self._linear.compliance(loads)
        return cho_solve(cho_factor(compliance), np.eye(len(compliance)))


def interface_change(baseline, body):
    """Return the changes (n, r) of observables by supports that `body` has and the baseline not.

    body : SoftBody as the terms with the candidate prepared it
    Rows of states at which no balance is found are NaN. None where `body` differs from the
    baseline's in more than supports, or they act on held and on free nodes at once.
    """
    parts = law_between(baseline.model.body, body)
    if parts is None:
        return None
    law, freed = parts
    nodes = law.nodes[law.moves]
    if len(freed) and not np.array_equal(freed, nodes):
        return None
    u = {k: (baseline.x(k) - baseline.model.body.mesh.nodes)[law.nodes]
         for k in baseline.places()}
    if not len(law.nodes) or not len(freed) and not any(
            law.forces(u[k], baseline.base(k)).any() for k in u):
        return np.zeros((len(baseline.t), len(baseline.sensitivity(0).force)))
    if baseline.condensed is None:
        baseline.condensed = Condensed(baseline)
    condensed = baseline.condensed
    S = condensed.held(law) if len(freed) else condensed.free(law)
    w = _balances(baseline, law, S, u, nodes if len(freed) else None)
    by = [baseline.sensitivity(k) for k in baseline.place]
    if len(freed):
        columns = _rows(np.searchsorted(baseline.solver.free.held, nodes))
        return np.stack([one.motion[:, columns] @ (law.spread @ w[k])
                         for one, k in zip(by, baseline.place, strict=True)])
    return np.stack([one.force[:, _rows(law.nodes)] @ law.motion(S @ w[k]).ravel()
                     for one, k in zip(by, baseline.place, strict=True)])


def _balances(baseline, law, S, u, freed):
    """Place -> displacement (m,) [m] of the nodes that move, NaN where no balance is found.

    u : place -> (k, 3) [m];  freed : (a,) nodes that were held, None for free ones
    Places are visited from little load to much, each from the one with the nearest pads.
    """
    balance, none = _Balance(law, S), np.zeros(len(S))
    pads, w = {None: np.zeros(baseline.pads(0).size)}, {None: none}
    for k in sorted(u, key=lambda k: np.abs(baseline.pads(k)).sum()):
        here = baseline.pads(k).ravel()
        near = min(pads, key=lambda j: np.abs(pads[j] - here).max())
        reaction = none if freed is None else law.spread.T @ baseline.forces[k][freed].ravel()
        w[k] = balance.find(w[near], reaction, u[k], baseline.base(k))
        if np.isfinite(w[k]).all():
            pads[k] = here
    return w


class _Balance:
    """Finds w (m,) [m] of the nodes of a law that move at which r + S w + p(u + w) = 0.

    law : Law;  S : (m, m) [N/m]. Newton; a factor serves as long as the residual falls fast.
    """

    def __init__(self, law, S):
        self._law, self._S, self._factor = law, S, None

    def find(self, w, reaction, u, base):
        """Return w from a start (m,), NaN if it is not found; r, u, base : as in `Law`."""
        def forces(w):
            return reaction + self._S @ w + self._law.forces(u + self._law.motion(w), base)

        left, falls = forces(w), False
        for _ in range(ITERATIONS):
            if self._factor is not None:
                step = -cho_solve(self._factor, left, check_finite=False)
                if falls and _small(step):
                    return w + step
                ahead = forces(w + step)
                falls = _size(ahead) <= PACE * _size(left)
                if falls:
                    w, left = w + step, ahead
                    continue
            K = self._law.tangent(u + self._law.motion(w), base)
            self._factor = cho_factor(self._S + K, overwrite_a=True)
            step = -cho_solve(self._factor, left, check_finite=False)
            step, ahead = _shortened(step, w, left, forces)
            falls = _size(ahead) <= PACE * _size(left)
            w, left = w + step, ahead
            if _small(step):
                return w
        return np.full(len(w), np.nan)


def _shortened(step, w, left, forces):
    """(step, forces there), the step halved until they are less than `left`."""
    for _ in range(HALVINGS):
        ahead = forces(w + step)
        if _size(ahead) < _size(left):
            break
        step = 0.5 * step
    return step, ahead


def _small(step):
    return np.abs(step).max(initial=0.0) <= CLOSE


def _size(forces):
    return float(np.sqrt(forces @ forces))


def _rows(nodes):
    return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()
