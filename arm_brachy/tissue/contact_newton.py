"""Newton for tissue in frictional contact: inexact corrections, solved in a Krylov space.

The balance g(x) = 0 with the friction limit mu p(x) of the same x has no potential, and its
derivative J is unsymmetric. One positive definite factor P serves in three ways: it preconditions
the corrections J d = -g (GMRES in the inner product of P, so that what is minimised is the
residual's norm below); it measures how far from balance a state is, (g' P^-1 g)^1/2, whatever the
units; and it is kept from step to step, because J always knows which points touch and slide now.
A correction is cut in halves until the norm falls in proportion; with J exact it does, unless
points change between open, stick and slip on the way, where it is only a Newton step of one piece
(semismooth: Qi & Sun 1993, Math Program 58:353; inexact: Eisenstat & Walker 1994, SIAM J Optim
4:393; friction in this form: Alart & Curnier 1991, Comput Methods Appl Mech Eng 92:353).
"""

import numpy as np

from arm_brachy.core.errors import NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.newton import StaticSolver


class OutOfBalance(NotConverged):
    """No balance was found; `outcome` says why."""

    def __init__(self, outcome):
        super().__init__(outcome.advice)
        self.outcome = outcome


class ContactNewton(StaticSolver):
    """A StaticSolver on a ContactAssembler, with `balance` beside the methods of its parent.

    body : SoftBody;  options : NewtonOptions;  assembler : contact.ContactAssembler
    contact : contact_solver.ContactOptions
    Unlike its parent it does not tell stable from unstable equilibria.
    """

    def __init__(self, body, *, options, assembler, contact):
        super().__init__(body, options=options, assembler=assembler)
        self.contact = contact
        self._stiffness, self._spread = None, np.zeros(3 * assembler.n)

    @property
    def ready(self):
        """True once there is a factor to start from."""
        return self._factor.factorised and self._stiffness is not None

    def balance(self, x, fields, counts):
        """Return (x (n, 3) [m], its Evaluation) in balance with the bodies as they are placed.

        x : (n, 3) [m] start, held nodes where they are to be;  fields : StepFields
        counts : dict with 'iterations', 'factorisations' and 'solves', counted up
        Begins with the factor it has: see `prepare`. Converged when the correction outstanding is
        within `NewtonOptions.tolerance`: the next one, or, by both estimates at hand after one is
        made, P^-1 g and the correction times what it left of the norm. Raises OutOfBalance.
        """
        now, z = self._look(x, fields, counts)
        if now is None:
            raise OutOfBalance(Outcome.INVERTED_ELEMENT)
        last, fresh = np.inf, False
        for _ in range(self.contact.max_iterations):
            size, before = np.abs(z).max(initial=0.0), counts['solves']
            if size > self.contact.contraction * last:
                self._stiffness = self.assembler.inner.tangent(x, fields)
            move, left = self._correct(x, now, z, counts)
            if left <= self.contact.forcing and np.abs(move).max() <= self.options.tolerance:
                return x, now
            found = self._search(x, now, z, move, left, fields, counts)
            if found is None and fresh:
                raise OutOfBalance(Outcome.NOT_CONVERGED)
            if found is not None:
                x, now, z, outstanding = found
                if outstanding <= self.options.tolerance:
                    return x, now
            last, fresh = size, found is None or counts['solves'] - before > self.contact.patience
            if fresh:
                self.prepare(x, fields, counts)
                now, z = self._look(x, fields, counts)
        raise OutOfBalance(Outcome.NOT_CONVERGED)

    def minimise(self, x, held_at, fields, counts):
        """Return (n, 3) [m]: the minimum of the potential with friction limits as they are.

        x, fields, counts : as in `balance`;  held_at : (n, 3) [m]. Raises OutOfBalance.
        """
        found = self.solve_held(x, held_at, fields)
        counts['iterations'] += found.iterations
        counts['factorisations'] += found.factorisations
        if not found.outcome.ok:
            raise OutOfBalance(found.outcome)
        return found.x

    def prepare(self, x, fields, counts):
        """Factorise the tangent at x (n, 3) [m], friction limits lagged, for `balance`.

        fields, counts : as there. Raises OutOfBalance.
        """
        try:
            self._factorise(x, fields, counts)
        except NotConverged as failure:
            raise OutOfBalance(Outcome.NOT_CONVERGED) from failure
        self._stiffness = self.assembler.inner.tangent(x, fields)

    def solve_free(self, force):
        """Return the displacements (f, 3) [m] of the free nodes under `force` (3f,) [N]."""
        return self._factor.solve(force).reshape(-1, 3)

    def _look(self, x, fields, counts):
        """(Evaluation, P^-1 g) at x with friction renewed there; None twice if it is inverted."""
        self.assembler.renew(x)
        now = self.assembler.evaluate(x, fields)
        if not now.min_J > 0.0:
            return None, None
        counts['solves'] += 1
        return now, self._factor.solve(self._residual(now))

    def _residual(self, state):
        return state.forces[self.free.free].ravel()

    def _correct(self, x, now, z, counts):
        """GMRES on J d = -g: (d (n, 3), the part of the norm of g that it leaves).

        Directions v are kept with their images u = P v: u_i . v_j = 1 for i = j, else 0.
        """
        jacobian, most = self.assembler.linearised(self._stiffness, x), self.contact.max_krylov
        g = self._residual(now)
        norm = np.sqrt(max(_dot(g, z), 0.0))
        move = np.zeros_like(x)
        if norm == 0.0:  # at rest and untouched
            return move, 0.0
        u, v, H = np.empty((most + 1, len(g))), np.empty((most + 1, len(g))), np.zeros(
            (most + 1, most))
        u[0], v[0] = g / norm, z / norm
        target = np.zeros(most + 1)
        target[0] = norm
        for k in range(most):
            self._spread[self.free.dofs] = v[k]
            u[k + 1] = (jacobian @ self._spread)[self.free.dofs]
            v[k + 1] = self._factor.solve(u[k + 1])
            counts['solves'] += 1
            H[:k + 1, k] = np.einsum('ki,i->k', v[:k + 1], u[k + 1])
            u[k + 1] -= np.einsum('k,ki->i', H[:k + 1, k], u[:k + 1])
            v[k + 1] -= np.einsum('k,ki->i', H[:k + 1, k], v[:k + 1])
            H[k + 1, k] = np.sqrt(max(_dot(u[k + 1], v[k + 1]), 0.0))
            y = np.linalg.lstsq(H[:k + 2, :k + 1], target[:k + 2], rcond=None)[0]
            left = np.linalg.norm(H[:k + 2, :k + 1] @ y - target[:k + 2]) / norm
            if left <= self.contact.forcing:
                break
            u[k + 1] /= H[k + 1, k]
            v[k + 1] /= H[k + 1, k]
        move[self.free.free] = -np.einsum('k,ki->i', y, v[:k + 1]).reshape(-1, 3)
        return move, left

    def _search(self, x, now, z, move, left, fields, counts):
        """Halve the correction until the squared norm falls by a fifth of what it promises.

        Returns (x, Evaluation, P^-1 g, correction [m] outstanding), or None if it never does.
        """
        norm, length = _dot(self._residual(now), z), 1.0
        for _ in range(self.options.max_backtracks):
            now, z = self._look(x + length * move, fields, counts)
            if now is not None:
                new = _dot(self._residual(now), z)
                if new <= (1.0 - 0.2 * length * (1.0 - left)) * norm:
                    counts['iterations'] += 1
                    rest = np.sqrt(max(new, 0.0) / norm) if norm > 0.0 else 0.0
                    outstanding = max(rest * np.abs(move).max(), np.abs(z).max(initial=0.0))
                    return x + length * move, now, z, outstanding
            length /= 2.0
        return None


def _dot(a, b):
    """Sum of products in one fixed order, however many threads."""
    return float(np.einsum('i,i->', a, b))
