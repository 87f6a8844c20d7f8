"""What the other streams saw while nobody knows where the pads were is not used."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.stream import ENCODER
from arm_brachy.evaluation.timeseries import Series

PLAY = {'name': 'backlash', 'width_mm': 0.5, 'actuators': [0]}


def silent(run, start, end, pads=slice(None)):
    """RunData whose encoders of `pads` hold no value from start to end [s]."""
    values = run.encoder.values.copy()
    values[(run.encoder.t > start) & (run.encoder.t < end), pads] = np.nan
    return replace(run, encoder=Series(run.encoder.t, values))


def lacking(run, start, end):
    """RunData without encoders from start to end [s]."""
    kept = (run.encoder.t <= start) | (run.encoder.t >= end)
    return replace(run, encoder=Series(run.encoder.t[kept], run.encoder.values[kept]))


@pytest.mark.parametrize('lose', [silent, pytest.param(lacking, marks=pytest.mark.validate)])
def test_pads_that_moved_unseen_make_nothing_else_jump(recorded, look, lose):
    """Pushes of two pads fall into 4 s, at whose ends one of them stands elsewhere."""
    prepared, structure = look(lose(recorded(), 5.0, 9.0))
    assert structure.findings == ()
    note, = (note for note in prepared.evidence.notes if 'unseen' in note)
    (start, end), = prepared.evidence.blind
    assert start < 5.0 and end > 9.0 and end - start < 4.5
    assert f'{start:.1f} to {end:.1f} s' in note
    for kind, stream in prepared.evidence.streams.items():
        hidden = (stream.t > start) & (stream.t < end)
        assert kind == ENCODER or not stream.valid[hidden].any() and stream.valid[~hidden].any()


def test_one_encoder_is_enough(recorded, look):
    assert look(silent(recorded(), 5.0, 9.0, 1))[1].findings == ()


def test_nothing_is_known_after_the_last_reading(recorded, look):
    assert look(lacking(recorded(), 17.0, 99.0))[1].findings == ()


def test_only_the_encoders_were_not_seen_for_long(recorded, look):
    findings = look(silent(recorded(), 10.0, 16.5))[1].findings
    assert {(f.stream, f.term) for f in findings} == {(ENCODER, None)} and len(findings) == 3


def test_a_fault_is_found_beside_a_gap(recorded, look):
    found, = look(silent(recorded(PLAY), 5.0, 9.0))[1].findings
    assert found.term == 'backlash' and found.value == pytest.approx(0.5e-3, rel=0.15)


@pytest.mark.parametrize('start', [0.5, 3.0])
def test_a_pad_that_stands_may_be_silent(recorded, laboratory, start):
    """At home from 0.5 s on; a gap of 0.15 s at any time."""
    run = recorded()
    quiet = silent(run, start, 1.5 if start < 1.0 else start + 0.15)
    found = evidence_of(quiet, laboratory().scene)
    assert found.blind == () and not [note for note in found.notes if 'unseen' in note]


def test_an_encoder_that_is_read_seldom_has_no_gaps_but_corners_between_readings(recorded, look):
    """Five times a second: the path is known in holds and on ramps, not where one begins."""
    run = recorded()
    seldom = replace(run, encoder=Series(run.encoder.t[::10], run.encoder.values[::10]))
    prepared, structure = look(seldom)
    assert structure.findings == ()
    assert [note for note in prepared.evidence.notes if 'changed their speed' in note]
    assert not [note for note in prepared.evidence.notes if 'unseen' in note]


def test_a_path_known_at_single_times_is_taken_for_straight(recorded, laboratory):
    run, rng = recorded(), np.random.default_rng(1)
    values = np.where(rng.random(run.encoder.values.shape) < 0.8, np.nan, run.encoder.values)
    found = evidence_of(replace(run, encoder=Series(run.encoder.t, values)), laboratory().scene)
    assert found.blind == () and 'most of the recording' in found.notes[-1]
