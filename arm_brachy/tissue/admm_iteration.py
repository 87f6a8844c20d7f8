"""One iterate of ADMM and the two steps that move it, (3.11) and (3.12)-(3.13)."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.tissue import admm_kernels, kernels, proximal
from arm_brachy.tissue.admm_weights import elastic_stress
from arm_brachy.tissue.body import StepFields


@dataclass
class Problem:
    """One minimisation: (3.9) with everything that stays fixed during the iterations.

    inertia : (n,) M / dt^2 [N/m], zeros if quasi-static;  free_flight : (n, 3) x + v dt [m]
    load : (n, 3) dead loads [N];  held_at : (n, 3) [m], rows of held nodes count
    """

    fields: StepFields
    inertia: np.ndarray
    free_flight: np.ndarray
    load: np.ndarray
    held_at: np.ndarray

    def nodal_force(self, x, springs, rest):
        """Return (n, 3) [N] of loads, inertia and ground springs on the nodes at x (n, 3) [m]."""
        force = self.load - self.inertia[:, None] * (x - self.free_flight)
        stretch = (x - rest)[springs.nodes]
        force[springs.nodes] -= np.einsum('sij,sj->si', springs.stiffness, stretch)
        return force

    def nodal_energy(self, x, springs, rest):
        """Return the potential [J] of `nodal_force`."""
        stretch = (x - rest)[springs.nodes]
        flown = np.sum((x - self.free_flight) ** 2, axis=1)
        return float(0.5 * np.sum(self.inertia * flown) - np.sum(self.load * (x - rest))
                     + 0.5 * np.einsum('si,sij,sj->', stretch, springs.stiffness, stretch))


class Iteration:
    """Positions x, matrices z and scaled multipliers u of a solve, and their merit.

    solver : AdmmSolver;  problem : Problem;  x : (n, 3) [m] start, changed in place
    F : (9, m) D x;  z, u : (9, m);  weights : Weights
    merit : [J] augmented Lagrangian at (x, z, u) after `global_step`
    square, largest : |F - z|_W^2 [J] and max |F - z|
    Raises InputError if an element is inverted at the start.
    """

    def __init__(self, solver, problem, x):
        self._solver, self.problem, self.x = solver, problem, x
        fields, m = problem.fields, len(solver.volume)
        self._stress = np.ascontiguousarray(
            fields.stress.reshape(-1, 3, 3)[:m if fields.stress.any() else 0])
        self._parts, self._pull = np.empty((m, 4, 3)), np.empty_like(x)
        chunks = (m + proximal.CHUNK - 1) // proximal.CHUNK
        self._sums, self.sweeps = np.zeros((chunks, 3)), np.zeros(chunks)
        self.F = np.empty((9, m))
        corners, G = x[solver.conn].transpose(2, 1, 0), solver.G.transpose(2, 1, 0)
        self.z = np.ascontiguousarray(
            np.sum(corners[:, None] * G[None], axis=2).reshape(9, m))
        # The multiplier that balances the stress at x, so that an equilibrium stays put.
        self._multiplier = solver.volume * elastic_stress(self.z, fields.mu, fields.kappa)
        if not np.isfinite(self._multiplier).all():
            raise InputError('x0 holds an inverted element; start from a valid state, e.g. rest')
        self.u, self.weights = np.zeros((9, m)), None
        x[solver.held] = problem.held_at[solver.held]

    def reweigh(self, weights):
        """Change the weights, keep z and the multipliers W u; `global_step` must follow.

        weights : Weights
        """
        multiplier = self._multiplier if self.weights is None else self.weights.apply(self.u)
        self.u[:] = weights.solve(multiplier)
        self._solver.update.factor(weights, self._stress, self.problem.inertia)
        if self.weights is None:  # D x of the start, with the held nodes where they go
            self.weights = weights
            self._look()
        self.weights = weights

    def local_step(self, Y, tolerance):
        """(3.12)-(3.13) from the last z: z near Y (9, m), u = Y - z.

        tolerance : last Newton step
        """
        w, fields = self.weights, self.problem.fields
        proximal.local_step(Y, self.z, self.u, w.n, w.alpha, w.beta, self._solver.volume,
                            fields.mu, fields.kappa, tolerance, self.sweeps)

    def global_step(self):
        """(3.11): x to the minimum for the present z and u; then look what it came to."""
        solver, w = self._solver, self.weights
        admm_kernels.pulls(self.F, self.z, self.u, w.n, w.alpha, w.beta, solver.volume,
                           self._stress, solver.G, self._parts)
        kernels.gather(*solver.starts, self._parts.reshape(-1, 3), self._pull)
        self._pull += self.problem.nodal_force(self.x, solver.body.springs, solver.body.mesh.nodes)
        self.x[solver.free] += solver.update.solve(self._pull)
        self._look()

    def _look(self):
        solver, w, fields = self._solver, self.weights, self.problem.fields
        admm_kernels.look(self.x, solver.conn, solver.G, self.z, self.u, w.n, w.alpha, w.beta,
                          solver.volume, fields.mu, fields.kappa, self._stress, self.F,
                          self._sums)
        merit, self.square = self._sums[:, :2].sum(axis=0)
        self.largest = self._sums[:, 2].max(initial=0.0)
        self.merit = merit + self.problem.nodal_energy(self.x, solver.body.springs,
                                                       solver.body.mesh.nodes)

    def reaction(self):
        """Out-of-balance forces (n, 3) [N] of the energy with inertia; None if inverted."""
        state = self._solver.assembler.evaluate(self.x, self.problem.fields)
        inertia = self.problem.inertia[:, None] * (self.x - self.problem.free_flight)
        return state.forces + inertia if state.min_J > 0.0 else None
