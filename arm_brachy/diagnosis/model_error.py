"""What no model of tissue gets right: errors that grow with the push, each channel its own.

Elements, the outline of a pad, the shape of the body: they change what a marker does per push by
some per cent, in a way that is the same whenever that pad is pushed and free otherwise. An
ensemble of meshes shows the part that is common to all channels (`mesh_errors`); this is the rest.
Source: model discrepancy as a prior of its own, Kennedy & O'Hagan 2001, J R Stat Soc B 63:425,
here linear and quadratic in each push so that it cannot follow time, rate or the past.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.diagnosis.nuisances import Nuisances
from arm_brachy.diagnosis.stream import EM, ENCODER, FORCE, OPTICAL


@dataclass(frozen=True)
class Accuracy:
    """How well a model can be expected to do, one standard deviation."""

    share: float = quantity(0.02, '', 'error over motion or force of a channel, per axis, of a '
                            'full push', low=0.0, high=1.0,
                            source='own choice: meshes of 2 k quadratic elements among themselves')
    timing: float = quantity(0.05, '', 'error of the time of a moving state over the period of '
                             'the encoders', low=0.0, high=1.0,
                             source='own choice: a path between samples is not straight')


def model_errors(baseline, accuracy=None):
    """Return Nuisances of a baseline.Baseline: two columns per pad, channel and axis.

    accuracy : Accuracy, None = its defaults. Markers on pads and base are left out: no tissue.
    """
    share = (accuracy or Accuracy()).share
    model, n = baseline.model, len(baseline.t)
    q = baseline.path.at(baseline.t)
    deepest = np.maximum(q.max(axis=0), 1e-12)
    by_pad = [baseline.pads_moved(int(q[:, p].argmax()), deepest * (np.arange(q.shape[1]) == p))
              for p in range(q.shape[1])]
    counts = {OPTICAL: len(model.specimen.markers), EM: len(model.specimen.tools),
              FORCE: len(model.specimen.pads)}
    inside = model.attached.inside
    soft = {OPTICAL: inside[:counts[OPTICAL]], EM: inside[counts[OPTICAL]:],
            FORCE: np.ones(counts[FORCE], dtype=bool)}
    names, columns = [], []
    for p in np.flatnonzero(deepest > 1e-6):
        push = q[:, p] / deepest[p]
        for kind, count in counts.items():
            size = share * np.linalg.norm(by_pad[p][kind], axis=1)
            for c in np.flatnonzero(soft[kind][:count]):
                for axis in range(3):
                    for power in (1, 2):
                        names.append(f'model_{kind}_{c}_{axis}_pad_{p}_{power}')
                        columns.append((kind, c, axis, size[c] * push**power))
    values = {kind: np.zeros((n, count, 3, len(names))) for kind, count in counts.items()}
    for j, (kind, c, axis, column) in enumerate(columns):
        values[kind][:, c, axis, j] = column
    return Nuisances(tuple(names), values)


def timing_errors(baseline, recorded, accuracy=None):
    """Return Nuisances: where the pads were in each moving state, known to a share of a sample.

    recorded : recorded.Recorded. Moves every channel as the pads move it.
    """
    share = (accuracy or Accuracy()).timing
    states, encoder = recorded.states, recorded.prepared.evidence.get(ENCODER)
    moving = np.flatnonzero(np.abs(states.velocity).max(axis=1) > 0.0)
    values = {kind: np.zeros((*shown.shape, len(moving))) for kind, shown in
              baseline.shown.items()}
    for j, i in enumerate(moving):
        change = baseline.pads_moved(i, share * encoder.period * states.velocity[i])
        for kind in values:
            values[kind][i, ..., j] = change[kind]
    return Nuisances(tuple(f'timing_{states.t[i]:.2f}' for i in moving), values)
