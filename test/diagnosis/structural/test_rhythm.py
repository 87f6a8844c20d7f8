"""A sinusoid in white noise, against the least that its frequency can be known to."""

import numpy as np
import pytest

from arm_brachy.diagnosis.isolation.periodic import rhythm
from arm_brachy.diagnosis.statistics.noise_process import Colour

SPAN, PERIOD, SD, AMPLITUDE = 90.0, 0.1, 2e-5, 1.3e-4


def found(frequency, phase, rng, series=3):
    t = np.arange(0.0, SPAN, PERIOD)
    wave = AMPLITUDE * np.sin(2.0 * np.pi * frequency * t + phase)
    noise = SD * rng.normal(size=(len(t), series))
    return rhythm(t, wave[:, None] + noise, np.full(series, SD),
                  np.stack([np.ones(len(t)), t], axis=1), Colour())


@pytest.mark.parametrize('between', [0.0, 0.25, 0.5])
def test_a_frequency_between_those_tried_is_found_to_the_cramer_rao_bound(between):
    """Kay 1993, Estimation Theory, eq. 3.41: var f >= 12 / ((2 pi)^2 eta N^3), eta = A^2/2s^2."""
    rng, true = np.random.default_rng(3), (100.0 + between) / (4.0 * SPAN)
    off = [found(true, phase, rng).frequency - true for phase in rng.uniform(0.0, 6.0, 60)]
    n = 3 * SPAN / PERIOD       # three series tell the same
    least = np.sqrt(12.0 / (n * 0.5 * (AMPLITUDE / SD)**2)) / (2.0 * np.pi * SPAN)
    rms = np.sqrt(np.mean(np.square(off)))
    # 60 draws know their rms to 9 %
    assert 0.75 * least < rms < 1.3 * least


def test_the_phase_at_the_start_is_that_of_the_wave():
    one = found(0.2972, -2.0, np.random.default_rng(4))
    phase = np.arctan2(one.cosine, one.sine)
    assert np.allclose(phase, -2.0, atol=0.05)
    assert np.allclose(one.amplitude, AMPLITUDE, rtol=0.05)
