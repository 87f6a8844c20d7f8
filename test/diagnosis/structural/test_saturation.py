"""A force sensor at the end of its range is not seen there; one with coarse counts is."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.stream import FORCE


def forces(run, change):
    return replace(run, force=replace(run.force, values=change(run.force.values)))


def test_what_a_sensor_at_its_end_reads_is_left_out(recorded, laboratory):
    run = recorded()
    found = evidence_of(forces(run, lambda v: np.clip(v, -1.5, 1.5)), laboratory().scene)
    note = next(note for note in found.notes if 'the end of its range' in note)
    assert '1.5 N' in note
    stream = found.get(FORCE)
    whole = evidence_of(run, laboratory().scene).get(FORCE)
    beyond = np.abs(whole.values).max(axis=2) > 1.55
    assert beyond.any() and not stream.valid[beyond].any()
    within = np.abs(whole.values).max(axis=2) < 1.45
    assert stream.valid[within].mean() > 0.99


@pytest.mark.parametrize('change', [lambda v: v, lambda v: np.round(v / 0.2) * 0.2,
                                    lambda v: v * np.array([1.0, 0.0, 0.0])],
                         ids=['whole', 'coarse counts', 'one axis'])
def test_a_sensor_within_its_range_is_seen(recorded, laboratory, change):
    found = evidence_of(forces(recorded(), change), laboratory().scene)
    assert not [note for note in found.notes if 'range' in note] and found.get(FORCE).valid.all()
