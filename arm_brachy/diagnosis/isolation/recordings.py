"""One recording, looked at without a tissue model: what it shows, how it moved, where to look."""

from dataclasses import dataclass, replace

from arm_brachy.diagnosis.isolation.isolate import Structure, structure_of
from arm_brachy.diagnosis.signals.load_states import (
    LIMIT,
    LoadStates,
    load_states,
    unseen,
    without,
)
from arm_brachy.diagnosis.signals.motion import Path, motion_of
from arm_brachy.diagnosis.signals.preparation import Prepared, prepare
from arm_brachy.diagnosis.signals.push_folds import kinds_of
from arm_brachy.diagnosis.signals.stream import ENCODER, OPTICAL


@dataclass(frozen=True)
class Recorded:
    """prepared : Prepared;  structure : Structure;  states : LoadStates, clocks put right

    kinds : (m,) kind of experiment of every state
    """

    prepared: Prepared
    structure: Structure
    states: LoadStates
    kinds: tuple

    @property
    def name(self):
        """Of the recording."""
        return self.prepared.evidence.name

    @property
    def path(self):
        """The encoders' transmission.Path, corners and states."""
        return Path(self.states.path_t, self.states.path_q)


def look(evidence, *, limit=LIMIT, devices=None, calibration=None, noise=None):
    """Recorded of an loading.Evidence with pads.

    limit : load states at most;  devices, calibration, noise : as `preparation.prepare`
    """
    prepared = prepare(evidence, devices, calibration, noise)
    structure = structure_of(prepared)
    late = {kind: structure.late(kind) for kind in structure.clocks}
    onsets = [finding.onset for finding in structure.findings if finding.onset]
    jumps = [t for onset in onsets for t in onset]
    even = _put_right(prepared, structure.pads)
    events = {sum(onset) / 2.0 for onset in onsets}
    states = without(load_states(even, late, limit, structure.rhythm, events), jumps)
    if structure.turning:
        optical = evidence.get(OPTICAL)
        states = unseen(states, OPTICAL, optical.named(*structure.turning))
    return Recorded(prepared, structure, states, kinds_of(states, evidence.pads))


def _put_right(prepared, pads):
    """The Prepared with encoders that show what uneven actuators do, as markers on pads prove it.

    pads : pad_tracking.PadTravel each
    """
    uneven = {one.pad: one.course for one in pads if one.course is not None}
    if not uneven:
        return prepared
    evidence = prepared.evidence
    encoder = evidence.get(ENCODER)
    values = encoder.values.copy()
    for pad, course in uneven.items():
        i = encoder.names.index(pad)
        values[:, i, 0] += course.error(values[:, i, 0])
    evidence = replace(evidence, streams={**evidence.streams,
                                          ENCODER: replace(encoder, values=values)})
    return replace(prepared, evidence=evidence, motion=motion_of(evidence))
