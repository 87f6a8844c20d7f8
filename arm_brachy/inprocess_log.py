"""What happens in a run in one process, kept as the recorder keeps it."""

from collections import Counter, defaultdict

import numpy as np

from arm_brachy import cell as cells
from arm_brachy import provenance
from arm_brachy.core.outcome import Outcome
from arm_brachy.evaluation.moves import move_windows
from arm_brachy.evaluation.timeseries import (
    EmSamples,
    NodeOutcome,
    OpticalFrames,
    RunData,
    Series,
    TargetEstimates,
    Tissue,
)
from arm_brachy.offline import tasks_planned, with_scene
from arm_brachy.offline_procedure import FRAME_EVERY, procedure_of, with_instruments
from arm_brachy.scenario import bundle


class RunLog:
    """Samples by signal, tasks and moves, outcomes as the nodes would publish them.

    windows : list of TaskWindow;  events : list of control.move_events.Event; both grow
    steps, periods, frames, shafts : of a procedure, see offline_procedure.procedure_of
    """

    def __init__(self, cell):
        """cell : scenario.Cell."""
        self._cell = cell
        self._pads = tuple(p.name for p in cell.scene.pads)
        self._samples, self.windows, self.events = defaultdict(list), [], []
        self._outcomes, self._now, self._said = Counter(), {}, {}
        self.steps, self.periods, self.frames, self.shafts = [], [], [], {}
        self._shapes = []

    def add(self, signal, t, value):
        """Append one sample at t [s]."""
        self._samples[signal].append((t, value))

    def shape(self, t, x):
        """Keep the plant's nodes (n, 3) [m], one in a second: pictures need no more."""
        if not self._shapes or t - self._shapes[-1][0] >= FRAME_EVERY:
            self._shapes.append((t, x))

    def estimate(self, name, estimate):
        """Append what an estimator said (Estimate) of each target."""
        t = round(estimate.t * 1e9) * 1e-9
        for target, point, covariance in zip(estimate.targets, estimate.points,
                                             estimate.covariance, strict=True):
            self.add(('estimate', name, target), t, np.vstack([point, covariance]))

    def note(self, source, outcome, message=''):
        """Count an outcome when it changes, as the nodes publish it."""
        if (outcome, message) != self._now.get(source, (Outcome.OK, '')):
            self._now[source] = (outcome, message)
            self.count(source, outcome, message)

    def count(self, source, outcome, message):
        """Count one outcome at once."""
        self._outcomes[source, outcome.name] += 1
        self._said[source, outcome.name] = message or outcome.advice

    def data(self, point_names, mesh=None):
        """What happened so far as RunData; a task or move that is not over yet is left out.

        point_names : of the columns of the signal 'points';  mesh : TetMesh of the plant's nodes
        """
        scenario, origin = self._cell.scenario, provenance.of(self._cell)
        points, forces = self._series('points'), self._forces()
        truth = {} if points is None else {
            name: Series(points.t, points.values[:, i]) for i, name in enumerate(point_names)}
        found = RunData(
            name=scenario.name, scenario=bundle(self._cell)['scenario.yaml'], seed=scenario.seed,
            commit=origin['commit'], machine=origin['machine'], recorded_at=origin['start'],
            feedback=scenario.feedback,
            tasks=tuple(self.windows), tasks_planned=tasks_planned(scenario),
            moves=move_windows(self.events), moves_planned=len(scenario.moves) or None,
            truth=truth, em=self._em(), encoder=self._series('encoder'), encoder_pads=self._pads,
            command_position=self._series('command'), pad_displacement=self._series('pads'),
            optical=self._optical(), force=forces, estimates=self._estimates(),
            force_pads=() if forces is None else tuple(sorted(self._pads)),
            outcomes=tuple(NodeOutcome(*key, n, self._said[key])
                           for key, n in sorted(self._outcomes.items())),
            procedure=with_instruments(procedure_of(
                self._series, self.steps, self.periods, self.frames, self.shafts), self._cell),
            tissue=None if mesh is None or not self._shapes else Tissue(
                np.array([t for t, _ in self._shapes]), np.stack([x for _, x in self._shapes]),
                mesh.nodes, mesh.tets))
        return with_scene(found, self._cell.scene)

    def _series(self, name):
        if name not in self._samples:
            return None
        times, values = zip(*self._samples[name], strict=True)
        return Series(np.array(times), np.array(values))

    def _em(self):
        found = {tool: self._series(('em', tool)) for tool in self._cell.em_tools}
        return {tool: EmSamples(s.t, s.values[:, :3], s.values[:, 3], s.values[:, 4].astype(int))
                for tool, s in found.items() if s is not None}

    def _estimates(self):
        out = {}
        for _, name, target in [k for k in self._samples if k[0] == 'estimate']:
            said = self._series(('estimate', name, target))
            out.setdefault(name, {})[target] = TargetEstimates(said.t, said.values[:, 0],
                                                               said.values[:, 1:])
        return out

    def _forces(self):
        series = [self._series(('force', pad)) for pad in sorted(self._pads)]
        if not series or series[0] is None:
            return None
        return Series(series[0].t, np.stack([s.values for s in series], axis=1))

    def _optical(self):
        points = self._series('optical')
        if points is None:
            return None
        return OpticalFrames(points.t, cells.marker_names(self._cell), points.values,
                             self._series('visible').values)
