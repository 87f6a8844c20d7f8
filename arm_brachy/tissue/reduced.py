"""A reduced model of a SoftBody for kilohertz: few coordinates, few quadrature points.

The ansatz is x = X_r + L d + V q: X_r the equilibrium with the pads at rest, L the linear-elastic
answer to each pad's translation, V modes that leave pads and fixed nodes alone. Pads are met and
the rest state is found exactly, whatever V is. Equilibrium is the minimum over q of
    Pi(d, q) = sum_s w_s Psi(F_s) + b . y + 1/2 y' C y,     F_s = F_s(X_r) + B_s y,  y = (d, q)
over sampled quadrature points s; b and C are constant and make forces and tangent at rest those of
the whole body. Minus dPi/dd is the force of the tissue on the pads. Its tangent is symmetric; that
it is positive definite is checked in every solve. `hyper_reduction.train` makes a model.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from arm_brachy.core.errors import ArmBrachyError, InputError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity
from arm_brachy.tissue import reduced_kernels as kernels


@dataclass(frozen=True)
class ReducedOptions:
    """When to stop, when to refactorise, when to give up."""

    tolerance: float = quantity(
        1e-6, 'mm', 'largest nodal correction still outstanding at convergence', low=1e-10,
        source='four decades below what the modes leave out')
    max_iterations: int = 30
    max_bisections: int = 6             # smallest load step 2^-6 of the command
    contraction: float = 0.2            # keep the factor while corrections shrink faster than this
    chord: float = 0.3                  # `follow` keeps it longer: it costs five corrections
    sufficient_decrease: float = 1e-4   # Armijo constant, Nocedal & Wright (2006), sec. 3.1
    max_backtracks: int = 10


@dataclass(frozen=True)
class ReducedSolution:
    """What a reduced solve came to. If `outcome` is not OK, q is the q0 it was given.

    q : (r,) [sqrt(J)];  pad_displacement : (p, 3) [m] as commanded
    pad_force : (p, 3) [N] of the tissue ON each pad; NaN if not OK
    iterations, factorisations, load_steps : as in newton.StaticSolution
    residual : [m] bound on the nodal correction outstanding; NaN if not OK
    min_J : smallest det F among the sampled points; NaN if not OK
    message : what happened and what to do; '' if OK
    """

    q: np.ndarray
    pad_displacement: np.ndarray
    pad_force: np.ndarray
    iterations: int
    factorisations: int
    load_steps: int
    residual: float
    min_J: float
    outcome: Outcome
    message: str


class _Failed(ArmBrachyError):
    """No equilibrium at one load step; `outcome` says why."""

    def __init__(self, outcome):
        super().__init__(outcome.advice)
        self.outcome = outcome


class ReducedSolver:
    """Finds where a ReducedModel rests for given pad displacements.

    model : ReducedModel;  options : ReducedOptions
    `solve` depends on its arguments alone: equal arguments, equal bits, for any number of threads.
    `follow` depends also on what was solved before. Not to be shared between threads. Static and
    elastic: terms that change moduli or stress in a step are not in it.
    """

    def __init__(self, model, *, options=None):
        self.model = model
        self.options = ReducedOptions() if options is None else options
        self._held = 3 * model.n_pads
        self._Bt = np.ascontiguousarray(model.B.T)
        self._mode_B = np.ascontiguousarray(model.B[:, self._held:])
        self._F = np.empty_like(model.F0)
        self._last = None  # factor of the last exact tangent, for `follow`
        modes = model.basis[:, :, self._held:]
        # no node moves farther than this per unit of |dq|
        self._stretch = np.sqrt(np.einsum('niw,niw->n', modes, modes).max(initial=0.0))

    @property
    def rest(self):
        """The coordinates (r,) of the rest state: zeros, a start for `solve`."""
        return np.zeros(self.model.n_modes)

    def solve(self, q0, pad_displacement):
        """Return the ReducedSolution with the pads displaced from rest by `pad_displacement`.

        q0 : (r,) [sqrt(J)] starting point, best the last solution's q;  pad_displacement : (p, 3)
        [m], world frame
        Where Newton from q0 fails, the pads come from rest in as many load steps as it takes.
        Outside `model.domain` nothing is computed: outcome REJECTED.
        Raises InputError for arguments of the wrong shape or not finite.
        """
        q0, d = self._start(q0, pad_displacement)
        complaint = self.model.domain.complaint(d)
        if complaint:
            return self._nothing(q0, d, Outcome.REJECTED, complaint)
        counts = {'iterations': 0, 'factorisations': 0, 'load_steps': 0}
        try:
            try:
                return self._equilibrium(np.concatenate([d.ravel(), q0]), counts)
            except _Failed:
                return self._from_rest(d, counts)
        except _Failed as failure:
            return self._nothing(q0, d, failure.outcome, failure.outcome.advice, **counts)

    def follow(self, q0, pad_displacement):
        """The same as `solve`, faster where solutions succeed each other in small steps.

        The last factor serves, however old, while each correction is at most `chord` times the
        one before; otherwise `solve` takes over. Raises as it does.
        """
        q0, d = self._start(q0, pad_displacement)
        found = None
        if self._last is not None and not self.model.domain.complaint(d):
            found = self._chord(np.concatenate([d.ravel(), q0]))
        return self.solve(q0, d) if found is None else found

    def _chord(self, y):
        """ReducedSolution by the old factor, or None where it does not serve any more."""
        last = np.inf
        for iterations in range(self.options.max_iterations):
            state = self._evaluate(y)
            direction = -cho_solve(self._last, state[1][self._held:], check_finite=False)
            size = self._stretch * np.linalg.norm(direction)
            if not state[2] > 0.0 or size > self.options.chord * last:
                return None
            if size <= self.options.tolerance:
                counts = {'iterations': iterations, 'factorisations': 0, 'load_steps': 1}
                return self._solution(y, state, size, counts)
            y, last = y.copy(), size
            y[self._held:] += direction
        return None

    def jacobian(self, solution, watch):
        """Return d point / d pad displacement, (k, 3, p, 3) [m/m].

        solution : ReducedSolution;  watch : reduced_basis.Watch of the k points
        Raises NotConverged if the solution is not OK or not a stable equilibrium.
        """
        _, follow = self._linearised(solution)
        J = watch.basis[:, :, :self._held] + watch.basis[:, :, self._held:] @ follow
        return J.reshape(len(J), 3, self.model.n_pads, 3)

    def pad_stiffness(self, solution):
        """Return d pad force / d pad displacement, (p, 3, p, 3) [N/m], symmetric.

        solution : ReducedSolution; sign and errors as in `jacobian` and jacobian.pad_stiffness
        """
        H, follow = self._linearised(solution)
        h = self._held
        stiffness = H[:h, :h] + H[:h, h:] @ follow
        return -stiffness.reshape(self.model.n_pads, 3, self.model.n_pads, 3)

    def potential(self, pad_displacement, q):
        """Return (energy [J] above rest, gradient (w,)) of the reduced potential at (d, q).

        pad_displacement : (p, 3) [m];  q : (r,). The energy is inf if a sample is inverted.
        """
        y = np.concatenate([np.ravel(pad_displacement), q])
        energy, gradient, _ = self._evaluate(y)
        return energy, gradient

    def tangent(self, pad_displacement, q):
        """Return the second derivative (w, w) of the reduced potential at (d, q), symmetric.

        pad_displacement : (p, 3) [m];  q : (r,); no sampled point may be inverted
        """
        self._evaluate(np.concatenate([np.ravel(pad_displacement), q]))
        return self._tangent(0, convex=False)

    def _start(self, q0, pad_displacement):
        """Both as arrays, refused if of the wrong shape or not finite."""
        q0, d = np.array(q0, dtype=float), np.array(pad_displacement, dtype=float)
        for name, array, shape in (('q0', q0, (self.model.n_modes,)),
                                   ('pad_displacement', d, (self.model.n_pads, 3))):
            if array.shape != shape or not np.isfinite(array).all():
                raise InputError(f'{name} has shape {array.shape} or is not finite; must be '
                                 f'{shape} finite numbers')
        return q0, d

    def _nothing(self, q0, d, outcome, message, iterations=0, factorisations=0, load_steps=0):
        return ReducedSolution(q0, d, np.full_like(d, np.nan), iterations, factorisations,
                               load_steps, np.nan, np.nan, outcome, message)

    def _evaluate(self, y):
        """(energy, gradient, smallest J) at y; deformation gradients stay in `_F`."""
        m = self.model
        kernels.deform(m.F0, self._Bt, y, self._F)
        gradient = np.empty_like(y)
        energy, min_J = kernels.potential(self._F, m.B, m.weights, m.mu, m.kappa, m.stress,
                                          gradient)
        curved = m.quadratic @ y
        return energy + m.linear @ y + 0.5 * (curved @ y), gradient + m.linear + curved, min_J

    def _tangent(self, first, *, convex):
        """Rows and columns from `first` on, at the state evaluated last."""
        m = self.model
        B = self._mode_B if first else m.B
        AB, H = np.empty_like(B), np.empty((B.shape[1], B.shape[1]))
        kernels.stiffen(self._F, B, m.weights, m.mu, m.kappa, m.stress, convex, AB)
        kernels.project(B, AB, H)
        return H + m.quadratic[first:, first:]

    def _factor(self, counts):
        """(Cholesky factor of the q block at the state evaluated last, True if it is exact)."""
        counts['factorisations'] += 1
        for convex in (False, True):
            try:
                factor = cho_factor(self._tangent(self._held, convex=convex), lower=True,
                                    check_finite=False)
            except LinAlgError:
                continue
            self._last = None if convex else factor
            return factor, not convex
        raise _Failed(Outcome.NOT_CONVERGED)

    def _from_rest(self, d, counts):
        """The solution after the pads went from rest to d (p, 3) step by step."""
        t, step, q = 0.0, 0.5, self.rest
        while True:
            ahead = min(1.0, t + step)
            try:
                found = self._equilibrium(np.concatenate([ahead * d.ravel(), q]), counts)
            except _Failed:
                step /= 2.0
                if step < 0.5 ** self.options.max_bisections:
                    raise
                continue
            if ahead == 1.0:
                return found
            t, q = ahead, found.q

    def _equilibrium(self, y, counts):
        """ReducedSolution by Newton on q from y = (d, q); raises _Failed."""
        state, size, fresh = self._evaluate(y), np.inf, True
        if not state[2] > 0.0:
            raise _Failed(Outcome.INVERTED_ELEMENT)
        factor, exact = self._factor(counts)
        for _ in range(self.options.max_iterations):
            direction = -cho_solve(factor, state[1][self._held:], check_finite=False)
            last, size = size, self._stretch * np.linalg.norm(direction)
            if size <= self.options.tolerance and exact:
                counts['load_steps'] += 1
                return self._solution(y, state, size, counts)
            if not fresh and (not exact or size > self.options.contraction * last):
                factor, exact = self._factor(counts)
                direction = -cho_solve(factor, state[1][self._held:], check_finite=False)
            y, state = self._line_search(y, state, direction)
            counts['iterations'] += 1
            fresh = False
        raise _Failed(Outcome.NOT_CONVERGED)

    def _line_search(self, y, state, direction):
        """Halve the step until the potential falls enough and no sampled point is inverted."""
        slope = float(state[1][self._held:] @ direction)
        noise = 1e-10 * abs(state[0])
        length = 1.0
        for _ in range(self.options.max_backtracks):
            ahead_y = y.copy()
            ahead_y[self._held:] += length * direction
            ahead = self._evaluate(ahead_y)
            gain = self.options.sufficient_decrease * length * slope
            # near the solution the energy only shows rounding: there a falling slope decides
            settled = abs(ahead[1][self._held:] @ direction) <= 0.5 * abs(slope)
            if ahead[2] > 0.0 and (ahead[0] <= state[0] + gain
                                   or (ahead[0] <= state[0] + noise and settled)):
                return ahead_y, ahead
            length /= 2.0
        raise _Failed(Outcome.NOT_CONVERGED if ahead[2] > 0.0 else Outcome.INVERTED_ELEMENT)

    def _solution(self, y, state, size, counts):
        d, force = (v[:self._held].reshape(-1, 3) for v in (y, -state[1]))
        return ReducedSolution(y[self._held:], d, force, **counts, residual=float(size),
                               min_J=float(state[2]), outcome=Outcome.OK, message='')

    def _linearised(self, solution):
        """(tangent (w, w), dq/dd (r, 3p)) at a ReducedSolution."""
        if not solution.outcome.ok:
            raise NotConverged(f'no linearisation without equilibrium: {solution.message}')
        H = self.tangent(solution.pad_displacement, solution.q)
        h = self._held
        try:
            factor = cho_factor(H[h:, h:], lower=True)
        except LinAlgError:
            raise NotConverged('no linearisation: the reduced tangent is not positive definite '
                               'at this state; it is no stable equilibrium') from None
        return H, -cho_solve(factor, H[h:, :h])
