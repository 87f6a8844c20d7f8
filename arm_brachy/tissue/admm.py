"""The thesis' solver: alternating directions over element deformation gradients, (3.9)-(3.14).

Quasi-static equilibrium drops the inertia term of (3.9); the dynamic form is backward Euler,
(3.2)-(3.5). Convergence is judged by the out-of-balance nodal forces of the energy itself: the
change from one iterate to the next says nothing, because the published iteration can cycle.

The accelerated scheme cannot cycle (`admm_schemes`).
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.admm_global import GlobalStep
from arm_brachy.tissue.admm_iteration import Iteration, Problem
from arm_brachy.tissue.admm_schemes import Accelerated, Published
from arm_brachy.tissue.anderson import Anderson
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.dynamics import pad_loads
from arm_brachy.tissue.free_dofs import held_nodes


@dataclass(frozen=True)
class AdmmOptions:
    """When to stop, and how hard elements are tied to their nodes.

    scheme : 'accelerated' (`admm_schemes`) or 'published', (3.11)-(3.13) with one scalar weight
    tolerance : largest out-of-balance component on a free node, as a fraction of the largest on a
        held one (a reaction); 2e-5 leaves about 3 um on the breast phantom
    max_iterations : of (3.11)-(3.13);  the thesis runs 800
    check_every : most iterations between looks at the true residual, each half an iteration
    weight : c, in units of the curvature, or of kappa V if published; 0 = 2 and 1 (the usual
        choice, Overby et al. 2017, sec. 5.2)
    largest_weight : c beyond which the accelerated scheme gives up
    depth : changes that Anderson extrapolation remembers, 0 = none
    """

    scheme: str = 'accelerated'
    tolerance: float = 2e-5
    max_iterations: int = 3000
    check_every: int = 10
    weight: float = 0.0
    largest_weight: float = 100.0
    depth: int = 6

    def __post_init__(self):
        if self.scheme not in DEFAULT_WEIGHT:
            raise ConfigError(f'admm: scheme = {self.scheme!r}; must be one of '
                              f'{sorted(DEFAULT_WEIGHT)}')
        for name in ('tolerance', 'max_iterations', 'check_every', 'largest_weight'):
            if not getattr(self, name) > 0:
                raise ConfigError(f'admm: {name} = {getattr(self, name)}; must be > 0')
        for name in ('weight', 'depth'):
            if not getattr(self, name) >= 0:
                raise ConfigError(f'admm: {name} = {getattr(self, name)}; must be >= 0')

    @property
    def first_weight(self):
        """The c to begin with."""
        return self.weight or DEFAULT_WEIGHT[self.scheme]


DEFAULT_WEIGHT = {'accelerated': 2.0, 'published': 1.0}
# Out-of-balance force below which a body at rest is at rest: this times mean mu V^(2/3).
REST_FORCE = 1e-12


@dataclass(frozen=True)
class AdmmSolution:
    """What a solve came to.

    x : (n, 3) [m] last iterate, an equilibrium only if `outcome` is OK
    v : (n, 3) [m/s] velocity by (3.3), zero from `solve`
    pad_force : (p, 3) [N] of the tissue ON each pad (NaN if x is inverted)
    iterations : made, rejected ones included;  weight : the c it ended with
    reweighings, rejected : changes of the weights; extrapolations replaced by plain steps
    outcome : OK or NOT_CONVERGED
    checked : (c,) iterations after which the residual was taken
    residuals : (c,) [N] largest out-of-balance component on a free node, inf where inverted
    accepted : (k,) iterations that led to an accepted iterate
    merits : (k, 2) their merit [J] and the number of reweighings before
    errors : (k,) [m] their largest distance of a node from `reference`, empty if none was given
    """

    x: np.ndarray
    v: np.ndarray
    pad_force: np.ndarray
    iterations: int
    weight: float
    reweighings: int
    rejected: int
    outcome: Outcome
    checked: np.ndarray
    residuals: np.ndarray
    errors: np.ndarray
    accepted: np.ndarray
    merits: np.ndarray


class AdmmSolver:
    """Equilibrium or one backward Euler step of a SoftBody by ADMM.

    body : SoftBody of linear tetrahedra;  options : AdmmOptions
    Equal arguments give equal bits for any number of threads. Not to be shared between threads.
    Kept because the thesis' estimator is built on its iteration; Newton is the reference.
    Rayleigh damping is not part of (3.2) and is refused.
    """

    def __init__(self, body, options=None):
        if any(body.damping):
            raise ConfigError(f'admm: damping = {body.damping}; must be (0, 0), as (3.2) has none')
        if body.beyond.any():
            raise ConfigError('admm: the body has stiffening tissue or fibres; must be '
                              'Neo-Hookean, as its local step is; use Newton')
        if len(body.supports.nodes):
            raise ConfigError('admm: the body rests on one-sided supports; must have none; use '
                              'Newton')
        self.body = body
        self.options = AdmmOptions() if options is None else options
        self.assembler = Assembler(body)
        geometry = self.assembler.geometry
        if geometry.connectivity.shape[1] != 4:
            raise ConfigError(f'admm: elements have {geometry.connectivity.shape[1]} nodes; must '
                              'be linear tetrahedra with 4; set element: linear in the scene')
        self.conn = geometry.connectivity
        self.G, self.volume = (np.ascontiguousarray(k[:, 0])
                               for k in (geometry.gradients, geometry.weights))
        self.held = held_nodes(body)
        self.free = np.setdiff1d(np.arange(self.assembler.n), self.held)
        self.update = GlobalStep(body, self.conn, self.G, self.volume, self.free)
        self._mass = self.assembler.lumped_mass()
        self.starts = _slots(self.conn, self.assembler.n)
        self._anderson = Anderson((9, len(self.conn)), self.options.depth)

    def solve(self, x0, pad_displacement, fields=None, reference=None):
        """Return the AdmmSolution at rest with the pads displaced by `pad_displacement`.

        x0 : (n, 3) [m] starting state, no element inverted;  pad_displacement : (p, 3) [m]
        fields : StepFields, not swollen; None = the body's own
        reference : (n, 3) [m] solution to measure the iterates against, e.g. Newton's
        Raises InputError. Valid for stable equilibria; test_admm.py::test_equals_newton.
        """
        nothing = np.zeros((self.assembler.n, 3))
        problem = self._problem(pad_displacement, fields, np.zeros(len(nothing)), nothing)
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
        if fields.swelling != 1.0 or fields.beyond.any() or fields.base.any():
            raise InputError(f'admm: fields with swelling {fields.swelling:g}, a base that moves '
                             'or beyond the Neo-Hookean law; must have none of these; use Newton')
        moved = np.asarray(pad_displacement, dtype=float)
        if moved.shape != (len(self.body.pads), 3) or not np.isfinite(moved).all():
            raise InputError(f'pad_displacement has shape {moved.shape} or is not finite; must be '
                             f'({len(self.body.pads)}, 3) finite numbers in metres')
        held_at = self.body.mesh.nodes.copy()
        for pad, shift in zip(self.body.pads, moved, strict=True):
            held_at[pad.nodes] += shift
        load = fields.nodal_force + self._mass[:, None] * np.asarray(self.body.gravity)
        return Problem(fields, inertia, free_flight, load, held_at)

    def _iterate(self, problem, x0, v0, dt, reference):
        """Iterate until the true residual is small."""
        start, options = np.array(x0, dtype=float), self.options
        iteration = Iteration(self, problem, start.copy())
        log = _Log(self, iteration, reference)
        scheme = (Published(iteration, self) if options.scheme == 'published'
                  else Accelerated(iteration, self, self._anderson))
        converged = log.check(0)
        if not converged:
            scheme.begin()
        while not converged and scheme.count < options.max_iterations and not scheme.exhausted:
            scheme.step()
            log.add(scheme)
            if log.due(scheme.count):
                converged = log.check(scheme.count)
        return self._solution(iteration, scheme, log, start, dt, converged)

    def _solution(self, iteration, scheme, log, start, dt, converged):
        x, forces = iteration.x, iteration.reaction()
        pad_force = (np.full((len(self.body.pads), 3), np.nan) if forces is None
                     else pad_loads(self.body, forces)[0])
        moving = iteration.problem.inertia.any()
        return AdmmSolution(
            x=x, v=(x - start) / dt if moving else np.zeros_like(x), pad_force=pad_force,
            iterations=scheme.count, weight=scheme.c, reweighings=scheme.reweighings,
            rejected=scheme.rejected,
            outcome=Outcome.OK if converged else Outcome.NOT_CONVERGED,
            checked=np.array(log.checked), residuals=np.array(log.residuals),
            accepted=np.array(log.accepted), merits=np.array(log.merits),
            errors=np.array(log.errors))


class _Log:
    """Residuals and errors as they come, and when the next look at the residual is due."""

    def __init__(self, solver, iteration, reference):
        self._solver, self._it, self._reference = solver, iteration, reference
        self.checked, self.residuals, self.errors = [], [], []
        self.accepted, self.merits = [], []
        body = solver.body
        self._rest = REST_FORCE * float(np.mean(body.mu * np.cbrt(solver.volume) ** 2))
        self._aim = 0.0  # |F - z|_W^2 at which the residual should be small enough

    def add(self, scheme):
        """Note an accepted iterate."""
        self.accepted.append(scheme.count)
        self.merits.append((self._it.merit, scheme.reweighings))
        if self._reference is not None:
            self.errors.append(float(np.linalg.norm(self._it.x - self._reference, axis=1).max()))

    def due(self, count):
        """True if the residual may be small enough, or has not been looked at for long."""
        since = count - self.checked[-1]
        return self._it.square <= self._aim or since >= self._solver.options.check_every

    def check(self, count):
        """Take the true residual; True if it is small beside the reactions."""
        solver, forces = self._solver, self._it.reaction()
        size = None if forces is None else np.abs(forces).max(axis=1)
        free = np.inf if size is None else float(size[solver.free].max(initial=0.0))
        held = 0.0 if size is None else float(size[solver.held].max(initial=0.0))
        self.checked.append(count)
        self.residuals.append(free)
        limit = max(solver.options.tolerance * held, self._rest)
        # Both go to zero together, the residual in proportion to the root of the square.
        self._aim = 0.0
        if count and free > limit:
            self._aim = self._it.square * min(limit / free, 0.7) ** 2
        return free <= limit


def _slots(conn, n):
    """For every node its (element, corner) slots in ascending order: (start, slots)."""
    labels = conn.ravel()
    slots = np.argsort(labels, kind='stable')
    return np.searchsorted(labels[slots], np.arange(n + 1)), slots
