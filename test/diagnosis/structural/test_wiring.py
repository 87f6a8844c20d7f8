"""What an import mixes up is refused with what to mend, and what wears or slips is not."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import RecordingError
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.preparation import prepare
from arm_brachy.diagnosis.signals.stream import ENCODER, FORCE, OPTICAL


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
    (FORCE, np.negative, 'mend `sign`'),
    (ENCODER, lambda values: values * [[[-1.0], [1.0], [1.0]]],
     'markers on pad_0 move against their encoders'),
    (FORCE, lambda values: values * [[[1.0], [-1.0], [1.0]]], 'forces on pad_1 pull'),
    (ENCODER, lambda values: 0.1 * values, 'go ten times as far as their encoders say'),
    (ENCODER, lambda values: values / 25.4, 'go 25.4 times as far')])
def test_signs_and_names_that_are_mixed_up_are_refused(sound, kind, change, said):
    with pytest.raises(RecordingError, match=said):
        prepare(changed(sound, kind, change))


def test_pads_that_mostly_move_together_are_told_apart_by_what_they_do_alone(recorded, laboratory):
    """Two pads in and out at once, then one a little further: exchanged encoders are found."""
    both, more = np.array([6e-3, 6e-3, 0.0]), np.array([8e-3, 6e-3, 0.0])
    run = laboratory().record([(both, 0.02, 0.5), (more, 0.02, 0.5), (both, 0.02, 0.5),
                               (np.zeros(3), 0.02, 0.5)])
    evidence = evidence_of(run, laboratory().scene)
    assert prepare(evidence).motion is not None
    with pytest.raises(RecordingError, match='marker on pad_0 goes with the encoder of pad_1'):
        prepare(changed(evidence, ENCODER, swapped))


def test_markers_on_a_clock_that_is_far_off_are_refused(sound):
    stream = sound.streams[OPTICAL]
    late = replace(sound, streams={**sound.streams, OPTICAL: replace(stream, t=stream.t + 7.0)})
    with pytest.raises(RecordingError, match='bring both on one clock'):
        prepare(late)


@pytest.mark.parametrize('kind, factor', [(ENCODER, 3.0), (OPTICAL, 1.0), (FORCE, 0.2)])
def test_scales_that_are_off_are_not(sound, kind, factor):
    """An actuator that goes a third as far as it is told is one that is worn."""
    assert prepare(changed(sound, kind, lambda values: factor * values)).motion is not None
