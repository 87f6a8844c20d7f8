"""The parts of an answer: where, when, what lost, how well it fits, what to record next."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.core.quantity import UNITS as EDGE_UNITS
from arm_brachy.diagnosis.signals.stream import UNITS

REGIMES = Literal['', 'rest', 'hold', 'load', 'unload', 'rate', 'amplitude', 'direction',
                  'past_maximum']
EDGE = {'m': 'mm', 'N': 'N'}   # unit of a stream -> unit in which people read it
SEEN = 2.0      # times the noise: an error, and what a mesh may make, that are more than noise


def edge_unit(stream):
    """(unit as printed, its factor to SI) in which the errors of a kind of stream are shown."""
    scale, printed = EDGE_UNITS[EDGE[UNITS[stream]]]
    return printed, scale


@dataclass(frozen=True)
class Recording:
    """A recording that was used; t_start, t_end [s]: the stretch that every stream covers."""

    name: str
    role: Literal['fitted', 'held out', 'fitted, kinds held out in turn', 'null']
    t_start: float
    t_end: float


@dataclass(frozen=True)
class Place:
    """One place, given by exactly one of: stream, actuator (a pad), boundary, position alone.

    channel : marker, tool or pad of the stream, '' = all
    boundary : the region in words that follow 'on the' ('base', 'surface under pad_1'), with a
        position if it has one
    position : (3,) [m] world frame, at rest;  radius : [m] of the 90 % region around it; without
        term how far from it something is left, which has no probability
    term, option : of the cause that is there; '' = what is there is not known
    """

    stream: str = ''
    channel: str = ''
    actuator: str = ''
    boundary: str = ''
    position: tuple | None = None
    radius: float | None = None
    term: str = ''
    option: int = 0

    def __post_init__(self):
        named = [n for n in ('stream', 'actuator', 'boundary') if getattr(self, n)]
        if len(named) > 1 or not named and self.position is None:
            raise InputError(f'place by {" and ".join(named) or "nothing"}; must be by one of '
                             'stream, actuator, boundary or position')
        if self.stream and self.stream not in UNITS:
            raise InputError(f'place in stream {self.stream!r}; must be one of {", ".join(UNITS)}')
        if (self.position is None) != (self.radius is None):
            raise InputError('place with only one of position and radius; a position must have '
                             'the radius of the region around it')
        if self.position is not None and np.shape(self.position) != (3,):
            raise InputError(f'place at {self.position}; must be three coordinates in m')


@dataclass(frozen=True)
class Interval:
    """One stretch of time.

    recording : its name;  t_start, t_end : [s];  onset : (low, high) [s] 90 % interval of a sudden
        beginning, None = it does not begin suddenly
    regime : in what it shows, '' = in no regime more than in others;  term : '' = not known
    """

    recording: str
    t_start: float
    t_end: float
    regime: REGIMES = ''
    onset: tuple | None = None
    term: str = ''

    def __post_init__(self):
        if not self.t_start <= self.t_end:
            raise InputError(f'interval {self.t_start:g} to {self.t_end:g} s; must not end before '
                             'it begins')
        if self.regime not in get_args(REGIMES):
            raise InputError(f'regime {self.regime!r}; must be one of '
                             f'{", ".join(filter(None, get_args(REGIMES)))}')


@dataclass(frozen=True)
class Alternative:
    """An explanation that was considered and lost.

    terms : one, or those of a pair;  held_out : gain in the logarithm of the probability of what
        was held out, over no new physics (natural logarithm)
    visible : False if these recordings could not have shown it: it is not ruled out
    why : why it lost; '' = by its score
    """

    terms: tuple
    held_out: float
    visible: bool = True
    why: str = ''


@dataclass(frozen=True)
class Limit:
    """From what size on these recordings would have shown a cause.

    term : of the registry;  parameter : its name, of a vector with the axis
    unit, value : as printed at the edges, '1' = none
    typical_sizes : the same in sizes that are typical
    """

    term: str
    parameter: str
    unit: str
    value: float
    typical_sizes: float


@dataclass(frozen=True)
class Nearest:
    """What comes nearest where nothing explains all: no claim, its numbers are told without error.

    causes : cause.Cause that hold together;  where : Place of each that has one
    fit : StreamFit per stream, `named` with them; () where their full fit did not settle
    """

    causes: tuple
    where: tuple = ()
    fit: tuple = ()


@dataclass(frozen=True)
class StreamFit:
    """Root mean square error per axis of one stream on what was held out, SI.

    as_given : the scene as it came;  recalibrated : its parameters fitted, no new physics
    named : with the causes that were found, None if none was
    noise_floor : what a perfect model would leave;  held_out : in words ('pad_3, run_2')
    mesh : what the mesh may be wrong by beside that, None where a null recording tells
    """

    stream: str
    as_given: float
    recalibrated: float
    noise_floor: float
    named: float | None = None
    held_out: str = ''
    mesh: float | None = None

    def __post_init__(self):
        if self.stream not in UNITS:
            raise InputError(f'fit of stream {self.stream!r}; must be one of {", ".join(UNITS)}')

    @property
    def reached(self):
        """Error with everything that was found."""
        return self.recalibrated if self.named is None else self.named

    @property
    def times_noise(self):
        """The same over what noise alone leaves."""
        return self.reached / self.noise_floor if self.noise_floor else float('inf')

    @property
    def blurred(self):
        """True if what is left is more than noise, and may be the mesh's."""
        return self.mesh is not None and min(self.reached, self.mesh) > SEEN * self.noise_floor


@dataclass(frozen=True)
class NextExperiment:
    """The recording that would decide what is open.

    moves : control.moves.Move in order;  record : streams that must be added ('force', ...)
    splits : pairs of explanations (each a term, or 'a + b') that it tells apart
    separation : the least, over those pairs, that it is expected to reach [sd]
    instruction : what else is to be done first, one sentence
    """

    moves: tuple = ()
    record: tuple = ()
    splits: tuple = ()
    separation: float | None = None
    instruction: str = ''

    def __post_init__(self):
        if not (self.moves or self.record or self.instruction):
            raise InputError('next experiment without moves, streams or an instruction; must ask '
                             'for something')


@dataclass(frozen=True)
class Unfinished:
    """Why an answer is not whole, and how far the diagnosis came.

    why : 'interrupted' (by a person), 'time_limit' or 'quick' (asked for as a quick look)
    seconds : [s] after which it ended;  done, left : names of steps that are over, and are not
    simplified : sentences on what was made coarser than in a full run
    """

    why: Literal['interrupted', 'time_limit', 'quick']
    seconds: float
    done: tuple
    left: tuple
    simplified: tuple = ()

    def __post_init__(self):
        if self.why not in ('interrupted', 'time_limit', 'quick'):
            raise InputError(f'unfinished by {self.why!r}; must be interrupted, time_limit or '
                             'quick')


@dataclass(frozen=True)
class Screened:
    """A candidate term by its sensitivity alone, to first order.

    term : of the registry;  variant : at which of the places tried, in words
    evidence, held_out : gains in log evidence, and on what was held out, over no term
    size : of its first parameter, in words with its unit; '' = not known
    full_fit : log evidence by a full fit, None where there is none yet
    """

    term: str
    variant: str
    evidence: float
    held_out: float
    size: str = ''
    full_fit: float | None = None
