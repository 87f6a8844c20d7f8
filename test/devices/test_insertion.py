"""Insertion by hand: strokes that end where they should, at the speeds of clinical hands."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.devices.insertion import HandMotion, InsertionProfile
from arm_brachy.devices.motion_profile import Motion

HAND = InsertionProfile('hand')
# As measured in the clinic: 48 mm/s on average, the mean of the maxima 123 mm/s.
CLINICAL = replace(HAND, speed=0.123, pause=0.08)


def motion(profile, depth, seed, start=0.0):
    return HandMotion(Motion(start, 0.0), depth, profile.speed, profile,
                      np.random.default_rng(seed))


def travel(moving, step):
    places = []
    while not moving.done:
        moving.advance(step)
        places.append(moving.motion)
    return np.array([m.position for m in places]), np.array([m.velocity for m in places])


@pytest.mark.parametrize(('start', 'end'), [(0.0, 0.08), (0.08, 0.0), (0.03, 0.031)])
def test_it_arrives_and_its_speed_is_the_derivative_of_its_place(start, end):
    place, speed = travel(motion(HAND, end, 1, start), 5e-4)
    assert place[-1] == end and speed[-1] == 0.0
    assert np.allclose((place[2:] - place[:-2]) / 1e-3, speed[1:-1], atol=2e-4)
    low, high = sorted((start, end))
    assert low - 3 * HAND.tremor <= place.min() and place.max() <= high + 3 * HAND.tremor


def test_without_tremor_a_stroke_is_a_minimum_jerk_motion():
    still = replace(HAND, tremor=0.0, variation=0.0, stroke=0.02)
    place, speed = travel(motion(still, 0.02, 0), 1e-4)
    assert np.isclose(speed.max(), still.speed, rtol=1e-4)
    assert np.isclose(speed.mean(), still.speed * 8 / 15, rtol=1e-3)
    jerk = np.diff(place, 3) / 1e-12
    lasts = 15 / 8 * 0.02 / still.speed
    assert np.isclose(np.abs(jerk).max(), 60 * 0.02 / lasts**3, rtol=0.01)


def test_clinical_hands_have_the_published_mean_and_maxima():
    """4.8 cm/s on average, 12.3 cm/s in the mean of the maxima, pauses included."""
    means, peaks = [], []
    calm = replace(CLINICAL, tremor=0.0)
    for seed in range(40):
        place, speed = travel(motion(calm, 0.09, seed), 1e-3)
        means.append(0.09 / (1e-3 * len(place)))
        ends = np.flatnonzero((speed[1:-1] > speed[:-2]) & (speed[1:-1] >= speed[2:])) + 1
        peaks += list(speed[ends])
    assert np.isclose(np.mean(means), 0.048, rtol=0.15)
    assert np.isclose(np.mean(peaks), 0.123, rtol=0.05)


def test_how_time_is_cut_makes_no_difference_and_the_seed_makes_all():
    coarse, fine, other = motion(HAND, 0.05, 3), motion(HAND, 0.05, 3), motion(HAND, 0.05, 4)
    for _ in range(20):
        coarse.advance(0.125)
        other.advance(0.125)
        for _ in range(4):
            fine.advance(0.03125)
        assert coarse.motion == fine.motion
    assert coarse.motion != other.motion


def test_tremor_has_its_frequency_and_size_in_the_middle_of_a_stroke():
    slow = replace(HAND, stroke=0.08, variation=0.0, speed=0.02)
    shaking, _ = travel(motion(slow, 0.08, 5), 1e-3)
    still, _ = travel(motion(replace(slow, tremor=0.0), 0.08, 5), 1e-3)
    sway = shaking - still
    middle = sway[len(sway) // 4:3 * len(sway) // 4]
    power = np.abs(np.fft.rfft(sway))**2
    frequency = np.fft.rfftfreq(len(sway), 1e-3)
    assert power[(frequency > 7.5) & (frequency < 12.5)].sum() > 0.95 * power.sum()
    assert 0.5 * HAND.tremor < middle.std() < 1.5 * HAND.tremor
