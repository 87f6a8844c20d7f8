"""What a support does that the model does not have: condensed to the few nodes that it acts on.

A compliant or debonded base frees held nodes, an obstacle presses on free ones; neither is small,
and pressure sets in at a threshold. The tissue behind those nodes is taken as linear,

    r + S w + p(u + w) = 0,

w their displacement beside the baseline, r the forces of the support that is gone, u where the
baseline has them, p what springs and supports of the term add, S the stiffness of the body
condensed to them (Schur complement; static condensation, Guyan 1965, AIAA J 3:380). It is found at
the state that is loaded least and used at all. Against full runs on the breast, pads at 2 to 8 mm:
debonding and obstacles within 4 %, a compliant base within 8 % in positions and 12 % in forces.
Test: diagnosis/forward/test_responses.py
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve

from arm_brachy.tissue.free_dofs import held_nodes
from arm_brachy.tissue.jacobian import Linearisation
from arm_brachy.tissue.supports import SupportForces, chosen

# Pressure comes in over some micrometres: steps are halved until the residual falls.
ITERATIONS, HALVINGS = 60, 30
CLOSE = 1e-8        # m, of the last Newton step


@dataclass(frozen=True)
class Law:
    """Springs and one-sided supports of a term on k nodes.

    nodes : (k,) the nodes, also those that stay held;  moves : (k,) False for these
    springs : (3k, 3k) [N/m];  supports : Supports, nodes as 0 to k - 1
    """

    nodes: np.ndarray
    moves: np.ndarray
    springs: np.ndarray
    supports: object

    def forces(self, u, base):
        """Return (3k,) [N] of `Assembler.forces` at displacements u (k, 3) [m] from rest."""
        out = (self.springs @ (u - base).ravel()).reshape(-1, 3)
        _kernel(self).add_forces(u, base, out)
        return out.ravel()

    def tangent(self, u, base):
        """Return d forces / d u (3k, 3k) [N/m]."""
        data = np.zeros((3 * len(self.nodes)) ** 2)
        _kernel(self).add_tangent(u, base, data)
        return self.springs + data.reshape(self.springs.shape)


def _kernel(law):
    size, nodes = 3 * len(law.nodes), law.supports.nodes
    columns = np.repeat(3 * nodes[:, None, :], nodes.shape[1], axis=1)
    return SupportForces(law.supports, columns, size * np.arange(size + 1))


def law_between(old, new):
    """Return the Law that takes one SoftBody to another and the nodes it frees, or None.

    Returns (Law, freed (f,)); None where the two differ in more than supports: mesh, pads.
    """
    if old.mesh is not new.mesh or old.pads is not new.pads:
        return None
    before = len(old.supports.nodes)
    if len(old.springs.nodes) or np.setdiff1d(new.fixed, old.fixed).size:
        return None
    added = chosen(new.supports, np.arange(len(new.supports.nodes)) >= before)
    freed = np.setdiff1d(old.fixed, new.fixed)
    nodes = np.unique(np.concatenate([freed, new.springs.nodes, added.nodes.ravel()]))
    local = np.full(len(old.mesh.nodes), -1)
    local[nodes] = np.arange(len(nodes))
    stiffness = np.zeros((len(nodes), 3, len(nodes), 3))
    at = local[new.springs.nodes]
    stiffness[at, :, at, :] = new.springs.stiffness
    corners = added.nodes if len(added.nodes) else np.zeros((0, 3), dtype=np.int64)
    return Law(nodes, ~np.isin(nodes, held_nodes(new)), stiffness.reshape(3 * len(nodes), -1),
               replace(added, nodes=local[corners])), freed


class Condensed:
    """Stiffness of the body of a baseline.Baseline condensed to some nodes, at its least load."""

    def __init__(self, baseline):
        self._baseline, self._base = baseline, None
        i = int(np.argmin(np.abs(baseline.trajectory.pads[baseline.at]).sum(axis=(1, 2))))
        self._linear = Linearisation(baseline.solver, baseline.x(i), baseline.fields[i])

    def held(self, nodes):
        """Return S (3k, 3k) [N/m] of held nodes (k,), all other held ones staying."""
        fixed = self._baseline.model.body.fixed
        if self._base is None:
            rows = _rows(fixed)
            motion = np.zeros((self._linear.x.size, len(rows)))
            motion[rows, np.arange(len(rows))] = 1.0
            self._base = (self._linear.K @ self._linear.respond(motion))[rows]
        where = _rows(np.searchsorted(fixed, nodes))
        return self._base[np.ix_(where, where)]

    def free(self, nodes):
        """Return S (3k, 3k) [N/m] of free nodes (k,), the inverse of their compliance."""
        rows = _rows(nodes)
        load = np.zeros((self._linear.x.size, len(rows)))
        load[rows, np.arange(len(rows))] = -1.0
        compliance = self._linear.respond(np.zeros_like(load), load)[rows]
        return cho_solve(cho_factor(0.5 * (compliance + compliance.T)), np.eye(len(rows)))


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
    if baseline.condensed is None:
        baseline.condensed = Condensed(baseline)
    released = len(freed) > 0
    S = (baseline.condensed.held if released else baseline.condensed.free)(nodes)
    rows, out = _rows(nodes), []
    for i in range(len(baseline.t)):
        u = (baseline.x(i) - baseline.model.body.mesh.nodes)[law.nodes]
        reaction = baseline.forces[i][nodes].ravel() if released else np.zeros(len(rows))
        w = _balance(law, S, reaction, u, baseline.base(i))
        by = baseline.sensitivity(i)
        if released:
            out.append(by.motion[:, np.searchsorted(by.held, rows)] @ w)
        else:
            out.append(by.force[:, rows] @ (S @ w))
    return np.array(out)


def _balance(law, S, reaction, u, base):
    """Displacement (3a,) [m] of the nodes that move at which r + S w + p(u + w) = 0, or NaN."""
    moves = np.repeat(law.moves, 3)
    w = np.zeros(len(reaction))

    def at(w):
        moved = u.copy()
        moved[law.moves] += w.reshape(-1, 3)
        return moved

    def residual(w):
        return reaction + S @ w + law.forces(at(w), base)[moves]

    left = residual(w)
    for _ in range(ITERATIONS):
        K = S + law.tangent(at(w), base)[np.ix_(moves, moves)]
        step = -solve(K, left, assume_a='sym')
        for _ in range(HALVINGS):
            ahead = residual(w + step)
            if np.linalg.norm(ahead) < np.linalg.norm(left):
                break
            step = 0.5 * step
        w, left = w + step, ahead
        if np.abs(step).max(initial=0.0) <= CLOSE:
            return w
    return np.full(len(w), np.nan)


def _rows(nodes):
    return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()
