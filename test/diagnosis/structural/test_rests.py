"""Rests without a push, and how much they differ beyond what the noise says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from arm_brachy.core.random import stream as draws
from arm_brachy.devices.optical_tracker import OpticalParams
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.noise import Noise, noise_of
from arm_brachy.diagnosis.signals.rests import MOST_EXCESS, excess, rest_spans
from arm_brachy.diagnosis.signals.shared_noise import shared_noise
from arm_brachy.diagnosis.signals.stream import FORCE, Stream
from arm_brachy.diagnosis.statistics.noise_process import Colour

PERIOD, SD, SHARE, TIME = 0.01, 0.03, 0.36, 1.2
RESTS = tuple((1.5 * i, 1.5 * i + 0.4) for i in range(40))     # 1.1 s of pushes between them


@pytest.fixture
def forces():
    """Four pads' forces at rest and pushed, with white noise and noise that remembers."""
    rng, n, a = draws(3, 'rests'), 6000, np.exp(-PERIOD / TIME)
    slow = lfilter([np.sqrt(1.0 - a**2)], [1.0, -a], rng.standard_normal((n, 12)), axis=0)
    noise = SD * (np.sqrt(SHARE) * slow + np.sqrt(1.0 - SHARE) * rng.standard_normal((n, 12)))
    t = PERIOD * np.arange(n)
    pushed = np.all([(t < a) | (t >= b) for a, b in RESTS], axis=0)
    return Stream(FORCE, t, tuple('abcd'), (noise + pushed[:, None]).reshape(n, 4, 3),
                  np.ones((n, 4), dtype=bool), tuple('abcd'), np.zeros((4, 3)))


@pytest.mark.parametrize('colour, variance', [(Colour(SHARE, TIME), 1.0),
                                              (Colour(0.2, 0.3), 1.6)])
def test_rests_differ_by_what_the_noise_says(forces, colour, variance):
    """Means over 0.4 s of white noise and of Markov noise of time T: its formula for either."""
    noise = Noise(np.full((4, 3), SD), colour, PERIOD, np.eye(3), 'idle')
    count = np.full(1, 40)
    asked, true = (c.mean_variance(count, PERIOD)[0] - c.correlation(1.5)
                   for c in (colour, Colour(SHARE, TIME)))
    assert true / asked == pytest.approx(variance, abs=0.3)
    assert excess(forces, noise, RESTS) == pytest.approx(max(true / asked, 1.0), rel=0.25)


def test_a_jump_is_no_noise_and_what_is_no_noise_has_an_end(forces):
    """One step of 39 jumps: the median of squares moves by 2.6 % of their ranks, 12 % at most."""
    noise = Noise(np.full((4, 3), SD), Colour(SHARE, TIME), PERIOD, np.eye(3), 'idle')
    jump = forces.values + (forces.t > 20.0)[:, None, None]
    wild = forces.values + np.sin(forces.t)[:, None, None]

    def seen(values):
        return excess(Stream(FORCE, forces.t, forces.names, values, forces.valid, forces.bodies,
                             forces.rest), noise, RESTS)
    assert seen(jump) == pytest.approx(excess(forces, noise, RESTS), rel=0.15)
    assert seen(wild) == MOST_EXCESS


@pytest.mark.parametrize('before', [1.0, 6.0])
def test_rests_are_where_no_pad_pushes(laboratory, pushes, before):
    lab = laboratory((), 8)
    run = lab.record(pushes(pads=(0, 1, 0, 1), speeds=(0.02,)), rest=before)
    spans = rest_spans(evidence_of(run, lab.scene))
    assert len(spans) > 3 and spans[0][1] == pytest.approx(before, abs=0.1)
    pad = run.encoder
    for start, end in spans:
        inside = (pad.t > start) & (pad.t < end)
        assert np.abs(pad.values[inside]).max() < 1e-4


def test_slow_noise_shows_between_rests_however_long_the_first_is(laboratory, pushes):
    """A seventh of the variance with a memory of 8 s: six seconds show half of it."""
    lab = laboratory((), 4)
    evidence = evidence_of(lab.record(pushes(pads=(0, 1) * 3, speeds=(0.02,)), rest=6.0),
                           lab.scene)
    optical, plain = evidence.streams['optical'], noise_of(evidence)['optical']
    kept, rng = np.exp(-optical.period / 8.0), draws(0, 'rests')
    kicks = rng.standard_normal(optical.values.shape)
    kicks[1:] *= np.sqrt(1.0 - kept**2)
    slow = 0.4 * plain.sd * lfilter([1.0], [1.0, -kept], kicks, axis=0)
    louder = replace(evidence, streams={**evidence.streams, 'optical': replace(
        optical, values=optical.values + slow)})
    colour = noise_of(louder)['optical'].colour
    assert plain.colour.share < 0.01
    assert colour.share == pytest.approx(0.16 / 1.16, abs=0.045) and 4.0 < colour.time < 12.0


def test_a_short_recording_has_the_colour_of_a_long_one_and_its_own_loudness(laboratory, pushes):
    """Markov noise of 0.1 s; the second tracker is twice as loud and rests too short to tell."""
    short, long = (evidence_of(lab.record(pushes(pads=(0,), speeds=(0.02,)), rest=rest), lab.scene)
                   for lab, rest in ((laboratory((), seed, optical=OpticalParams(
                       noise=loud, noise_correlation=0.1)), rest)
                       for seed, loud, rest in ((1, 3e-4, 0.5), (2, 1.5e-4, 6.0))))
    first, second = (noise['optical'] for noise in shared_noise((short, long)))
    alone = noise_of(long)['optical']
    assert first.colour == second.colour == alone.colour
    assert first.sd.mean() == pytest.approx(2.0 * second.sd.mean(), rel=0.15)
    assert np.all(shared_noise((long,))[0]['optical'].sd == alone.sd)
