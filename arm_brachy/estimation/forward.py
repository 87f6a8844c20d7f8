"""The forward model of the reduced estimators: equilibrium at a travel, and what it shows."""

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.estimation.model_body import ModelBody
from arm_brachy.estimation.unknowns import Unknowns
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.free_dofs import held_nodes
from arm_brachy.tissue.jacobian import Linearisation
from arm_brachy.tissue.mesh import embed, interpolate
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver

TOLERANCE = 1e-7  # m, open correction of an equilibrium: three decades below what a marker shows


class Forward:
    """Finite elements in equilibrium, markers and targets on them, unknowns in them.

    scene, terms, targets, markers : as `ModelBody`;  prior : unknowns.PriorParams
    tolerance : [m] largest correction left open at an equilibrium
    single : derivatives from a factor in single precision, good to some 1e-5 of themselves
    Attributes: model (ModelBody), unknowns (Unknowns), n_markers, n_targets
        watch : (3n, 3w) d point coordinates / d x, transposed
        derivatives : unknowns.Derivatives of the last `response`
    Points are markers first, then targets. Not to be shared between threads.
    """

    def __init__(self, scene, terms, targets, markers, prior, *, tolerance=TOLERANCE,
                 single=False):
        self.model = ModelBody(scene, terms, targets, markers)
        self.n_markers, self.n_targets = len(self.model.markers), len(self.model.targets)
        names = (*self.model.markers, *self.model.targets)
        rest = np.vstack([self.model.rest_markers, self.model.rest_targets])
        body = self.model.body
        self.unknowns = Unknowns(body, prior, lambda mesh: embed(mesh, rest, names=names))
        self._rider = embed(body.mesh, rest, names=names)
        self._assembler = Assembler(body)
        self._single = single
        self._options = NewtonOptions(tolerance=tolerance)
        self.watch = self._rows()
        held = held_nodes(body)
        self._held = (3 * held[:, None] + np.arange(3)).ravel()
        self.forget()

    def forget(self):
        """Forget all that was solved: what follows depends on what is asked from now on only."""
        self._solver = StaticSolver(self.model.body, options=self._options,
                                    assembler=self._assembler)
        self._linearisation, self.derivatives = None, None

    @property
    def mesh(self):
        """TetMesh that states belong to."""
        return self.model.body.mesh

    def _rows(self):
        """(3n, 3w) d point coordinates / d x, transposed."""
        W = self._rider.matrix(len(self.mesh.nodes)).toarray()
        rows = np.zeros((*W.T.shape, 3, 3))
        rows[:, :, range(3), range(3)] = W.T[:, :, None]
        return rows.transpose(0, 2, 1, 3).reshape(3 * W.shape[1], 3 * W.shape[0])

    def points(self, x):
        """Return the positions (w, 3) [m] of markers and targets at node positions x (n, 3)."""
        return interpolate(self._rider, x)

    def moves(self, moved):
        """Return how far (w, 3) [m] markers and targets go with nodes that move by (n, 3) [m]."""
        return interpolate(self._rider, moved)

    def strain(self, x):
        """Return |F - I| (w,), Frobenius norm, of the tissue at the points."""
        F = np.einsum('kai,kaj->kij', x[self._rider.nodes], self._rider.gradients)
        return np.linalg.norm(F - np.eye(3), axis=(1, 2))

    def rest(self):
        """Return the equilibrium (n, 3) [m] at zero travel. Raises NotConverged."""
        return self.solve(self.mesh.nodes, np.zeros(len(self.model.directions)))

    def solve(self, x0, q, fields=None, offset=0.0):
        """Return the equilibrium (n, 3) [m] at travel q (p,) [m], sought from x0.

        fields : StepFields, None = the body's own;  offset : (n, 3) [m] of held nodes
        Raises NotConverged, with the outcome's advice.
        """
        held = self._solver.held_positions(self.model.pad_displacement(q)) + offset
        found = self._solver.follow(x0, held, fields)
        if not found.outcome.ok:
            raise NotConverged(f'forward model at {np.round(1e3 * np.asarray(q), 2).tolist()} mm: '
                               f'{found.outcome.advice}')
        return found.x

    def linearise(self, x, fields=None):
        """Return the jacobian.Linearisation at an equilibrium x; good until the next call."""
        if self._linearisation is None:
            self._linearisation = Linearisation(self._solver, x, fields, single=self._single)
        else:
            self._linearisation.move_to(x, fields)
        return self._linearisation

    def response(self, x, q, fields=None, known=None):
        """Return d points / d unknowns, (3w, k) [m per standard deviation], by the adjoint.

        x : (n, 3) [m] equilibrium at travel q (p,) [m] with `fields`
        known : (n, 3) [N] of the known loads among them, None = there are none
        One back-solve for each coordinate of a point, whatever the number of unknowns. What it
        was made of stays in `derivatives`.
        """
        linearisation = self.linearise(x, fields)
        self.derivatives = found = self.unknowns.derivatives(linearisation, q, known)
        pads = np.zeros((3 * len(self.model.directions), self.watch.shape[1]))
        a, h = linearisation.adjoint(self.watch, pads)
        held = self._held
        return (h[held].T @ found.motion[held] - a.T @ found.rate
                + found.shift.reshape(-1, found.shift.shape[2]))

    def pad_response(self):
        """Return d (points, x) / d travel of the pads, (3w + 3n, p) [1], after a `response`."""
        motion = np.zeros((self.watch.shape[0], len(self.model.directions)))
        for i, pad in enumerate(self.model.body.pads):
            motion[(3 * pad.nodes[:, None] + np.arange(3)).ravel(), i] = np.tile(
                pad.direction, len(pad.nodes))
        moved = self._linearisation.respond(motion)
        return np.vstack([self.watch.T @ moved, moved])

    def nodal_response(self, x, q, fields=None):
        """Return d x / d unknowns, (3n, k): one back-solve for each unknown."""
        found = self.unknowns.derivatives(self.linearise(x, fields), q)
        return self._linearisation.respond(found.motion, found.rate)

    def yield_to(self, force):
        """Return the displacement (n, 3) [m] by nodal forces (n, 3) [N], to first order.

        About the state of the last `response`; one back-solve.
        """
        force = np.ravel(force)[:, None]
        return self._linearisation.respond(np.zeros_like(force), -force).reshape(-1, 3)

    def nodal_change(self, change):
        """Return the change (n, 3) [m] of the nodes by a change (k,) of the unknowns.

        To first order about the state of the last `response`; one back-solve.
        """
        found = self.derivatives
        moved = self._linearisation.respond((found.motion @ change)[:, None],
                                            (found.rate @ change)[:, None])
        return moved.reshape(-1, 3)
