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
)
from arm_brachy.offline import with_scene
from arm_brachy.scenario import bundle


class RunLog:
    """Samples by signal, tasks and moves, outcomes as the nodes would publish them.

    windows : list of TaskWindow;  events : list of control.move_events.Event; both grow
    """

    def __init__(self, cell):
        """cell : scenario.Cell."""
        self._cell = cell
        self._pads = tuple(p.name for p in cell.scene.pads)
        self._samples, self.windows, self.events = defaultdict(list), [], []
        self._outcomes, self._now, self._said = Counter(), {}, {}

    def add(self, signal, t, value):
        """Append one sample at t [s]."""
        self._samples[signal].append((t, value))

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

    def data(self, point_names):
        """What happened so far as RunData; a task or move that is not over yet is left out.

        point_names : of the columns of the signal 'points'
        """
        scenario, origin = self._cell.scenario, provenance.of(self._cell)
        points, forces = self._series('points'), self._forces()
        truth = {} if points is None else {
            name: Series(points.t, points.values[:, i]) for i, name in enumerate(point_names)}
        found = RunData(
            name=scenario.name, scenario=bundle(self._cell)['scenario.yaml'], seed=scenario.seed,
            commit=origin['commit'], machine=origin['machine'], recorded_at=origin['start'],
            feedback=scenario.feedback,
            tasks=tuple(self.windows), tasks_planned=len(scenario.tasks) or None,
            moves=move_windows(self.events), moves_planned=len(scenario.moves) or None,
            truth=truth, em=self._em(), encoder=self._series('encoder'), encoder_pads=self._pads,
            command_position=self._series('command'), pad_displacement=self._series('pads'),
            optical=self._optical(), force=forces, estimates=self._estimates(),
            force_pads=() if forces is None else tuple(sorted(self._pads)),
            outcomes=tuple(NodeOutcome(*key, n, self._said[key])
                           for key, n in sorted(self._outcomes.items())))
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
