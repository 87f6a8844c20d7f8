"""The common face of every physics term: one file each, one line each in `arm_brachy.registry`.

A term is a frozen dataclass whose fields are its parameters (declared with `quantity`) plus a
class attribute `spec: TermSpec`. What it does to the simulation depends on where it acts; the four
faces below are the only ways in. A term that needs another way in means that the face is wrong.
"""

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Protocol


class Kind(Enum):
    """Where a term acts."""

    TISSUE = 'tissue'
    BOUNDARY = 'boundary and contact'
    ACTUATION = 'actuation'
    SENSING = 'sensing'
    NUMERICS = 'numerics'


class Stage(Enum):
    """For actuation: between which two quantities. For sensing: which stream."""

    BODY = 'body'                    # tissue and boundary terms
    SETPOINT = 'setpoint'            # commanded position -> position the servo follows
    TRANSMISSION = 'transmission'    # motor side (what the encoder sees) -> pad side
    ENCODER = 'encoder'
    EM = 'em'
    OPTICAL = 'optical'
    FORCE = 'force'


@dataclass(frozen=True)
class TermSpec:
    """What the documentation table says of a term.

    name : the registry key, from ARCHITECTURE's list of terms
    stage : where it acts; for a term that a parameter sends elsewhere (`Term.stage`), by default
    equation : plain text, symbols as in `symbols` of the docstring
    source : book, paper or data sheet with equation or page number
    invisible_when : from which recordings it cannot be seen, in one line ('' = none known)
    leaves_open : what the same effect may be in nature besides what the law says, in one line;
        only a term of the numerics has none
    load_cases : different pushes without which a load would do as well (theorem T6 of the tests)
    timed : True for a body term whose memory is but the clock: what it does in a step follows from
        the time at its end, not from what was before
    """

    name: str
    kind: Kind
    stage: Stage
    summary: str
    equation: str
    source: str
    invisible_when: str = ''
    leaves_open: str = ''
    load_cases: int = 1
    timed: bool = False


class Term(Protocol):
    """What all faces share."""

    spec: ClassVar[TermSpec]

    @property
    def stage(self):
        """The Stage at which this very term acts."""
        return self.spec.stage


class BodyTerm(Term, Protocol):
    """Tissue and boundary terms (Kind.TISSUE, Kind.BOUNDARY).

    A static effect overrides `prepare` only. An effect with memory also gives `memory`,
    `before_step` and `after_step`; internal variables live in the memory array, never in the term.
    """

    def prepare(self, body):
        """Return a SoftBody with the effect built in (the argument is untouched)."""

    def memory(self, body):
        """Return the initial internal variables (any picklable value), or None."""

    def before_step(self, body, memory, t, dt, fields):
        """Write into `fields` (tissue.body.StepFields) what holds during (t - dt, t]."""

    def after_step(self, body, memory, x, t, dt):
        """Return the internal variables at t, given the converged positions x (n, 3) [m].

        body : with the stress-free shape that it had during the step, swollen if it was
        """

    def carried(self, body, steps, fields):
        """Write into `fields`, one for each of steps.at, what `before_step` does along `steps`.

        steps : tissue.body.Steps, positions that are known
        Memory is stepped through all of them; a term may know a shorter way to the same.
        """
        memory, wanted = self.memory(body), dict(zip(steps.at.tolist(), fields, strict=True))
        for k in range(steps.at[-1] + 1):
            if k in wanted:
                self.before_step(body, memory, steps.t[k], steps.acting[k], wanted[k])
            memory = self.after_step(body.swollen(steps.swelling[k]), memory, steps.x[k],
                                     steps.t[k], steps.dt[k])


class ActuationTerm(Term, Protocol):
    """Actuation terms (Kind.ACTUATION), vectorised over the bank's n actuators.

    They map an input position u (n,) [m] to an output (n,) [m] at their `stage`.
    """

    def memory(self, q0):
        """Internal state for a bank at rest at q0 (n,) [m]."""

    def step(self, memory, u, effort, t, dt):
        """Return (output (n,) [m], new memory); effort (n,) [N] pushes back on the pad."""


class SensingTerm(Term, Protocol):
    """Sensing terms (Kind.SENSING): distort what a sensor would see, before noise, or its clock.

    The device adds up the `lateness` of its terms and shifts every stamp by it; values, noise and
    the order of samples stay as they were.
    """

    @property
    def lateness(self):
        """By how much stamps are later than the acquisition [s]; negative: earlier."""
        return 0.0

    def distort(self, t, names, values, pads):
        """Return distorted values (k, 3), given the true ones.

        t : s, when it was acquired;  names : k stream-local names (markers, tools, pads)
        values : (k, 3) positions [m] or forces [N] in the world frame
        pads : (p, 3) true pad displacements [m] (what actuator metal does to an EM field)
        """
