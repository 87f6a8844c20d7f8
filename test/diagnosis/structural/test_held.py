"""Slow sensors in a log of a faster rate: each reading counts once, at its first stamp."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.diagnosis.signals.repeated_readings import once
from arm_brachy.diagnosis.signals.stream import ENCODER, FORCE, OPTICAL, Stream

T = np.arange(0.0, 30.0, 0.01)


def stream(kind, values):
    """A Stream of 100 Hz on two channels."""
    return Stream(kind, T, ('a', 'b'), values, np.isfinite(values).all(axis=2), ('a', 'b'),
                  np.zeros((2, values.shape[2])))


def held(values, every):
    """Rows of every `every`th sample, written until the next is there."""
    rows = np.arange(len(values))
    return values[rows - rows % every]


def moving(components, rng, noise=0.0):
    """(n, 2, c) that goes and stands in turn, at two speeds."""
    path = np.interp(T, [0, 2, 4, 6, 6.5, 12, 12.5, 30], [0, 0, 5, 5, 0, 0, 5, 5])
    values = np.stack([path, 2.0 * path], axis=1)[..., None] * np.ones(components)
    return values + noise * rng.standard_normal(values.shape)


@pytest.mark.parametrize('kind, components', [(FORCE, 3), (OPTICAL, 3), (ENCODER, 1)])
@pytest.mark.parametrize('every', [2, 5])
def test_each_reading_is_kept_at_its_first_stamp(kind, components, every):
    values, notes = moving(components, np.random.default_rng(1), 1e-2), []
    found = once(stream(kind, held(values, every)), notes)
    assert 'first stamp was taken' in notes[0]
    assert found.t == pytest.approx(T[::every])
    assert np.array_equal(found.values, values[::every])


def test_one_speed_is_enough():
    """Counts of 5 um, read every 0.1 s at 4 mm/s."""
    path = np.interp(T, [0, 2.03, 4.03, 6.01, 8.01, 30], [0, 0, 8, 8, 0, 0])
    counts = np.round(np.stack([path, 0.5 * path], axis=1)[..., None] / 5e-3) * 5e-3
    notes = []
    assert once(stream(ENCODER, held(counts, 10)), notes).t == pytest.approx(T[::10]) and notes


def test_encoders_that_stand_keep_a_sample_per_reading():
    """Without noise nothing changes there; what was written last before a move is no reading."""
    values, notes = moving(1, np.random.default_rng(1)), []
    found = once(stream(ENCODER, held(values, 5)), notes)
    assert found.t == pytest.approx(T[::5])


@pytest.mark.parametrize('kind, values', [
    (ENCODER, moving(1, np.random.default_rng(1))),
    (ENCODER, np.round(moving(1, np.random.default_rng(1)) / 0.2) * 0.2),
    (FORCE, moving(3, np.random.default_rng(1))),
    (FORCE, np.round(moving(3, np.random.default_rng(1), 0.1) / 0.2) * 0.2),
    (OPTICAL, moving(3, np.random.default_rng(1), 0.1))],
    ids=['encoders that stand', 'coarse counts', 'no noise', 'coarse forces', 'every reading new'])
def test_what_is_not_written_twice_is_left_as_it_is(kind, values):
    one, notes = stream(kind, values), []
    assert once(one, notes) is one and notes == []


@pytest.mark.parametrize('slow', ['encoder', *(
    pytest.param(name, marks=pytest.mark.validate) for name in ('force', 'optical'))])
def test_a_sound_recording_with_a_held_stream_has_no_findings(recorded, look, slow):
    run, every = recorded(), {'encoder': 5, 'force': 5, 'optical': 3}[slow]
    one = getattr(run, slow)
    fields = ('points', 'visible') if slow == 'optical' else ('values',)
    changed = replace(one, **{name: held(getattr(one, name), every) for name in fields})
    assert look(replace(run, **{slow: changed}))[1].findings == ()


def test_a_fault_is_found_beside_held_encoders(recorded, look):
    run = recorded({'name': 'actuator_gain', 'gain': -0.06, 'actuators': [0]})
    found, = look(replace(run, encoder=replace(
        run.encoder, values=held(run.encoder.values, 5))))[1].findings
    assert found.term == 'actuator_gain' and found.value == pytest.approx(-0.06, rel=0.15)
