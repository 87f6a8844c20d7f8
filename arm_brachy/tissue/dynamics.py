"""Implicit dynamics for bodies that ring: generalised-alpha in time, Newton in each step.

Balance at the free nodes: M a + alpha M v + g(x, v) = 0, where g is d(potential)/dx
(`Assembler.forces`) with the viscous stress S = beta (2 mu dev E' + kappa J' J C^-1) added, E' the
rate of Green's strain, J' that of J = det F, C = F'F: Kelvin and Voigt's solid, beta its
retardation time. About rest that is Rayleigh's alpha M + beta K, with its damping ratio
alpha / (2 w) + beta w / 2. Away from rest beta K(rest) would take rotation and isochoric strain
for a change of volume, and near nu = 0.5 kappa would make that the largest damping of all.

Source: Chung & Hulbert 1993, J Appl Mech 60:371; g is weighted between the ends of a step, so that
an iteration evaluates it once.

A factorisation costs some ten iterations, and near nu = 0.5 the stiffness against a change of
volume, kappa / mu times the rest, makes it useless as soon as the body has turned by a degree. So
the factor is kept from step to step and turned along with the nodes: the correction is
R A^-1 R' r, R the rotation of each node since A was made (stiffness warping, Mueller et al. 2002,
Proc SCA:49, used as a preconditioner, which decides how fast the iteration ends, not where).
"""

import copy
import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.element import point_moduli
from arm_brachy.tissue.free_dofs import FreeDofs, held_nodes, moved_from_rest
from arm_brachy.tissue.linear_solver import FactorisationFailed
from arm_brachy.tissue.mass import node_mass, onto
from arm_brachy.tissue.viscosity import viscous_stress
from arm_brachy.tissue.warping import mean_gradient, polar

# An iteration that leaves more than this of the correction costs more than a new factor saves.
SLOWEST = 0.5
# A factor made for one step length serves another this near: at most 2 % of its mass term differ.
SAME_STEP = 0.01


@dataclass(frozen=True)
class DynamicOptions:
    """How to integrate.

    rho_inf : spectral radius at infinite frequency, 1 = no numerical damping, 0 = a mode beyond
        the resolution dies in one step. 0.8 removes the mesh's own high modes within some 20
        steps and adds a damping ratio below 1e-5 to modes sampled 40 times per period (test)
    max_step : [s] longest step; a call that covers more is divided. 2.5 ms samples a 10 Hz mode
        40 times, which puts its frequency off by 0.2 %
    mass : 'consistent' (shape functions) keeps the element's order: frequencies are above the
        exact ones by h^2 (linear elements) or h^4 (quadratic). 'lumped' is diagonal: below them
        by h^2 with linear elements, which is no worse, but with quadratic ones it is what errs
        most: 0.2 to 0.5 % on a bar whose consistent error is 0.02 % and less (test). Nor does
        it fit the weight of quadratic elements, which then strain as they fall
    tolerance : largest correction still open at convergence, over the body's diagonal;
        1e-8 is 1 nm on a 100 mm body
    max_iterations : Newton iterations per step
    halvings : how often a step that fails is cut in two before the call gives up
    """

    rho_inf: float = 0.8
    max_step: float = 2.5e-3
    mass: Literal['lumped', 'consistent'] = 'consistent'
    tolerance: float = 1e-8
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
class Anchor:
    """Where the matrix that the steps iterate with was made; all that its bits depend on.

    x : (n, 3) [m];  dt : [s] length of the step;  fields : StepFields
    """

    x: np.ndarray
    dt: float
    fields: StepFields

    def serves(self, dt):
        """True for steps of about the same length."""
        return abs(self.dt - dt) <= SAME_STEP * dt


@dataclass(frozen=True)
class DynamicState:
    """The body at one instant, world frame.

    t : [s];  x, v, a : (n, 3) positions [m], velocities [m/s], accelerations [m/s^2]
    static : (n, 3) [N] g(x) + C v, carried over because the fields of the next step may differ
    pad_force : (p, 3) [N] of the tissue on each pad, inertia included
    pad_moment : (p, 3) [N m] of the same about the pad's centre (which moves with the pad)
    anchor : Anchor that the next step starts with, or None. It travels with the state, so that
        the next step's bits depend on its arguments alone, though the factor is kept
    iterations : Newton iterations of the call;  outcome : what the call came to
    """

    t: float
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    static: np.ndarray
    pad_force: np.ndarray
    pad_moment: np.ndarray
    anchor: Anchor | None = None
    iterations: int = 0
    outcome: Outcome = Outcome.OK


class DynamicSolver:
    """Steps one SoftBody through time. Holds matrices and the factor last used, no state.

    body : SoftBody, held by fixed nodes, pads or springs, or not at all (free flight)
    options : DynamicOptions
    Pads move linearly between calls.
    Test: verification/test_dynamics.py (order, energy, frequency, damping ratio, free fall)
    """

    def __init__(self, body, options=None):
        self.body = body
        self.options = DynamicOptions() if options is None else options
        self._weights = weights(self.options.rho_inf)
        self._assembler = Assembler(body)
        self._dofs = FreeDofs(self._assembler, held_nodes(body))
        self._solver = self._dofs.solver()
        self._anchor = self._frames = None  # the Anchor whose matrix `_solver` holds
        self._tolerance = self.options.tolerance * np.linalg.norm(np.ptp(body.mesh.nodes, axis=0))
        self._mass = node_mass(self._assembler, self.options.mass)
        self._added_mass = onto(self._assembler.pattern, self._mass)
        self._alpha, self._beta = body.damping
        self._gradient = mean_gradient(body, self._dofs.free)

    def initial(self, x=None, v=None, t=0.0, fields=None):
        """Return the DynamicState that starts at positions x and velocities v.

        x, v : (n, 3) [m], [m/s]; None = at rest;  t : [s];  fields : StepFields or None
        Raises InvertedElement.
        """
        x = (self.body.mesh.nodes if x is None else np.asarray(x, dtype=float)).copy()
        v = np.zeros_like(x) if v is None else np.array(v, dtype=float)
        fields = StepFields.of(self.body) if fields is None else fields
        self._assembler.forces(x, fields)  # refuses what is inverted
        static, _ = self._static(x, v, fields)
        a = np.zeros_like(x)
        self._anchor = None
        self._solver.factor(self._dofs.upper(self._added_mass))
        a[self._dofs.free] = self._solver.solve(-static[self._dofs.free].ravel()).reshape(-1, 3)
        return self._finish(DynamicState(t, x, v, a, static, None, None))

    def step(self, state, pad_displacement, dt, fields=None):
        """Carry a DynamicState to state.t + dt.

        pad_displacement : (p, 3) [m] of the pads at the end, from rest; they get there linearly
        dt : [s] > 0, divided into steps of at most options.max_step
        fields : StepFields that hold during the call, or None for the body's own; fixed nodes go
            linearly to where their base is, springs and supports follow it at once
        Returns the new DynamicState. If a step fails even after `halvings`, returns `state` as it
        was, with the outcome INVERTED_ELEMENT or NOT_CONVERGED.
        """
        fields = StepFields.of(self.body) if fields is None else fields
        start, goal = state.x[self._dofs.held], self._goal(pad_displacement, fields.base)
        count, iterations, now = self.substeps(dt), 0, state
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
        kinetic = 0.5 * np.sum(state.v * (self._mass @ state.v))
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
        """One generalised-alpha step: extrapolated with the old factor, else from where we are.

        Constant acceleration is a good guess of what the step resolves and a wild one of what it
        does not, such as the stiff modes that a sudden release excites.
        """
        here = Anchor(state.x, dt, copy.deepcopy(fields))
        kept = state.anchor if state.anchor is not None and state.anchor.serves(dt) else here
        ahead = state.x + dt * state.v + 0.5 * dt**2 * state.a
        spent = 0
        for anchor, guess in ((kept, ahead), (here, state.x.copy())):
            guess[self._dofs.held] = goal
            new = self._iterate(state, anchor, guess, dt, fields)
            spent += new.iterations
            if new.outcome.ok:
                break
        return replace(new, iterations=spent)

    def _iterate(self, state, anchor, x, dt, fields):
        """Modified Newton from x (n, 3), which it moves; a factor that is slow is renewed."""
        turn, last = None, np.inf
        for iteration in range(1, self.options.max_iterations + 1):
            v, a, residual, static, min_J = self._residual(state, x, dt, fields)
            if not min_J > 0.0:
                return replace(state, iterations=iteration, outcome=Outcome.INVERTED_ELEMENT)
            if turn is None:
                try:
                    self._factor(anchor)
                except FactorisationFailed:
                    break
                turn = self._turn(x)
            move = self._correction(residual, turn)
            size = np.abs(move).max(initial=0.0)
            if size <= self._tolerance:
                return self._finish(replace(state, t=state.t + dt, x=x, v=v, a=a, static=static,
                                            anchor=anchor, iterations=iteration))
            x[self._dofs.free] -= move
            if size > SLOWEST * last:
                anchor, turn = Anchor(x.copy(), dt, copy.deepcopy(fields)), None
            last = size
        return replace(state, iterations=iteration, outcome=Outcome.NOT_CONVERGED)

    def _rates(self, state, x, dt):
        """Newmark velocities and accelerations; for held nodes those of the linear motion."""
        w, held = self._weights, self._dofs.held
        a = ((x - state.x - dt * state.v) / (w.beta * dt**2)
             - (0.5 / w.beta - 1.0) * state.a)
        v = state.v + dt * ((1.0 - w.gamma) * state.a + w.gamma * a)
        v[held] = (x[held] - state.x[held]) / dt
        a[held] = (v[held] - state.v[held]) / dt
        return v, a

    def _residual(self, state, x, dt, fields):
        """v, a, weighted balance (f, 3) of the free nodes, static force at the end, min det F."""
        w, free = self._weights, self._dofs.free
        v, a = self._rates(state, x, dt)
        static, min_J = self._static(x, v, fields)
        balance = (self._mass @ ((1.0 - w.alpha_m) * a + w.alpha_m * state.a)
                   + (1.0 - w.alpha_f) * static + w.alpha_f * state.static)
        return v, a, balance[free], static, min_J

    def _static(self, x, v, fields):
        """Forces of position and velocity (n, 3) [N], smallest det F."""
        if self._beta:
            fields = replace(fields, stress=self._viscous(x, v, fields))
        now, springs = self._assembler.evaluate(x, fields), self.body.springs
        force = now.forces + self._alpha * (self._mass @ v)
        force[springs.nodes] += self._beta * np.einsum('sij,sj->si', springs.stiffness,
                                                       v[springs.nodes])
        return force, now.min_J

    def _viscous(self, x, v, fields):
        """Second Piola-Kirchhoff stress (m, q, 3, 3) of the fields and of the strain's rate."""
        g, stress = self._assembler.geometry, np.empty_like(fields.stress)
        G, _ = self._assembler.reference(fields)
        viscous_stress(x, v, g.connectivity, G, *(
            self._beta * modulus for modulus in point_moduli(g, fields)), fields.stress, stress)
        return stress

    def _correction(self, residual, turn):
        """R A^-1 R' residual (f, 3) with the factor A and the turns R (f, 3, 3) since then."""
        back = np.einsum('fji,fj->fi', turn, residual)
        return np.einsum('fij,fj->fi', turn, self._solver.solve(back.ravel()).reshape(-1, 3))

    def _factor(self, anchor):
        """Hold the matrix of an Anchor; nothing to do if it is held already."""
        if self._anchor is not anchor:
            self._anchor = None
            try:
                self._solver.factor(self._matrix(anchor, convex=False))
            except FactorisationFailed:  # compressed by an iterate, not unstable as a rule
                self._solver.factor(self._matrix(anchor, convex=True))
            self._anchor, self._frames = anchor, self._rotations(anchor.x)

    def _matrix(self, anchor, convex):
        w, dt = self._weights, anchor.dt
        matrix = self._assembler.tangent(anchor.x, anchor.fields, convex=convex)
        rate, left = w.gamma / (w.beta * dt), 1.0 - w.alpha_f  # dv / dx at the end of a step
        mass = (1.0 - w.alpha_m) / (w.beta * dt**2) + left * rate * self._alpha
        undamped = self._assembler.support_tangent(anchor.x, anchor.fields)
        matrix.data = (mass * self._added_mass.data
                       + left * ((1.0 + rate * self._beta) * matrix.data
                                 - rate * self._beta * undamped))
        return self._dofs.upper(matrix)

    def _rotations(self, x):
        """Rotation (f, 3, 3) of every free node from rest."""
        return np.swapaxes(polar((self._gradient @ x).reshape(-1, 3, 3)), 1, 2)

    def _turn(self, x):
        """Rotation (f, 3, 3) of every free node since the Anchor in use."""
        return self._rotations(x) @ np.swapaxes(self._frames, 1, 2)

    def _finish(self, state):
        """The state with the loads on its pads, outcome OK."""
        reaction = state.static + self._mass @ state.a
        force, moment = pad_loads(self.body, reaction)
        return replace(state, pad_force=force, pad_moment=moment, outcome=Outcome.OK)

    def _goal(self, pad_displacement, base):
        pads = np.asarray(pad_displacement, dtype=float)
        return moved_from_rest(self.body, pads, base)[self._dofs.held]


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
