"""The plant: one soft body with its physics terms, stepped from one pad command to the next."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.dynamics import DynamicSolver, pad_loads
from arm_brachy.tissue.newton import StaticSolver

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
    """

    t: float
    x: np.ndarray
    v: np.ndarray
    pad_force: np.ndarray
    pad_moment: np.ndarray
    outcome: Outcome = Outcome.OK
    iterations: int = 0
    residual: float = 0.0


class TissueSimulator:
    """Steps a body with its tissue and boundary terms.

    body : SoftBody of the scene
    terms : BodyTerm instances in the order in which they are to act (`registry.parse_terms` and
        `registry.split` keep the registry's order)
    dynamics : 'quasi_static' (equilibrium at every instant) or 'implicit' (inertia and damping)
    options : NewtonOptions or DynamicOptions, whichever belongs to `dynamics`; None = defaults
    Quasi-static motion holds while pads move slowly against the body's lowest vibration (a
    factor of ten in time); for bodies that ring choose 'implicit'.
    Raises ConfigError for an unknown `dynamics`, and what the terms raise if they do not fit.
    """

    def __init__(self, body, terms=(), *, dynamics: Literal['quasi_static', 'implicit'] =
                 'quasi_static', options=None):
        integrators = {'quasi_static': _QuasiStatic, 'implicit': _Implicit}
        if dynamics not in integrators:
            raise ConfigError(f'dynamics = {dynamics!r}; must be one of {", ".join(integrators)}')
        for term in terms:
            body = term.prepare(body)
        self.body = body
        self.terms = tuple(terms)
        self._integrator = integrators[dynamics](body, options)
        self.reset()

    @property
    def state(self):
        """The last good TissueState; a failed step leaves it alone."""
        return self._good

    def reset(self, t=0.0):
        """Return to the stress-free rest position at time t [s], as if never loaded.

        Under gravity this is no equilibrium: call `settle` next. Returns the TissueState.
        """
        self._memories = tuple(term.memory(self.body) for term in self.terms)
        self._clock = t
        self._native, self._good = self._integrator.start(self.body.mesh.nodes, t, None)
        return self._good

    def settle(self, pad_displacement=None):
        """Rest for ever: the equilibrium under dead loads, with every memory faded out.

        pad_displacement : (p, 3) [m] from rest, None = pads at rest. Time does not advance.
        Returns the TissueState; without an equilibrium its outcome says so and nothing changes.
        """
        pads = np.zeros((len(self.body.pads), 3)) if pad_displacement is None else (
            self._checked(pad_displacement))
        fields = self._fields(self._memories, self._clock, np.inf)
        solution = self._integrator.statics.solve(self._good.x, pads, fields)
        if not solution.outcome.ok:
            return self._held(solution.outcome, solution.iterations)
        self._memories = self._remember(self._memories, solution.x, self._clock, np.inf)
        self._native, good = self._integrator.start(solution.x, self._clock, fields)
        self._good = dataclasses.replace(good, iterations=solution.iterations,
                                         residual=solution.residual)
        return self._good

    def step(self, t, pad_displacement):
        """Advance to time t with the pads moving there linearly.

        t : [s], later than the last step's;  pad_displacement : (p, 3) [m] from rest, world frame
        Returns the TissueState at t. If the solver fails or the command is not finite, position,
        forces and memories stay those of the last good state and `outcome` says why; the next
        step then covers the whole time since. Raises InputError if time runs backwards or the
        command has the wrong shape.
        """
        pads = self._checked(pad_displacement)
        if not t > self._clock:
            raise InputError(f'tissue step to t = {t} s; must be later than {self._clock} s; call '
                             'reset to start again')
        self._clock = t
        if not np.isfinite(pads).all():
            return self._held(Outcome.REJECTED, 0)
        native, memories, state = self._advance(t, pads)
        if not state.outcome.ok:
            return self._held(state.outcome, state.iterations)
        self._native, self._memories, self._good = native, memories, state
        return state

    def _advance(self, t, pads):
        """Integrate from the last good state; memories are carried through every substep."""
        native, memories, iterations = self._native, self._memories, 0
        begin, dt = self._good.t, t - self._good.t
        # Without memory nothing happens between substeps, and the integrator divides dt itself.
        remembers = any(memory is not None for memory in memories)
        count = self._integrator.substeps(dt) if remembers else 1
        start = self._pads_of(self._good.x)
        for k in range(1, count + 1):
            h, now = dt / count, begin + dt * k / count
            target = pads if k == count else start + (pads - start) * (k / count)
            fields = self._fields(memories, now, h)
            native, state = self._integrator.step(native, target, h, fields)
            iterations += state.iterations
            if not state.outcome.ok:
                break
            memories = self._remember(memories, state.x, now, h)
        return native, memories, dataclasses.replace(state, t=t, iterations=iterations)

    def _fields(self, memories, t, dt):
        fields = StepFields.of(self.body)
        for term, memory in zip(self.terms, memories, strict=True):
            term.before_step(self.body, memory, t, dt, fields)
        return fields

    def _remember(self, memories, x, t, dt):
        return tuple(term.after_step(self.body, memory, x, t, dt)
                     for term, memory in zip(self.terms, memories, strict=True))

    def _held(self, outcome, iterations):
        return dataclasses.replace(self._good, t=self._clock, outcome=outcome,
                                   v=np.zeros_like(self._good.v), iterations=iterations)

    def _pads_of(self, x):
        """Displacement of each pad (p, 3); a pad translates, so one node tells."""
        first = [pad.nodes[0] for pad in self.body.pads]
        return (x - self.body.mesh.nodes)[first].reshape(-1, 3)

    def _checked(self, pad_displacement):
        pads = np.array(pad_displacement, dtype=float)
        if pads.shape != (len(self.body.pads), 3):
            raise InputError(f'pad_displacement has shape {pads.shape}; must be '
                             f'({len(self.body.pads)}, 3), one row per pad in the order '
                             f'{", ".join(self.body.pad_names)}')
        return pads


class _QuasiStatic:
    """Equilibrium at every instant. Native state: (TissueState, x one step earlier or None)."""

    def __init__(self, body, options):
        self.body = body
        self.statics = StaticSolver(body, options=options)

    def start(self, x, t, fields):
        state = self._resting(t, x, fields)
        return (state, None), state

    def substeps(self, dt):
        return 1

    def step(self, native, pads, dt, fields):
        state, before = native
        t, goal = state.t + dt, self.statics.held_positions(pads)
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
            trend = x - before
            solution = self.statics.follow(x + self._progress(x, trend, goal) * trend, goal,
                                           fields)
            if solution.outcome.ok:
                return solution
        return self.statics.follow(x, goal, fields)

    def _progress(self, x, trend, goal):
        """How far the held nodes go on along their last motion, in units of it, within [0, 2]."""
        held = self.statics.free.held
        last, ahead = trend[held], (goal - x)[held]
        length = np.sum(last * last)
        return float(np.clip(np.sum(ahead * last) / length, 0.0, 2.0)) if length > 0.0 else 0.0

    def _in_equilibrium(self, state, goal, fields):
        """True if held nodes are where they should be and no free node is pulled noticeably."""
        held, free = self.statics.free.held, self.statics.free.free
        if not np.array_equal(state.x[held], goal[held]):
            return False
        pull = np.abs(self.statics.assembler.forces(state.x, fields)[free]).max(initial=0.0)
        return pull <= max(SKIP_RESIDUAL, state.residual)

    def _resting(self, t, x, fields):
        force, moment = pad_loads(self.body, self.statics.assembler.forces(x, fields))
        return TissueState(t, x.copy(), np.zeros_like(x), force, moment)


class _Implicit:
    """Inertia and damping. Native state: DynamicState."""

    def __init__(self, body, options):
        self.solver = DynamicSolver(body, options)
        self.statics = StaticSolver(body)

    def start(self, x, t, fields):
        native = self.solver.initial(x, t=t, fields=fields)
        return native, _shown(native)

    def substeps(self, dt):
        return self.solver.substeps(dt)

    def step(self, native, pads, dt, fields):
        native = self.solver.step(native, pads, dt, fields)
        return native, _shown(native)


def _shown(native):
    """The part of a DynamicState that the plant shows."""
    return TissueState(native.t, native.x, native.v, native.pad_force, native.pad_moment,
                       native.outcome, native.iterations)
