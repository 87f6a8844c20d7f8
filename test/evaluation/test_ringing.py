"""Frequency and damping of made-up decays."""

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.evaluation.ringing import ringing

T = np.arange(0.0, 2.0, 0.01)
OFFSET = np.array([1e-3, -2e-3, 30e-3])
WAY = np.array([0.6, 0.0, -0.8])


def decay(frequency, damping, amplitude=5e-3, phase=0.4):
    w = 2 * np.pi * frequency
    s = amplitude * np.exp(-damping * w * T) * np.cos(w * T + phase)
    return OFFSET + s[:, None] * WAY


@pytest.mark.parametrize(('frequency', 'damping'), [(7.7, 0.05), (4.3, 0.0), (12.0, 0.2)])
def test_clean_decay_is_recovered(frequency, damping):
    found = ringing(T + 3.0, decay(frequency, damping))
    assert found.frequency == pytest.approx(frequency, rel=1e-4)
    assert found.damping == pytest.approx(damping, abs=1e-4)
    assert found.amplitude == pytest.approx(5e-3, rel=1e-3)
    np.testing.assert_allclose(found.offset, OFFSET, atol=1e-6)
    assert found.explained == pytest.approx(1.0)


def test_noise_and_gaps_cost_little():
    x = decay(7.7, 0.05) + 5e-5 * stream(1, 'ringing').standard_normal((len(T), 3))
    x[40:55] = np.nan
    found = ringing(T, x)
    assert found.frequency == pytest.approx(7.7, rel=0.005)
    assert found.damping == pytest.approx(0.05, rel=0.05)


@pytest.mark.parametrize('x', [np.full((200, 3), np.nan), np.zeros((200, 3)), np.zeros((4, 3))])
def test_what_does_not_ring_has_no_frequency(x):
    assert np.isnan(ringing(T[:len(x)], x).frequency)
