"""The plant: one soft body with its physics terms, stepped from one pad command to the next."""

import dataclasses
from typing import Literal

import numpy as np

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.body import StepFields
from arm_brachy.tissue.contact_pads import touches
from arm_brachy.tissue.instrumented import Instrumented
from arm_brachy.tissue.instruments import IDLE
from arm_brachy.tissue.integrators import Implicit, QuasiStatic, Touching


class TissueSimulator:
    """Steps a body with its tissue and boundary terms.

    body : SoftBody of the scene
    terms : BodyTerm instances in the order in which they are to act (`registry.parse_terms` and
        `registry.split` keep the registry's order)
    dynamics : 'quasi_static' (equilibrium at every instant) or 'implicit' (inertia and damping)
    options : NewtonOptions or DynamicOptions, whichever belongs to `dynamics`; None = defaults
    instruments : instruments.Instruments that act on the body besides, None = none; they need
        bonded pads and quasi-static motion
    Pads of the body that have a face touch it, with friction; the others are bonded. With friction
    a state depends on the path that led there, so `settle` and `step` go on from the last one.
    Quasi-static motion holds while pads move slowly against the body's lowest vibration (a
    factor of ten in time); for bodies that ring choose 'implicit'.
    Raises ConfigError for an unknown `dynamics`, touching pads in 'implicit' dynamics, instruments
    beside either, and what the terms raise if they do not fit.
    """

    def __init__(self, body, terms=(), *, dynamics: Literal['quasi_static', 'implicit'] =
                 'quasi_static', options=None, instruments=None):
        integrators = {'quasi_static': QuasiStatic, 'implicit': Implicit}
        if dynamics not in integrators:
            raise ConfigError(f'dynamics = {dynamics!r}; must be one of {", ".join(integrators)}')
        for term in terms:
            body = term.prepare(body)
        self.body = body
        self.terms = tuple(terms)
        integrator = integrators[dynamics]
        if touches(body).any():
            if dynamics != 'quasi_static':
                raise ConfigError(f'dynamics = {dynamics!r} with touching pads; must be '
                                  "'quasi_static', or bond the pads")
            integrator = Touching
        self._instruments = instruments
        if instruments is None:
            self._integrator = integrator(body, options)
        else:
            self._refuse_beside_instruments(dynamics)
            self._integrator = Instrumented(body, options, instruments)
        self.reset()

    def _refuse_beside_instruments(self, dynamics):
        if dynamics != 'quasi_static' or touches(self.body).any():
            raise ConfigError(f'probe or needle with dynamics = {dynamics!r} and '
                              f'{int(touches(self.body).sum())} touching pads; must be '
                              "'quasi_static' with bonded pads")

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
        native, state = self._integrator.settle(self._native, pads, self._clock, fields)
        if not state.outcome.ok:
            return self._held(state.outcome, state.iterations)
        state = dataclasses.replace(state, base=fields.base)
        self._memories = self._remember(self._memories, state.x, self._clock, np.inf,
                                        fields.swelling)
        self._native, self._good = native, state
        return state

    def step(self, t, pad_displacement, tools=IDLE):
        """Advance to time t with the pads and instruments moving there linearly.

        t : [s], later than the last step's;  pad_displacement : (p, 3) [m] from rest, world frame
        tools : instruments.Tools, where the instruments are at t
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
        native, memories, state = self._advance(t, pads, tools)
        if not state.outcome.ok:
            return self._held(state.outcome, state.iterations)
        self._native, self._memories, self._good = native, memories, state
        return state

    def _advance(self, t, pads, tools):
        """Integrate from the last good state; memories are carried through every substep."""
        native, memories, iterations = self._native, self._memories, 0
        begin, dt = self._good.t, t - self._good.t
        # Without memory nothing happens between substeps, and the integrator divides dt itself.
        remembers = any(memory is not None for memory in memories)
        count = self._integrator.substeps(dt) if remembers else 1
        start = self._integrator.pads(native)
        where = () if self._instruments is None else (tools,)   # one step: quasi-static
        for k in range(1, count + 1):
            h, now = dt / count, begin + dt * k / count
            target = pads if k == count else start + (pads - start) * (k / count)
            fields = self._fields(memories, now, h)
            native, state = self._integrator.step(native, target, h, fields, *where)
            iterations += state.iterations
            if not state.outcome.ok:
                break
            memories = self._remember(memories, state.x, now, h, fields.swelling)
        state = dataclasses.replace(state, t=t, iterations=iterations, base=fields.base)
        return native, memories, state

    def _fields(self, memories, t, dt):
        fields = StepFields.of(self.body)
        for term, memory in zip(self.terms, memories, strict=True):
            term.before_step(self.body, memory, t, dt, fields)
        return fields

    def _remember(self, memories, x, t, dt, swelling):
        body = self.body.swollen(swelling)
        return tuple(term.after_step(body, memory, x, t, dt)
                     for term, memory in zip(self.terms, memories, strict=True))

    def _held(self, outcome, iterations):
        return dataclasses.replace(self._good, t=self._clock, outcome=outcome,
                                   v=np.zeros_like(self._good.v), iterations=iterations)

    def _checked(self, pad_displacement):
        pads = np.array(pad_displacement, dtype=float)
        if pads.shape != (len(self.body.pads), 3):
            raise InputError(f'pad_displacement has shape {pads.shape}; must be '
                             f'({len(self.body.pads)}, 3), one row per pad in the order '
                             f'{", ".join(self.body.pad_names)}')
        return pads
