"""How a body in equilibrium answers to small pad motions (3.19)-(3.24): one factor, back-solves.

The three functions at the end linearise and answer one question. For several questions at one
state, or for parameters other than pad motion (`sensitivity`), make a `Linearisation`.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.tissue.assembly import Assembler, InvertedElement
from arm_brachy.tissue.body import SoftBody, StepFields
from arm_brachy.tissue.free_dofs import FreeDofs, held_nodes
from arm_brachy.tissue.linear_solver import FactorisationFailed

WORST_SOLVE = 1e-3  # relative error of a back-solve above which single precision does not do


@dataclass(frozen=True)
class Equations:
    """The equations of a body, for a Linearisation at a state that is known without solving.

    body : SoftBody;  assembler : Assembler;  free : FreeDofs
    """

    body: SoftBody
    assembler: Assembler
    free: FreeDofs

    @classmethod
    def of(cls, body):
        """Equations of a SoftBody with pads bonded."""
        assembler = Assembler(body)
        return cls(body, assembler, FreeDofs(assembler, held_nodes(body)))


class Linearisation:
    """The equations of a body linearised at one equilibrium, the tangent factorised once.

    solver : newton.StaticSolver, or Equations;  x : (n, 3) [m] an equilibrium of its body
    fields : StepFields the equilibrium was found with, None = the body's own
    shared : False: a factor of its own, analysed once, good until `move_to` whatever the solver
        does meanwhile. True: the solver's, without analysis; good until the solver's next call,
        and `follow` goes on from it
    single : a factor of its own in single precision, answers good to some 1e-5 of themselves;
        in double where that does not do
    Raises NotConverged where the free part K_ff of the tangent is not positive definite (x is no
    stable equilibrium) or an element is inverted.

    Held nodes (c) move as prescribed, the others (f) follow so that their force stays zero:
        K_ff dx_f + K_fc dx_c + df_f = 0,  df the change of the forces with x held
    Where x is no equilibrium the derivatives are those of the body with the force out of balance
    at x applied to it as a dead load; `outstanding` tells. Statics only: no inertia, no damping;
    terms with memory enter as `fields`, which do not change with x. Not to be shared between
    threads.
    """

    def __init__(self, solver, x, fields=None, *, shared=False, single=False):
        self.solver = solver
        self._shared, self._single = shared, single
        self._factor = None if shared else solver.free.solver(single=single)
        held = solver.free.held
        self._held = (3 * held[:, None] + np.arange(3)).ravel()
        self._pads = pad_translations(solver.body)
        self.move_to(x, fields)

    def move_to(self, x, fields=None):
        """Linearise at another equilibrium; the analysis is kept.

        x, fields : as of the class. Raises as it does: for an inverted element the object stays
        where it was, after a tangent that is not positive definite it answers nothing until moved.
        """
        x = np.array(x, dtype=float)
        fields = StepFields.of(self.solver.body) if fields is None else fields
        try:
            self._forces = self.solver.assembler.forces(x, fields)
        except InvertedElement as error:
            raise NotConverged(f'no linearisation at this state: {error}') from None
        if self._shared:
            self.K, self._factor = self.solver.linearise(x, fields)
        else:
            self.K = self._factorise(x, fields)
        self.x, self.fields = x, fields
        self._K_held = self.K[self._held]   # K is symmetric: its columns too

    def _factorise(self, x, fields):
        tangent = self.solver.assembler.tangent(x, fields)
        upper = self.solver.free.upper(tangent)
        if self._single and not self._suffices(tangent, upper):
            self._factor, self._single = self.solver.free.solver(), False
        if self._single:
            return tangent
        try:
            self._factor.factor(upper)
        except FactorisationFailed as error:
            raise NotConverged(f'no linearisation at this state: {error}') from None
        return tangent

    def _suffices(self, tangent, upper):
        """True if a factor in single precision knows the softest motions too."""
        try:
            self._factor.factor(upper)
        except FactorisationFailed:
            return False
        dofs, known = self.solver.free.dofs, np.zeros(len(self._pads))
        known[dofs] = 1.0
        found = self._factor.solve((tangent @ known)[dofs])
        return np.abs(found - 1.0).max(initial=0.0) <= WORST_SOLVE

    def outstanding(self):
        """Return the largest nodal correction [m] that Newton would still make at x."""
        correction = self._factor.solve(self._forces.ravel()[self.solver.free.dofs])
        return float(np.abs(correction).max(initial=0.0))

    def respond(self, motion, rate=None):
        """Return dx (3n, k) [m] of every node: the tangent problem, k right-hand sides at once.

        motion : (3n, k) [m] prescribed change of the held nodes; rows of free nodes are ignored
        rate : (3n, k) [N] change of `Assembler.forces` at fixed x, None = none
        """
        dx = np.zeros(motion.shape)
        dx[self._held] = motion[self._held]
        pull = self._K_held.T @ dx[self._held]
        if rate is not None:
            pull += rate
        dofs = self.solver.free.dofs
        dx[dofs] = -self._factor.solve(pull[dofs])
        return dx

    def pad_force_change(self, dx, rate=None):
        """Return the change (p, 3, k) [N] of the force of the tissue ON each pad.

        dx : (3n, k) [m] from `respond`;  rate : as given to it
        """
        change = self._K_held @ dx
        if rate is not None:
            change += rate[self._held]
        pads = self._pads[self._held]
        return -(pads.T @ change).reshape(len(self.solver.body.pads), 3, dx.shape[1])

    def adjoint(self, x_bar, pad_bar):
        """Return (a, h), both (3n, k): the adjoint problem, k right-hand sides at once.

        x_bar : (3n, k) dJ/dx of k scalars J;  pad_bar : (3p, k) [1/N] dJ/d pad_force
        For every change, dJ = h' motion - a' rate, with motion and rate as in `respond`: with E
        the pads' translations, a = K_ff^-1 (x_bar - K E pad_bar) on free nodes and E pad_bar on
        held ones, and h = x_bar - K a, which is zero on free nodes.
        """
        a = self._pads @ pad_bar
        dofs = self.solver.free.dofs
        a[dofs] = self._factor.solve((x_bar - self._K_held.T @ a[self._held])[dofs])
        h = np.zeros_like(a)
        h[self._held] = x_bar[self._held] - self._K_held @ a
        return a, h

    def compliance(self, loads):
        """Return the motion (k, k) [m/N] along k patterns of load by each of them.

        loads : (3n, k) sparse; what falls on held nodes does nothing
        """
        loads = loads[self.solver.free.dofs]
        moved = loads.T @ self._factor.solve(loads.toarray())
        return 0.5 * (moved + moved.T)

    def stiffness(self, rows):
        """Return the force (k, k) [N/m] on k rows of held nodes by a motion of each of them."""
        dofs, to_all = self.solver.free.dofs, self.K[rows]
        follow = self._factor.solve(to_all[:, dofs].T.toarray())
        return to_all[:, rows].toarray() - to_all[:, dofs] @ follow

    def state_sensitivity(self):
        """Return d x / d pad displacement, (n, 3, p, 3) [m/m].

        A pad translates as a rigid disc: dx_f = -K_ff^-1 K_fc E d. The force form (3.22) with
        every pad node a control point gives the same: J_c' K^-1 J_c is the inverse of the Schur
        complement of K on the control points.
        """
        return self.respond(self._pads).reshape(*self.x.shape, len(self.solver.body.pads), 3)

    def target_jacobian(self, embedding):
        """Return d target position / d pad displacement, (k, 3, p, 3) [m/m], (3.23).

        embedding : mesh.Embedding of the k targets
        """
        return _carried(embedding, self.state_sensitivity())

    def directed_jacobian(self, embedding):
        """Return d target position / d push of each pad along its direction, (k, 3, p) [m/m].

        embedding : as in `target_jacobian`. One right-hand side for each pad.
        """
        pads = self.solver.body.pads
        motion = np.zeros((len(self._pads), len(pads)))
        for p, pad in enumerate(pads):
            motion[:, p] = self._pads[:, 3 * p:3 * p + 3] @ pad.direction
        return _carried(embedding, self.respond(motion).reshape(*self.x.shape, len(pads)))

    def pad_stiffness(self):
        """Return d pad force / d pad displacement, (p, 3, p, 3) [N/m].

        Pad force is that of the tissue ON the pad (as in StaticSolution), so the matrix is
        symmetric negative definite: pushing a pad in raises the force that opposes it.
        """
        p = len(self.solver.body.pads)
        return self.pad_force_change(self.respond(self._pads)).reshape(p, 3, p, 3)


def _carried(embedding, dx):
    """Change (k, 3, ...) of embedded points that the change (n, 3, ...) of the nodes carries."""
    return np.einsum('ka,kai...->ki...', embedding.weights, dx[embedding.nodes])


def pad_translations(body):
    """Return E (3n, 3p): displacement of every degree of freedom per unit pad translation.

    body : SoftBody
    """
    motion = np.zeros((len(body.mesh.nodes), 3, len(body.pads), 3))
    for p, pad in enumerate(body.pads):
        motion[pad.nodes, :, p, :] = np.eye(3)
    return motion.reshape(3 * len(body.mesh.nodes), 3 * len(body.pads))


def target_jacobian(solver, x, embedding, fields=None):
    """Return d target position / d pad displacement, (k, 3, p, 3) [m/m], (3.23).

    solver, x, fields : as in `Linearisation`, raises as it does
    embedding : mesh.Embedding of the k targets
    """
    return Linearisation(solver, x, fields, shared=True).target_jacobian(embedding)


def directed_jacobian(solver, x, embedding, fields=None):
    """Return d target position / d push of each pad along its direction, (k, 3, p) [m/m].

    solver, x, embedding, fields : as in `target_jacobian`
    """
    return Linearisation(solver, x, fields, shared=True).directed_jacobian(embedding)


def pad_stiffness(solver, x, fields=None):
    """Return d pad force / d pad displacement, (p, 3, p, 3) [N/m].

    solver, x, fields : as in `target_jacobian`.  Symmetric negative definite
    """
    return Linearisation(solver, x, fields, shared=True).pad_stiffness()
