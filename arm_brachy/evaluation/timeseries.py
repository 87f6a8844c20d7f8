"""What an evaluation needs of one run, as plain arrays: SI, world frame, time in seconds.

`recording` fills these from a bag, a test fills them by hand; no metric or figure knows about
bags. Whatever a real recording lacks (truth, forces, tissue) is None or empty, and the numbers
that would need it are left out rather than guessed.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

TRACKED = 0


@dataclass(frozen=True)
class Series:
    """A sampled signal.

    t : (n,) [s], non-decreasing;  values : (n, ...) SI
    """

    t: np.ndarray
    values: np.ndarray

    def between(self, t_start, t_end):
        """The samples with t_start <= t <= t_end [s]."""
        keep = (self.t >= t_start) & (self.t <= t_end)
        return Series(self.t[keep], self.values[keep])

    def __len__(self):
        """Number of samples."""
        return len(self.t)


@dataclass(frozen=True)
class EmSamples:
    """What an EM tracker said of one tool.

    t : (n,) [s];  position : (n, 3) [m], anything where the tool was not tracked
    quality : (n,) the tracker's own figure of merit (0 is best; NaN where none was given)
    status : (n,) integer, TRACKED = 0 or the tracker's code (missing, out of volume, bad fit)
    """

    t: np.ndarray
    position: np.ndarray
    quality: np.ndarray
    status: np.ndarray

    def tracked(self):
        """Series of the positions that are measurements: status TRACKED and finite."""
        keep = (np.asarray(self.status) == TRACKED) & np.isfinite(self.position).all(axis=1)
        return Series(self.t[keep], self.position[keep])


@dataclass(frozen=True)
class TargetEstimates:
    """What an estimator said of one target.

    t : (n,) [s] of acquisition;  points : (n, 3) [m];  covariance : (n, 3, 3) [m^2]
    """

    t: np.ndarray
    points: np.ndarray
    covariance: np.ndarray

    def between(self, t_start, t_end):
        """Those with t_start <= t <= t_end [s]."""
        keep = (self.t >= t_start) & (self.t <= t_end)
        return TargetEstimates(self.t[keep], self.points[keep], self.covariance[keep])


@dataclass(frozen=True)
class OpticalFrames:
    """Optical marker frames.

    t : (n,) [s];  ids : k marker names;  points : (n, k, 3) [m];  visible : (n, k) bool
    """

    t: np.ndarray
    ids: tuple
    points: np.ndarray
    visible: np.ndarray


@dataclass(frozen=True)
class TaskWindow:
    """One manipulation task: bring a target from where it was to a goal.

    target : name of the target (key of RunData.truth and RunData.em)
    t_start, t_end : [s] goal accepted, goal given up or replaced
    start, goal : (3,) [m];  axes : (3,) bool, True where the goal binds (False = left free)
    mode : 'closed_loop' or 'open_loop'
    """

    name: str
    target: str
    t_start: float
    t_end: float
    start: np.ndarray
    goal: np.ndarray
    axes: np.ndarray
    mode: str = 'closed_loop'


@dataclass(frozen=True)
class Regime:
    """A named interval of a recording ('hold', 'release', 'ringing'): [t_start, t_end] in s."""

    name: str
    t_start: float
    t_end: float


@dataclass(frozen=True)
class MoveWindow:
    """One prescribed move of the pads.

    t_start, t_end : [s] first command, end of its last hold or of the attempt
    regimes : Regime, as commanded: the pads follow a tick later
    made : the pads arrived;  message : why not
    """

    name: str
    t_start: float
    t_end: float
    regimes: tuple
    made: bool
    message: str = ''


@dataclass(frozen=True)
class Tissue:
    """Snapshots of the true tissue.

    t : (k,) [s];  positions : (k, n, 3) [m];  rest : (n, 3) [m];  tets : (m, 4) node indices
    """

    t: np.ndarray
    positions: np.ndarray
    rest: np.ndarray
    tets: np.ndarray


@dataclass(frozen=True)
class PadMark:
    """Where a pad sits at rest: centre (3,) [m], direction (3,) unit vector into the tissue.

    radius : [m] of its disc, as large as a scene has it unless it says otherwise
    """

    name: str
    centre: np.ndarray
    direction: np.ndarray
    radius: float = 8e-3


@dataclass(frozen=True)
class TopicRecord:
    """What was recorded on one topic.

    stamps : (n,) [s] header stamps (acquisition), or log times where the type has no header
    published : messages sent according to the publishers' sequence counters; None = not counted
    """

    topic: str
    kind: str
    stamps: np.ndarray
    published: int | None = None


@dataclass(frozen=True)
class NodeOutcome:
    """How often a node reported one outcome (`core.outcome`), and what it said last."""

    node: str
    outcome: str
    count: int
    message: str = ''


@dataclass(frozen=True)
class RunData:
    """One run of the cell, ready to be evaluated. Optional parts are empty or None.

    name : of the scenario;  scenario : resolved scenario as YAML text;  seed : the scenario's
    commit, machine : what ran where;  command : what a person types to get this run again
    tasks : TaskWindow, in order of time, that were begun and are over
    tasks_planned : number of tasks in the scenario; None where there are none or nobody set goals
    moves : MoveWindow, in order of time, that are over;  moves_planned : as tasks_planned
    truth : target name -> Series of (n, 3) [m]; empty on a real recording
    em : target name -> EmSamples
    estimates : estimator name -> target name -> TargetEstimates
    feedback : what the controller heard the target from: 'em' or an estimator
    em_registered : target name -> Series of (n, 3) [m], EM positions brought to the estimates'
        frame, what these are compared with where there is no truth
    encoder, command_position : Series of (n, p) [m], pushes from rest along the pads' directions
    pad_displacement : Series of (n, p) [m], the true pads' (differs from the encoder by play)
    encoder_pads : names of the pads of these three; empty = not known
    force : Series of (n, p, 3) [N], tissue on pad, NaN where a pad's was not measured
    force_pads : names of its pads
    optical : OpticalFrames;  tissue : Tissue;  pads : PadMark per actuator, same order as encoder
    markers : marker name -> rest position (3,) [m]
    topics : TopicRecord;  outcomes : NodeOutcome
    departures : (t [s], sentence) each time that the mismatch monitor found one
    wall_time : [s] on the clock on the wall between the first and the last message; None = unknown
    recorded_at : date and time as text
    procedure : evaluation.procedure_data.ProcedureData of a run with needle and probe, else None
    left_out : topics of channels of the bag that hold no ROS 2 messages
    """

    name: str
    scenario: str
    seed: int
    commit: str
    machine: str
    command: str = ''
    recorded_at: str = ''
    tasks: tuple = ()
    tasks_planned: int | None = None
    moves: tuple = ()
    moves_planned: int | None = None
    truth: dict = field(default_factory=dict)
    em: dict = field(default_factory=dict)
    estimates: dict = field(default_factory=dict)
    feedback: str = 'em'
    em_registered: dict = field(default_factory=dict)
    encoder: Series | None = None
    command_position: Series | None = None
    pad_displacement: Series | None = None
    encoder_pads: tuple = ()
    left_out: tuple = ()
    force: Series | None = None
    force_pads: tuple = ()
    optical: OpticalFrames | None = None
    tissue: Tissue | None = None
    pads: tuple = ()
    markers: dict = field(default_factory=dict)
    topics: tuple = ()
    outcomes: tuple = ()
    departures: tuple = ()
    wall_time: float | None = None
    procedure: object = None

    @property
    def reference(self):
        """Target name -> Series that estimates are compared with: truth, else registered EM."""
        return self.truth or self.em_registered

    @property
    def reference_name(self):
        """What the reference is, in words."""
        return 'truth' if self.truth else 'EM sensor'

    def span(self):
        """First and last stamp [s] over all topics; (nan, nan) if nothing was recorded."""
        stamped = [r.stamps for r in self.topics if len(r.stamps)]
        if not stamped:
            return np.nan, np.nan
        return min(s.min() for s in stamped), max(s.max() for s in stamped)


@dataclass(frozen=True)
class ResidualData:
    """A recording beside what a model says of it, marker by marker.

    t : (n,) [s];  names : k markers
    measured, predicted : (n, k, 3) [m], same frame; NaN where a marker was not seen
    rest : (k, 3) [m] marker positions at rest in that frame
    noise_floor : (k,) [m] rms norm that a perfect model would leave; None = estimate from the data
    registration : (k,) [m] what a rigid fit of model to laboratory frame leaves at rest; None =
        no registration was needed
    regimes : Regime, several may carry one name
    tissue : Tissue predicted, for the picture of the body
    kind : 'position' as above, or 'force': k pads, measured and predicted [N], rest zero
    statement : one sentence, what was replayed against what
    departures : (t [s], sentence) of this stream by the mismatch monitor, if it ran beside
    """

    name: str
    t: np.ndarray
    names: tuple
    measured: np.ndarray
    predicted: np.ndarray
    rest: np.ndarray
    statement: str = ''
    source: str = ''
    scenario: str = ''
    seed: int = 0
    commit: str = 'unknown'
    machine: str = ''
    command: str = ''
    noise_floor: np.ndarray | None = None
    registration: np.ndarray | None = None
    regimes: tuple = ()
    tissue: Tissue | None = None
    kind: Literal['position', 'force'] = 'position'
    departures: tuple = ()
