"""Implicit dynamics for bodies that ring: generalised-alpha in time, Newton in each step.

Balance at the free nodes: M a + C v + g(x) = 0 with g(x) = d(potential)/dx (`Assembler.forces`)
and C = alpha M + beta K(rest). Source: Chung & Hulbert 1993, J Appl Mech 60:371; g is weighted
between the ends of a step, so that an iteration evaluates it once.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, kron

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.free_dofs import FreeDofs, held_nodes
from arm_brachy.tissue.linear_solver import FactorisationFailed


@dataclass(frozen=True)
class DynamicOptions:
    """How to integrate.

    rho_inf : spectral radius at infinite frequency, 1 = no numerical damping, 0 = a mode beyond
        the resolution dies in one step. 0.8 removes the mesh's own high modes within some 20
        steps and adds a damping ratio below 1e-5 to modes sampled 40 times per period (test)
    max_step : [s] longest step; a call that covers more is divided. 2.5 ms samples a 10 Hz mode
        40 times, which puts its frequency off by 0.2 %
    mass : 'lumped' (diagonal) or 'consistent' (shape functions); the first bends
        frequencies down, the second up, both with the square of the mesh width
    tolerance : largest correction still open at convergence, over the body's diagonal;
        1e-9 is 0.1 nm on a 100 mm body
    max_iterations : Newton iterations per step
    halvings : how often a step that fails is cut in two before the call gives up
    """

    rho_inf: float = 0.8
    max_step: float = 2.5e-3
    mass: Literal['lumped', 'consistent'] = 'lumped'
    tolerance: float = 1e-9
    max_iterations: int = 20
    halvings: int = 4

    def __post_init__(self):
        if not 0.0 <= self.rho_inf <= 1.0:
            raise ConfigError(f'rho_inf = {self.rho_inf}; must be from 0 to 1')
        if not self.max_step > 0.0:
            raise ConfigError(f'max_step = {self.max_step} s; must be > 0')
        if self.mass not in ('lumped', 'consistent'):
            raise ConfigError(f"mass = {self.mass!r}; must be 'lumped' or 'consistent'")


@dataclass(frozen=True)
class Weights:
    """Parameters of the generalised-alpha method that follow from rho_inf."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float


def weights(rho_inf):
    """Return the Weights of second order and largest high-frequency damping for rho_inf in [0, 1].

    Source: Chung & Hulbert 1993, eqs. (17), (20), (25).
    """
    alpha_m = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0)
    alpha_f = rho_inf / (rho_inf + 1.0)
    return Weights(alpha_m, alpha_f, beta=0.25 * (1.0 - alpha_m + alpha_f) ** 2,
                   gamma=0.5 - alpha_m + alpha_f)


@dataclass(frozen=True)
class DynamicState:
    """The body at one instant, world frame.

    t : [s];  x, v, a : (n, 3) positions [m], velocities [m/s], accelerations [m/s^2]
    static : (n, 3) [N] g(x) + C v, carried over because the fields of the next step may differ
    pad_force : (p, 3) [N] of the tissue on each pad, inertia included
    pad_moment : (p, 3) [N m] of the same about the pad's centre (which moves with the pad)
    iterations : Newton iterations of the call;  outcome : what the call came to
    """

    t: float
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    static: np.ndarray
    pad_force: np.ndarray
    pad_moment: np.ndarray
    iterations: int = 0
    outcome: Outcome = Outcome.OK


class DynamicSolver:
    """Steps one SoftBody through time. Holds matrices and the symbolic factorisation, no state.

    body : SoftBody, held by fixed nodes, pads or springs, or not at all (free flight)
    options : DynamicOptions
    Pads move linearly between calls. Rayleigh damping uses the stiffness at rest, so parts that
    turn by more than about 20 deg are damped against their rotation too: keep beta small there.
    Test: verification/test_dynamics.py (order, energy, frequency, damping ratio, free fall)
    """

    def __init__(self, body, options=None):
        self.body = body
        self.options = DynamicOptions() if options is None else options
        self._weights = weights(self.options.rho_inf)
        self._assembler = Assembler(body)
        self._dofs = FreeDofs(self._assembler, held_nodes(body))
        self._solver = self._dofs.solver()
        self._factored = None  # the step length whose matrix `_solver` holds, within one call
        self._tolerance = self.options.tolerance * np.linalg.norm(np.ptp(body.mesh.nodes, axis=0))
        alpha, beta = body.damping
        self.mass = mass_matrix(self._assembler, self.options.mass)
        self.damping = self._assembler.tangent(body.mesh.nodes)
        self.damping.data = alpha * self.mass.data + beta * self.damping.data

    def initial(self, x=None, v=None, t=0.0, fields=None):
        """Return the DynamicState that starts at positions x and velocities v.

        x, v : (n, 3) [m], [m/s]; None = at rest;  t : [s];  fields : StepFields or None
        Raises InvertedElement.
        """
        x = (self.body.mesh.nodes if x is None else np.asarray(x, dtype=float)).copy()
        v = np.zeros_like(x) if v is None else np.array(v, dtype=float)
        static = self._assembler.forces(x, fields) + _times(self.damping, v)
        a = np.zeros_like(x)
        self._solver.factor(self._dofs.upper(self.mass))
        a[self._dofs.free] = self._solver.solve(-static[self._dofs.free].ravel()).reshape(-1, 3)
        return self._finish(t, x, v, a, static, 0)

    def step(self, state, pad_displacement, dt, fields=None):
        """Carry a DynamicState to state.t + dt.

        pad_displacement : (p, 3) [m] of the pads at the end, from rest; they get there linearly
        dt : [s] > 0, divided into steps of at most options.max_step
        fields : StepFields that hold during the call, or None for the body's own
        Returns the new DynamicState. If a step fails even after `halvings`, returns `state` as it
        was, with the outcome INVERTED_ELEMENT or NOT_CONVERGED.
        """
        fields = StepFields.of(self.body) if fields is None else fields
        start, goal = state.x[self._dofs.held], self._held_positions(pad_displacement)
        count, iterations, now = self.substeps(dt), 0, state
        self._factored = None  # or the bits would depend on earlier calls
        for k in range(1, count + 1):
            target = goal if k == count else start + (k / count) * (goal - start)
            new = self._cover(now, target, dt / count, fields, self.options.halvings)
            iterations += new.iterations
            if not new.outcome.ok:
                return replace(state, iterations=iterations, outcome=new.outcome)
            now = new
        return replace(now, t=state.t + dt, iterations=iterations)

    def substeps(self, dt):
        """Return the number of equal steps that a call over dt [s] is divided into."""
        return max(1, math.ceil(dt / self.options.max_step * (1.0 - 1e-9)))

    def energy(self, state, fields=None):
        """Return kinetic plus potential energy [J] of a DynamicState (loads included)."""
        kinetic = 0.5 * np.sum(state.v * _times(self.mass, state.v))
        return kinetic + self._assembler.energy(state.x, fields)

    def _cover(self, state, goal, dt, fields, halvings):
        """One step, or two of half the length where one fails."""
        new = self._advance(state, goal, dt, fields)
        if new.outcome.ok or halvings == 0:
            return new
        middle = 0.5 * (state.x[self._dofs.held] + goal)
        spent, now = new.iterations, state
        for target in (middle, goal):
            now = self._cover(now, target, 0.5 * dt, fields, halvings - 1)
            spent += now.iterations
            if not now.outcome.ok:
                break
        return replace(now, iterations=spent)

    def _advance(self, state, goal, dt, fields):
        """One generalised-alpha step by modified Newton: the factor is renewed where it stalls."""
        x, last = self._predict(state, goal, dt, fields), np.inf
        stale = self._factored != dt
        for iteration in range(1, self.options.max_iterations + 1):
            v, a = self._rates(state, x, dt)
            residual, static, min_J = self._residual(state, x, v, a, fields)
            if not min_J > 0.0:
                return replace(state, iterations=iteration, outcome=Outcome.INVERTED_ELEMENT)
            try:
                if stale:
                    self._factor(x, dt, fields)
            except FactorisationFailed:
                return replace(state, iterations=iteration, outcome=Outcome.NOT_CONVERGED)
            move = self._solver.solve(residual).reshape(-1, 3)
            size = np.abs(move).max(initial=0.0)
            if size <= self._tolerance:
                return self._finish(state.t + dt, x, v, a, static, iteration)
            x[self._dofs.free] -= move
            stale, last = size > 0.3 * last, size
        return replace(state, iterations=iteration, outcome=Outcome.NOT_CONVERGED)

    def _predict(self, state, goal, dt, fields):
        """Constant acceleration, or where we are if that turns an element inside out."""
        x = state.x + dt * state.v + 0.5 * dt**2 * state.a
        x[self._dofs.held] = goal
        if not self._assembler.evaluate(x, fields).min_J > 0.0:
            x = state.x.copy()
            x[self._dofs.held] = goal
        return x

    def _rates(self, state, x, dt):
        """Newmark velocities and accelerations; for held nodes those of the linear motion."""
        w, held = self._weights, self._dofs.held
        a = ((x - state.x - dt * state.v) / (w.beta * dt**2)
             - (0.5 / w.beta - 1.0) * state.a)
        v = state.v + dt * ((1.0 - w.gamma) * state.a + w.gamma * a)
        v[held] = (x[held] - state.x[held]) / dt
        a[held] = (v[held] - state.v[held]) / dt
        return v, a

    def _residual(self, state, x, v, a, fields):
        """Weighted balance at the free dofs, static force at the end, smallest det F."""
        w = self._weights
        now = self._assembler.evaluate(x, fields)
        static = now.forces + _times(self.damping, v)
        balance = (_times(self.mass, (1.0 - w.alpha_m) * a + w.alpha_m * state.a)
                   + (1.0 - w.alpha_f) * static + w.alpha_f * state.static)
        return balance[self._dofs.free].ravel(), static, now.min_J

    def _factor(self, x, dt, fields):
        w, self._factored = self._weights, None
        matrix = self._assembler.tangent(x, fields)
        matrix.data = (1.0 - w.alpha_m) / (w.beta * dt**2) * self.mass.data + (1.0 - w.alpha_f) * (
            w.gamma / (w.beta * dt) * self.damping.data + matrix.data)
        self._solver.factor(self._dofs.upper(matrix))
        self._factored = dt

    def _finish(self, t, x, v, a, static, iterations):
        reaction = static + _times(self.mass, a)
        force, moment = pad_loads(self.body, reaction)
        return DynamicState(t, x, v, a, static, force, moment, iterations)

    def _held_positions(self, pad_displacement):
        x = self.body.mesh.nodes.copy()
        for pad, shift in zip(self.body.pads, np.asarray(pad_displacement, dtype=float),
                              strict=True):
            x[pad.nodes] += shift
        return x[self._dofs.held]


def pad_loads(body, reaction):
    """Return force and moment (p, 3) [N], [N m] of the tissue on each pad.

    body : SoftBody;  reaction : (n, 3) [N] what holds each node, as from
        `Assembler.forces`. Moments are about the pad's centre, carried along with the pad.
    """
    force, moment = np.zeros((len(body.pads), 3)), np.zeros((len(body.pads), 3))
    for i, pad in enumerate(body.pads):
        on_pad = -reaction[pad.nodes]
        arm = body.mesh.nodes[pad.nodes] - pad.centre  # the disc translates: its arms stay
        force[i], moment[i] = on_pad.sum(axis=0), np.cross(arm, on_pad).sum(axis=0)
    return force, moment


def mass_matrix(assembler, kind):
    """Return the mass matrix (3n, 3n) [kg] on the assembler's pattern.

    kind : 'lumped' (`Assembler.lumped_mass`) or 'consistent' (integral of rho N_a N_b); carried
        masses stay on the diagonal
    """
    n, body, geometry = assembler.n, assembler.body, assembler.geometry
    if kind == 'lumped':
        return _onto(assembler.pattern, diags_array(assembler.lumped_mass()))
    conn = geometry.connectivity
    a = conn.shape[1]
    rows, cols = np.repeat(conn, a, axis=1).ravel(), np.tile(conn, (1, a)).ravel()
    blocks = np.outer(assembler.element_mass(), geometry.mass.ravel()).ravel()
    matrix = coo_array((blocks, (rows, cols)), shape=(n, n))
    carried = np.zeros(n) if body.nodal_mass is None else body.nodal_mass
    return _onto(assembler.pattern, matrix.tocsr() + diags_array(carried))


def _onto(pattern, scalar):
    """Spread a node matrix (n, n) to three axes and write it on a CSR pattern that contains it."""
    indptr, indices = pattern
    full = kron(csr_array(scalar), np.eye(3), format='coo')
    size = full.shape[0]
    keys = np.repeat(np.arange(size), np.diff(indptr)) * size + indices
    rows, cols = (np.asarray(c, dtype=np.int64) for c in full.coords)
    data = np.zeros(len(indices))
    data[np.searchsorted(keys, rows * size + cols)] = full.data
    return csr_array((data, indices, indptr), shape=full.shape)


def _times(matrix, vectors):
    """Sparse (3n, 3n) times a nodal field (n, 3)."""
    return (matrix @ vectors.ravel()).reshape(-1, 3)
