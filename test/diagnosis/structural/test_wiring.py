"""What an import mixes up is refused with what to mend, and what wears or slips is not."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.evidence import evidence_of
from arm_brachy.diagnosis.prepared import prepare
from arm_brachy.diagnosis.stream import ENCODER, FORCE, OPTICAL


@pytest.fixture(scope='module')
def sound(recorded, laboratory):
    return evidence_of(recorded(), laboratory().scene)


def changed(evidence, kind, change):
    stream = evidence.streams[kind]
    return replace(evidence, streams={
        **evidence.streams, kind: replace(stream, values=change(stream.values.copy()))})


def swapped(values):
    values[:, [0, 1]] = values[:, [1, 0]]
    return values


@pytest.mark.parametrize('kind, change, said', [
    (ENCODER, np.negative, 'mend the sign of the encoders'),
    (ENCODER, swapped, 'marker on pad_0 goes with the encoder of pad_1'),
    (FORCE, swapped, 'force on pad_0 goes with the encoder of pad_1'),
    (FORCE, np.negative, 'mend `sign`')])
def test_signs_and_names_that_are_mixed_up_are_refused(sound, kind, change, said):
    with pytest.raises(RecordingError, match=said):
        prepare(changed(sound, kind, change))


def test_markers_on_a_clock_that_is_far_off_are_refused(sound):
    stream = sound.streams[OPTICAL]
    late = replace(sound, streams={**sound.streams, OPTICAL: replace(stream, t=stream.t + 7.0)})
    with pytest.raises(RecordingError, match='bring both on one clock'):
        prepare(late)


@pytest.mark.parametrize('kind, factor', [(ENCODER, 3.0), (OPTICAL, 1.0), (FORCE, 0.2)])
def test_scales_that_are_off_are_not(sound, kind, factor):
    """An actuator that goes a third as far as it is told is one that is worn."""
    assert prepare(changed(sound, kind, lambda values: factor * values)).motion is not None
