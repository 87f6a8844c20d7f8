"""How well a model of tissue can do at best, besides the errors of its mesh (`discretisation`).

What a mesh does wrong is the same at every push; here is what is not: interplay of pads, paths
between the samples of an encoder, actuators that err from place to place.
"""

from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.core.quantity import quantity
from arm_brachy.diagnosis.likelihood.nuisances import Nuisances
from arm_brachy.diagnosis.signals.stream import ENCODER


@dataclass(frozen=True)
class Accuracy:
    """How well a model can be expected to do, one standard deviation."""

    share: float = quantity(0.005, '', 'error over motion from rest, or over force, of a channel, '
                            'per axis, from state to state', low=0.0, high=1.0,
                            source='own choice: pairs of pads beside the sum of single ones, '
                                   'where meshes differ (a tenth of 5 %)')
    law: float = quantity(0.05, '', 'error over effect of a cause as it was fitted, per row',
                          low=0.0, high=1.0, source='own choice: no law of a soft material holds '
                                                    'to better than some per cent')
    timing: float = quantity(0.05, '', 'error of the time of a moving state over the period of '
                             'the encoders', low=0.0, high=1.0,
                             source='own choice: a path between samples is not straight')


def with_accuracy(measured, shown, rest, channels, accuracy=None):
    """observables.Measured each with what the model may be wrong by, state by state, as their own.

    shown : kind -> (n, c, 3) of the model;  channels : kind -> names of its c;  rest : the same
        as shown, with the pads at home
    """
    share, out = (accuracy or Accuracy()).share, []
    for stream in measured:
        index = [channels[stream.kind].index(name) for name in stream.names]
        moved = (shown[stream.kind] - rest[stream.kind])[:, index]
        size = share * np.linalg.norm(moved, axis=2)[..., None]
        out.append(replace(stream, own=np.broadcast_to(size, stream.sd.shape)))
    return tuple(out)


def timing_errors(baseline, recorded, accuracy=None):
    """Return Nuisances: where the pads were in each moving state, known to a share of a sample.

    recorded : recordings.Recorded. Moves every channel as the pads move it.
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


def path_errors(baseline, recorded):
    """Return Nuisances: where noisy encoders leave every pad in every state, apart from the rest.

    recorded : recordings.Recorded, its encoders steadied. A column per state and pad.
    """
    states, encoder = recorded.states, recorded.prepared.evidence.get(ENCODER)
    pads = baseline.model.specimen.pads
    sizes = np.array([encoder.path_error(width) for width in states.width])     # (n, channels)
    which = [(i, c) for i, c in np.argwhere(sizes > 0.0) if encoder.names[c] in pads]
    values = {kind: np.zeros((*shown.shape, len(which))) for kind, shown in
              baseline.shown.items()}
    for j, (i, c) in enumerate(which):
        moved = np.zeros(len(pads))
        moved[pads.index(encoder.names[c])] = sizes[i, c]
        for kind, change in baseline.pads_moved(i, moved).items():
            values[kind][i, ..., j] = change
    names = tuple(f'path_{encoder.names[c]}_{states.t[i]:.2f}' for i, c in which)
    return Nuisances(names, values)


def course_errors(baseline, recorded):
    """Return Nuisances: how far off the course of an uneven actuator may be that was put right.

    recorded : recordings.Recorded. As many columns as its courses have modes; pads whose courses
    are even have none.
    """
    encoder, pads = recorded.prepared.evidence.get(ENCODER), baseline.model.specimen.pads
    values, names = {kind: [np.zeros((*shown.shape, 0))] for kind, shown in
                     baseline.shown.items()}, []
    for one in recorded.structure.pads:
        if one.course is None:
            continue
        c, unit = encoder.names.index(one.pad), np.array([float(pad == one.pad) for pad in pads])
        seen = encoder.valid[:, c]
        unsure = one.course.unsure(np.interp(
            baseline.t, encoder.t[seen], encoder.values[seen, c, 0]))
        moved = [baseline.pads_moved(i, unit) for i in range(len(baseline.t))]
        for kind, parts in values.items():
            by = np.stack([change[kind] for change in moved])
            parts.append(by[..., None] * unsure[:, None, None, :])
        names += [f'course_{one.pad}_{k}' for k in range(unsure.shape[1])]
    return Nuisances(tuple(names), {kind: np.concatenate(parts, axis=3)
                                    for kind, parts in values.items()})
