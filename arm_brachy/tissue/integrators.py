"""How a body gets from one command to the next: equilibria, contact, dynamics; one face for all.

Each integrator holds solvers and no state of the plant. What it needs of the past is its `native`
state, which it makes in `start` and hands back from `settle` and `step` beside what is shown.
"""

import dataclasses
from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.contact_pads import PadContact
from arm_brachy.tissue.dynamics import DynamicSolver, pad_loads
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver
from arm_brachy.tissue.resting import rest

# [N] Out-of-balance force per node below which a state counts as equilibrium without a solve.
# If it pushed the same way at all 700 nodes of a 60 mm body of 6 kPa, the body would move by
# n r / (E L) = 0.2 um, a hundredth of an optical tracker's noise.
SKIP_RESIDUAL = 1e-7


@dataclass(frozen=True)
class TissueState:
    """What the plant shows at one instant, world frame.

    t : [s];  x : (n, 3) node positions [m];  v : (n, 3) velocities [m/s]; in quasi-static
        motion the mean over the last step, zero while nothing moves
    pad_force : (p, 3) [N] of the tissue on each pad
    pad_moment : (p, 3) [N m] of the same about the pad's centre
    outcome : OK, or why the last good state is held;  iterations : Newton iterations of the step
    residual : [N] largest out-of-balance force at the last solve (0 in dynamics)
    base : (3,) [m] displacement of the base
    instruments : what a probe and a needle feel (instruments.Felt), None in a plant without
    """

    t: float
    x: np.ndarray
    v: np.ndarray
    pad_force: np.ndarray
    pad_moment: np.ndarray
    outcome: Outcome = Outcome.OK
    iterations: int = 0
    residual: float = 0.0
    base: np.ndarray = field(default_factory=lambda: np.zeros(3))
    instruments: object = None


class AbstractIntegrator(ABC):
    """Carries a SoftBody from one command to the next. `pads` are (p, 3) [m] from zero."""

    @abstractmethod
    def start(self, x, t, fields):
        """Return (native, TissueState) at positions x (n, 3) [m], time t [s], pads at zero.

        fields : StepFields or None
        """

    @abstractmethod
    def settle(self, native, pads, t, fields):
        """Return (native, TissueState) in equilibrium with `pads`, found from `native`.

        t : [s] of the result;  fields : StepFields. If none is found, the outcome says so.
        """

    @abstractmethod
    def step(self, native, pads, dt, fields):
        """Return (native, TissueState) after dt [s] in which the pads go to `pads` linearly.

        fields : StepFields that hold meanwhile. A failure is in the outcome.
        """

    @abstractmethod
    def pads(self, native):
        """Return where the pads are in `native`, (p, 3) [m]."""

    def substeps(self, dt):
        """Return into how many steps dt [s] must be divided where memory fields change."""
        return 1


class QuasiStatic(AbstractIntegrator):
    """Equilibrium at every instant. Native state: (TissueState, x one step earlier or None)."""

    def __init__(self, body, options):
        self.body = body
        self.statics = StaticSolver(body, options=options)

    def start(self, x, t, fields):
        """As AbstractIntegrator."""
        state = self._resting(t, x, fields)
        return (state, None), state

    def settle(self, native, pads, t, fields):
        """As AbstractIntegrator."""
        return settled(self, native, native[0], pads, t, fields)

    def pads(self, native):
        """As AbstractIntegrator."""
        return _bonded_at(self.body, native[0].x)

    def step(self, native, pads, dt, fields):
        """As AbstractIntegrator."""
        state, before = native
        t, goal = state.t + dt, self.statics.held_positions(pads, fields.base)
        if self._in_equilibrium(state, goal, fields):
            new = dataclasses.replace(self._resting(t, state.x, fields), residual=state.residual)
            return (new, None), new
        solution = self._solve(state.x, before, goal, fields)
        new = TissueState(t, solution.x, (solution.x - state.x) / dt, solution.pad_force,
                          solution.pad_moment, solution.outcome, solution.iterations,
                          solution.residual)
        return (new, state.x), new

    def _solve(self, x, before, goal, fields):
        """Solve from the extrapolated state, or from the last one if that leads nowhere.

        Extrapolation leaves an error of second order in the pad step: measured on 2058 elements,
        half the iterations of a start from the last state.
        """
        if before is not None:
            trend, held = x - before, self.statics.free.held
            onward = progress(trend[held], (goal - x)[held])
            solution = self.statics.follow(x + onward * trend, goal, fields)
            if solution.outcome.ok:
                return solution
        return self.statics.follow(x, goal, fields)

    def _in_equilibrium(self, state, goal, fields):
        """True if held nodes are where they should be and free ones would not move noticeably.

        Noticeably: by more than the solver's tolerance. Forces alone would not tell: as small as
        a solve leaves them, but all the same way, they are a creep that goes on.
        """
        held, free = self.statics.free.held, self.statics.free.free
        if not np.array_equal(state.x[held], goal[held]):
            return False
        pull = np.abs(self.statics.assembler.forces(state.x, fields)[free]).max(initial=0.0)
        if pull <= SKIP_RESIDUAL:
            return True
        return self.statics.open_correction(state.x, fields) <= self.statics.options.tolerance

    def _resting(self, t, x, fields):
        force, moment = pad_loads(self.body, self.statics.assembler.forces(x, fields))
        return TissueState(t, x.copy(), np.zeros_like(x), force, moment)


class Touching(AbstractIntegrator):
    """Equilibrium at every instant, with pads that touch.

    Native state: (t, ContactState, way of the nodes and of the pads in the last step)
    """

    def __init__(self, body, options):
        self.body = body
        if options is not None:  # friction remembers: what every step leaves open would add up
            tight = min(options.tolerance, NewtonOptions().tolerance)
            options = dataclasses.replace(options, tolerance=tight)
        self.contact = PadContact(body, newton=options)

    def start(self, x, t, fields):
        """As AbstractIntegrator."""
        pads = np.zeros((len(self.body.pads), 3))
        return self._resting(t, self.contact.start(x, pads))

    def settle(self, native, pads, t, fields):
        """As AbstractIntegrator."""
        return self._resting(t, self.contact.step(native[1], pads, fields))

    def pads(self, native):
        """As AbstractIntegrator."""
        return self.contact.displacement(native[1])

    def step(self, native, pads, dt, fields):
        """As AbstractIntegrator."""
        t, state, way, stride = native
        if self.contact.at_rest(state, pads, fields, max(SKIP_RESIDUAL, state.residual)):
            return self._resting(t + dt, dataclasses.replace(state, iterations=0))
        before = self.contact.displacement(state)
        trend = progress(stride, pads - before) * way
        new = self.contact.follow(state, pads, trend, fields)
        way = new.x - state.x
        native = (t + dt, new, way, pads - before)
        return native, self._shown(t + dt, new, way / dt)

    def _resting(self, t, state):
        still = np.zeros_like(state.x)
        return (t, state, still, np.zeros((len(self.body.pads), 3))), self._shown(t, state, still)

    def _shown(self, t, state, v):
        force, moment = self.contact.loads(state)
        return TissueState(t, state.x, v, force, moment, state.outcome, state.iterations,
                           state.residual)


class Implicit(AbstractIntegrator):
    """Inertia and damping. Native state: DynamicState."""

    def __init__(self, body, options):
        self.body = body
        self.solver = DynamicSolver(body, options)
        self.statics = StaticSolver(body)

    def start(self, x, t, fields):
        """As AbstractIntegrator."""
        native = self.solver.initial(x, t=t, fields=fields)
        return native, _shown(native)

    def settle(self, native, pads, t, fields):
        """As AbstractIntegrator."""
        return settled(self, native, native, pads, t, fields)

    def pads(self, native):
        """As AbstractIntegrator."""
        return _bonded_at(self.body, native.x)

    def substeps(self, dt):
        """As many as DynamicSolver takes."""
        return self.solver.substeps(dt)

    def step(self, native, pads, dt, fields):
        """As AbstractIntegrator."""
        native = self.solver.step(native, pads, dt, fields)
        return native, _shown(native)


def settled(integrator, native, last, pads, t, fields):
    """(native, TissueState) at the equilibrium of bonded pads found from last.x."""
    found = rest(integrator.statics, last.x, pads, fields)
    if not found.outcome.ok:
        return native, TissueState(t, last.x, np.zeros_like(last.x), found.pad_force,
                                   found.pad_moment, found.outcome, found.iterations)
    native, state = integrator.start(found.x, t, fields)
    return native, dataclasses.replace(state, iterations=found.iterations,
                                       residual=found.residual)


def _bonded_at(body, x):
    """Displacement of each pad (p, 3); a pad translates, so one node tells."""
    first = [pad.nodes[0] for pad in body.pads]
    return (x - body.mesh.nodes)[first].reshape(-1, 3)


def progress(last, ahead):
    """How far it goes on along the last motion, in units of it, within [0, 2]; any shape."""
    length = np.sum(last * last)
    return float(np.clip(np.sum(ahead * last) / length, 0.0, 2.0)) if length > 0.0 else 0.0


def _shown(native):
    """The part of a DynamicState that the plant shows."""
    return TissueState(native.t, native.x, native.v, native.pad_force, native.pad_moment,
                       native.outcome, native.iterations)
