"""A recording beside its model: whitened residual, what may be in it, what may explain it."""

from dataclasses import dataclass, field, replace

import numpy as np

from arm_brachy.diagnosis.isolation.recordings import Recorded
from arm_brachy.diagnosis.likelihood.discrepancy import (
    course_errors,
    path_errors,
    timing_errors,
    with_accuracy,
)
from arm_brachy.diagnosis.likelihood.discretisation import NAMES
from arm_brachy.diagnosis.likelihood.force_tare import loosened, note, tared
from arm_brachy.diagnosis.likelihood.inertia_bound import with_swing
from arm_brachy.diagnosis.likelihood.nuisances import TOUCH, nuisances
from arm_brachy.diagnosis.likelihood.observation import Observables, channels_of, measured
from arm_brachy.diagnosis.likelihood.tolerances import given_errors, joined, tolerances
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.signals.stream import ENCODER, FORCE

SLOW = 1.0          # s, about as long as rests between pushes are
# Names of places begin so where they differ between recordings (`marker_placement`).
APART = 'apart_'
# Nuisances of one recording alone; all others belong to the set-up and are the same in each.
OWN = ('frame_', 'zero_em_', 'force_', 'clock_', TOUCH, 'timing_', 'path_', 'course_', 'given',
       'restless_', 'modulus_of_nulls', APART)
# Of these, what is set anew before each: where the tracker stands, zeros, where pads touch.
SET_UP = ('frame_', 'zero_em_', 'force_', TOUCH, APART)


@dataclass
class Matched:
    """One recording and the baseline of its model.

    recorded : Recorded;  baseline : Baseline;  observables : Observables
    nuisances : nuisances.Nuisances, tolerances and errors of the mesh included
    finer : kind -> (n, c, 3) SI that elements of no size add to the baseline, {} = not known
    swing : kind -> (n, c) SI that inertia may add (`inertia_bound.Inertia.swing`), {} = nothing
    notes : sentences
    of_mesh : (N,) that, whitened;  r : (N,) whitened residual, it included
    U : (N, k) whitened nuisances
    """

    recorded: Recorded
    baseline: Baseline
    observables: Observables
    nuisances: object
    finer: dict = field(default_factory=dict)
    swing: dict = field(default_factory=dict)
    notes: tuple = ()
    of_mesh: np.ndarray = field(init=False)
    r: np.ndarray = field(init=False)
    U: np.ndarray = field(init=False)

    def __post_init__(self):
        self.of_mesh = self.observables.whiten_shift(self.finer)
        self.r = self.observables.residual(self.baseline.shown) - self.of_mesh
        self.U = self.observables.whiten(self.nuisances.values)

    def loosen(self, names, factor):
        """Multiply the columns of nuisances of these names."""
        chosen = np.where(np.isin(self.nuisances.names, names), factor, 1.0)
        self.nuisances = replace(self.nuisances, values={
            kind: chosen * values for kind, values in self.nuisances.values.items()})
        self.U = self.U * chosen

    def at_limit(self, limit):
        """The Matched with what finer elements come to, a discretisation.Limit of its body."""
        kept = ~np.isin(self.nuisances.names, NAMES)
        others = replace(self.nuisances, names=tuple(np.array(self.nuisances.names)[kept]),
                         values={kind: values[..., kept]
                                 for kind, values in self.nuisances.values.items()})
        return replace(self, nuisances=joined(others, limit.left.along(self.baseline)),
                       finer=limit.along(self.baseline))

    def louder(self, factors):
        """The Matched with the variance of streams, kind -> factor, as far as noise is in doubt.

        What is added lasts for SLOW: longer than the rests that did not show it.
        """
        noise, t = self.recorded.prepared.noise, self.recorded.states.t
        return replace(self, observables=self.observables.louder({
            kind: min(factor, noise[kind].doubt) for kind, factor in factors.items()
            if kind in noise}, np.exp(-np.abs(t[:, None] - t) / SLOW)))

    @property
    def own(self):
        """(k,) True for nuisances that other recordings do not share."""
        return np.array([name.startswith(OWN) for name in self.nuisances.names], dtype=bool)

    @property
    def kinds(self):
        """(N,) kind of experiment of every row."""
        return np.array(self.recorded.kinds, dtype=object)[self.observables.states]


def match(recorded, specimen, ensemble, terms=(), *, calibration=None, accuracy=None,
          several=False, inertia=None):
    """Matched of a Recorded and a specimen.Specimen with terms.

    calibration : finding.Calibration;  accuracy : discrepancy.Accuracy
    several : True beside other recordings, as of `nuisances`
    ensemble : discretisation.Ensemble of its body
    inertia : inertia_bound.Inertia of it, None = has none
    Raises what Baseline raises.
    """
    baseline = Baseline(ForwardModel(specimen, terms), recorded.path, recorded.states.t)
    channels, least = channels_of(specimen), np.abs(recorded.states.q).sum(axis=1).argmin()
    rest = {kind: shown[least] for kind, shown in baseline.shown.items()}
    seen = with_accuracy(measured(recorded.states), baseline.shown, rest, channels, accuracy)
    swing = inertia.swing(recorded.prepared.motion, recorded.states) if inertia else {}
    observables = Observables(with_swing(seen, swing, channels) if swing else seen, channels)
    weight, notes = tared(seen, rest[FORCE], least, specimen, calibration), ()
    if weight is not None:
        shape = baseline.shown[FORCE].shape
        observables = observables.less({FORCE: np.broadcast_to(-weight, shape)})
        calibration, notes = loosened(calibration, weight), (note(recorded.name, weight),)
    parts = [nuisances(baseline, calibration, several=several),
             tolerances(baseline, calibration, recorded.structure.rhythm),
             given_errors(baseline, terms), timing_errors(baseline, recorded, accuracy),
             course_errors(baseline, recorded), ensemble.along(baseline)]
    if recorded.prepared.evidence.get(ENCODER).taken is not None:
        parts.append(path_errors(baseline, recorded))
    return Matched(recorded, baseline, observables, joined(*parts), swing=swing,
                   notes=notes)
