"""The thesis' solver: alternating directions over element deformation gradients, (3.9)-(3.14).

Quasi-static equilibrium drops the inertia term of (3.9); the dynamic form is backward Euler,
(3.2)-(3.5). Convergence is judged by the out-of-balance nodal forces of the energy itself: the
change from one iterate to the next says nothing, because the iteration can cycle for ever.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue import kernels, proximal
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.dynamics import pad_loads
from arm_brachy.tissue.element import signed_volumes
from arm_brachy.tissue.free_dofs import held_nodes
from arm_brachy.tissue.linear_solver import Pardiso
from arm_brachy.tissue.material import stress


@dataclass(frozen=True)
class AdmmOptions:
    """When to stop, and how hard elements are tied to their nodes.

    tolerance : largest out-of-balance component on a free node, as a fraction of the largest on a
        held one (a reaction); 2e-5 leaves about 3 um on the breast phantom
    max_iterations : of (3.11)-(3.13);  the thesis runs 800
    check_every : iterations between looks at the true residual, each about as dear as an iteration
    weight : c in w_i^2 = c kappa_i V_i (c = 1 is the usual choice, Overby et al. 2017, sec. 5.2)
    largest_weight : c is doubled up to this value (Boyd et al. 2011, sec. 3.4.1, multipliers
        rescaled) when the residual no longer falls: plain ADMM has two-cycles under large or
        opposing pushes. Equal to `weight` it leaves c alone
    patience : iterations, times c / weight, without a fall by a tenth that count as standstill
    """

    tolerance: float = 2e-5
    max_iterations: int = 3000
    check_every: int = 10
    weight: float = 1.0
    largest_weight: float = 16.0
    patience: int = 100

    def __post_init__(self):
        for name in ('tolerance', 'max_iterations', 'check_every', 'weight', 'patience'):
            if not getattr(self, name) > 0:
                raise ConfigError(f'admm: {name} = {getattr(self, name)}; must be > 0')
        if self.largest_weight < self.weight:
            raise ConfigError(f'admm: largest_weight = {self.largest_weight}; must be at least '
                              f'weight = {self.weight}')


# A residual that has not fallen below this fraction of the last best one counts as no progress.
PROGRESS = 0.9
# Out-of-balance force below which a body at rest is at rest: this times mean mu V^(2/3).
REST_FORCE = 1e-12


@dataclass(frozen=True)
class AdmmSolution:
    """What a solve came to.

    x : (n, 3) [m] last iterate, an equilibrium only if `outcome` is OK
    v : (n, 3) [m/s] velocity by (3.3), zero from `solve`
    pad_force : (p, 3) [N] of the tissue ON each pad (NaN if x is inverted)
    iterations : made;  weight : the c it ended with;  outcome : OK or NOT_CONVERGED
    checked : (k,) iterations after which the residual was taken
    residuals : (k,) [N] largest out-of-balance component on a free node, inf where inverted
    errors : (k,) [m] largest distance of a node from `reference`, empty if none was given
    """

    x: np.ndarray
    v: np.ndarray
    pad_force: np.ndarray
    iterations: int
    weight: float
    outcome: Outcome
    checked: np.ndarray
    residuals: np.ndarray
    errors: np.ndarray


@dataclass
class _Problem:
    """One minimisation: (3.9) with everything that stays fixed during the iterations.

    inertia : (n,) M / dt^2 [N/m], zeros if quasi-static;  free_flight : (n, 3) x + v dt [m]
    load : (n, 3) dead loads [N];  held_at : (n, 3) [m], rows of held nodes count
    """

    fields: StepFields
    inertia: np.ndarray
    free_flight: np.ndarray
    load: np.ndarray
    held_at: np.ndarray


class _GlobalStep:
    """The x update (3.11): its matrix, factorised, and the right-hand side's constant part.

    The added stress S of the fields is quadratic in x, so it stays here and not in the local step:
    the matrix is M / dt^2 + sum_i D_i' (w_i^2 I + V_i S_i) D_i, per axis, plus ground springs.
    """

    def __init__(self, solver, problem, w2):
        g, self.free = solver.geometry, solver.free
        G, conn = g.gradients[:, 0], g.connectivity
        tie = w2[:, None, None] * np.eye(3) + solver.volume[:, None, None] * problem.fields.stress
        blocks = np.einsum('mak,mkl,mbl->mab', G, tie, G)
        n = solver.assembler.n
        rows, cols = np.repeat(conn, 4, axis=1).ravel(), np.tile(conn, (1, 4)).ravel()
        matrix = sp.csr_array(sp.coo_array((blocks.ravel(), (rows, cols)), shape=(n, n)))
        matrix = sp.csr_array(matrix + sp.diags_array(problem.inertia))
        springs = solver.body.springs
        # Springs couple the axes; without them the three axes share one matrix a third the size.
        self.axes = 3 if len(springs.nodes) else 1
        self.unknown = self.free if self.axes == 1 else solver.free_dofs
        held = solver.held if self.axes == 1 else solver.held_dofs
        constant = problem.inertia[:, None] * problem.free_flight + problem.load
        if self.axes == 3:
            matrix = sp.csr_array(sp.kron(matrix, np.eye(3)) + _spring_matrix(springs, n))
            rest = solver.body.mesh.nodes[springs.nodes]
            np.add.at(constant, springs.nodes, np.einsum('sij,sj->si', springs.stiffness, rest))
        reduced = sp.csr_array(sp.triu(matrix[self.unknown][:, self.unknown]))
        reduced.sort_indices()
        self._solver = Pardiso(reduced.indptr, reduced.indices)
        self._solver.factor(reduced.data)
        moved = self._shape(problem.held_at)[held]
        self._constant = self._shape(constant)[self.unknown]
        self._constant -= matrix[self.unknown][:, held] @ moved

    def solve(self, pull):
        """Return free positions (f, 3) [m]; pull : (n, 3) [N] sum of w^2 D' (z - u)."""
        return self._solver.solve(self._constant + self._shape(pull)[self.unknown]).reshape(-1, 3)

    def _shape(self, nodal):
        return nodal.copy() if self.axes == 1 else nodal.reshape(-1).copy()


class AdmmSolver:
    """Equilibrium or one backward Euler step of a SoftBody by ADMM.

    body : SoftBody of linear tetrahedra;  options : AdmmOptions
    Equal arguments give equal bits for any number of threads. Not to be shared between threads.
    Slow against Newton wherever a factorisation is affordable; kept because the thesis' estimator
    is built on its iteration. Rayleigh damping is not part of (3.2) and is refused.
    """

    def __init__(self, body, options=None):
        if any(body.damping):
            raise ConfigError(f'admm: damping = {body.damping}; must be (0, 0), as (3.2) has none')
        self.body = body
        self.options = AdmmOptions() if options is None else options
        self.assembler = Assembler(body)
        self.geometry = self.assembler.geometry
        self.volume = signed_volumes(body.mesh.nodes, body.mesh.tets)
        self.held = held_nodes(body)
        self.free = np.setdiff1d(np.arange(self.assembler.n), self.held)
        self.held_dofs, self.free_dofs = (
            (3 * k[:, None] + np.arange(3)).ravel() for k in (self.held, self.free))
        self._mass = self.assembler.lumped_mass()
        self._starts = _slots(self.geometry.connectivity, self.assembler.n)

    def solve(self, x0, pad_displacement, fields=None, reference=None):
        """Return the AdmmSolution at rest with the pads displaced by `pad_displacement`.

        x0 : (n, 3) [m] starting state, no element inverted;  pad_displacement : (p, 3) [m]
        fields : StepFields, None = the body's own
        reference : (n, 3) [m] solution to measure the iterates against, e.g. Newton's
        Raises InputError. Valid for stable equilibria; test_admm.py::test_equals_newton.
        """
        nothing = np.zeros((self.assembler.n, 3))
        problem = self._problem(pad_displacement, fields, nothing[:, 0], nothing)
        return self._iterate(problem, x0, nothing, 1.0, reference)

    def step(self, x, v, pad_displacement, dt, fields=None, reference=None):
        """Return the AdmmSolution one backward Euler step (3.2)-(3.5) later.

        x, v : (n, 3) [m], [m/s] at t;  pad_displacement : (p, 3) [m] at t + dt;  dt : [s]
        fields, reference : as in `solve`
        First order in dt and strongly damping: modes above 1 / (2 pi dt) die within a step.
        Raises InputError. Test: test_admm.py::test_step_is_backward_euler.
        """
        if not dt > 0.0:
            raise InputError(f'dt = {dt} s; must be > 0')
        problem = self._problem(pad_displacement, fields, self._mass / dt**2, x + dt * v)
        return self._iterate(problem, x, v, dt, reference)

    def _problem(self, pad_displacement, fields, inertia, free_flight):
        fields = StepFields.of(self.body) if fields is None else fields
        moved = np.asarray(pad_displacement, dtype=float)
        if moved.shape != (len(self.body.pads), 3) or not np.isfinite(moved).all():
            raise InputError(f'pad_displacement has shape {moved.shape} or is not finite; must be '
                             f'({len(self.body.pads)}, 3) finite numbers in metres')
        held_at = self.body.mesh.nodes.copy()
        for pad, shift in zip(self.body.pads, moved, strict=True):
            held_at[pad.nodes] += shift
        load = fields.nodal_force + self._mass[:, None] * np.asarray(self.body.gravity)
        return _Problem(fields, inertia, free_flight, load, held_at)

    def _iterate(self, problem, x0, v0, dt, reference):
        """(3.11)-(3.13) until the true residual is small."""
        options, g, fields = self.options, self.geometry, problem.fields
        G, conn, start = g.gradients[:, 0], g.connectivity, np.array(x0, dtype=float)
        c, log = options.weight, _Log(reference)
        w2 = c * fields.kappa * self.volume
        z, u = self._warm_start(start, fields, w2)
        parts, pull = np.empty((*conn.shape, 3)), np.empty((self.assembler.n, 3))
        x = start.copy()
        x[self.held] = problem.held_at[self.held]
        converged = log.add(0, x, *self._residual(problem, x), options.tolerance, self._rest())
        proximal.pulls(G, w2, z, u, parts)
        update, iteration = None if converged else _GlobalStep(self, problem, w2), 0
        while not converged and iteration < options.max_iterations:
            iteration += 1
            kernels.gather(*self._starts, parts.reshape(-1, 3), pull)
            x[self.free] = update.solve(pull)
            proximal.local_step(x, conn, G, self.volume, fields.mu, fields.kappa, w2, z, u, parts)
            if iteration % options.check_every:
                continue
            converged = log.add(iteration, x, *self._residual(problem, x), options.tolerance,
                                self._rest())
            patience = options.patience * c / options.weight
            if not converged and 2.0 * c <= options.largest_weight and log.stalled(patience):
                c, w2, u = 2.0 * c, 2.0 * w2, 0.5 * u
                update = _GlobalStep(self, problem, w2)
                proximal.pulls(G, w2, z, u, parts)
        return self._solution(problem, x, v0, start, dt, iteration, c, converged, log)

    def _warm_start(self, x, fields, w2):
        """z = D x and the multiplier that balances its stress, so that equilibrium stays put."""
        z = np.einsum('mai,mak->mik', x[self.geometry.connectivity], self.geometry.gradients[:, 0])
        if not (np.linalg.det(z) > 0.0).all():
            raise InputError('x0 holds an inverted element; start from a valid state, e.g. rest')
        return z, (self.volume / w2)[:, None, None] * stress(z, fields.mu, fields.kappa)

    def _reaction(self, problem, x):
        """Out-of-balance forces (n, 3) [N] with inertia, and whether no element is inverted."""
        state = self.assembler.evaluate(x, problem.fields)
        inertia = problem.inertia[:, None] * (x - problem.free_flight)
        return state.forces + inertia, state.min_J > 0.0

    def _residual(self, problem, x):
        forces, valid = self._reaction(problem, x)
        if not valid:
            return np.inf, 0.0
        size = np.abs(forces).max(axis=1)
        return float(size[self.free].max(initial=0.0)), float(size[self.held].max(initial=0.0))

    def _rest(self):
        return REST_FORCE * float(np.mean(self.body.mu * np.cbrt(self.volume) ** 2))

    def _solution(self, problem, x, v0, start, dt, iteration, c, converged, log):
        forces, valid = self._reaction(problem, x)
        pad_force = pad_loads(self.body, forces)[0]
        moving = problem.inertia.any()
        return AdmmSolution(
            x=x, v=(x - start) / dt if moving else np.zeros_like(x),
            pad_force=pad_force if valid else np.full_like(pad_force, np.nan),
            iterations=iteration, weight=c,
            outcome=Outcome.OK if converged else Outcome.NOT_CONVERGED,
            checked=np.array(log.checked), residuals=np.array(log.residuals),
            errors=np.array(log.errors))


class _Log:
    """Residuals as they come, and whether they still fall."""

    def __init__(self, reference):
        self.reference = reference
        self.checked, self.residuals, self.errors = [], [], []
        self._best, self._since = np.inf, 0

    def add(self, iteration, x, free, held, tolerance, rest):
        """Record one look; returns True if the free residual is small beside the held one."""
        self.checked.append(iteration)
        self.residuals.append(free)
        if self.reference is not None:
            self.errors.append(float(np.linalg.norm(x - self.reference, axis=1).max()))
        if free < PROGRESS * self._best:
            self._best, self._since = free, iteration
        return free <= max(tolerance * held, rest)

    def stalled(self, patience):
        """True once per `patience` iterations without progress."""
        if self.checked[-1] - self._since < patience:
            return False
        self._best, self._since = self.residuals[-1], self.checked[-1]
        return True


def _slots(conn, n):
    """For every node its (element, corner) slots in ascending order: (start, slots)."""
    labels = conn.ravel()
    slots = np.argsort(labels, kind='stable')
    return np.searchsorted(labels[slots], np.arange(n + 1)), slots


def _spring_matrix(springs, n):
    """Ground springs as a sparse (3n, 3n) matrix [N/m]."""
    dofs = 3 * springs.nodes[:, None] + np.arange(3)
    rows, cols = np.repeat(dofs, 3, axis=1).ravel(), np.tile(dofs, (1, 3)).ravel()
    return sp.coo_array((springs.stiffness.ravel(), (rows, cols)), shape=(3 * n, 3 * n))
