"""Noise and events, each found against the other."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from arm_brachy.core.random import stream as draws
from arm_brachy.diagnosis.isolation import looks
from arm_brachy.diagnosis.isolation.looks import look_at
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.noise import noise_of
from arm_brachy.registry import parse_terms

ONSET, SHARE, MEMORY = 14.0, 0.14, 3.0


@pytest.fixture(scope='module')
def evidence(laboratory, pushes):
    """A pad that loses 0.6 mm half way; a seventh of the camera's noise remembers for 3 s."""
    terms = parse_terms([{'name': 'lost_steps', 'shortfall_mm': 0.6, 'onset_s': ONSET,
                          'actuators': [1]}], 'test')
    lab = laboratory(terms, 4)
    one = evidence_of(lab.record(pushes(pads=(0, 1) * 2, speeds=(0.02,)), rest=3.0), lab.scene)
    optical, sd = one.streams['optical'], noise_of(one)['optical'].sd
    kept, rng = np.exp(-optical.period / MEMORY), draws(0, 'looks')
    kicks = rng.standard_normal(optical.values.shape)
    kicks[1:] *= np.sqrt(1.0 - kept**2)
    slow = np.sqrt(SHARE / (1.0 - SHARE)) * sd * lfilter([1.0], [1.0, -kept], kicks, axis=0)
    return replace(one, streams={**one.streams, 'optical': replace(
        optical, values=optical.values + slow)})


def test_an_event_does_not_hide_the_memory_of_the_noise(evidence):
    """All rests after it are off, which is no noise; those before tell how long that lasts."""
    ((recorded,), notes), *_ = look_at(((evidence,), (), ()))
    colour = recorded.prepared.noise['optical'].colour
    assert noise_of(evidence)['optical'].colour.share < 0.3 * SHARE
    assert colour.share == pytest.approx(SHARE, abs=0.05) and 1.0 < colour.time < 9.0
    found, = recorded.structure.findings
    assert found.term == 'lost_steps' and found.value == pytest.approx(6e-4, rel=0.1)
    assert not notes


def test_too_many_recordings_share_the_states_that_can_be_afforded(evidence, monkeypatch):
    """Seventeen, of which two get a dozen each."""
    def look(one, **how):
        return SimpleNamespace(name=one.name, limit=how['limit'],
                               structure=SimpleNamespace(findings=()))
    monkeypatch.setattr(looks, 'look', look)
    monkeypatch.setattr(looks, 'MOST', 24)
    many = tuple(replace(evidence, name=f'push_{i}') for i in range(17))
    ((looked, notes), *_) = look_at((many, (), ()))
    assert [(one.name, one.limit) for one in looked] == [('push_0', 12), ('push_16', 12)]
    assert notes == ('Of 17 recordings 2, evenly chosen, were compared with the model.',)
