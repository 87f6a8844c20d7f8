"""Noisy encoders: their path is found again, nothing is blamed for their noise but faults are."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.diagnosis.isolation.recordings import look
from arm_brachy.diagnosis.signals.encoder_smoothing import steadied
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.motion import FINENESS, noise_of
from arm_brachy.diagnosis.signals.stream import ENCODER, REMAINS, Stream

T = np.arange(0.0, 60.0, 0.02)
LOUD = 1e-4         # m


def path():
    """(n,) [m] of a pad that goes, stands and comes back, 12 times, at two speeds."""
    corners, at = [0.0], [0.0]
    for k in range(12):
        ramp = 0.4 if k % 2 else 1.2
        for wait, go, depth in ((1.0, ramp, 6e-3), (1.6, ramp, 0.0)):
            corners += [corners[-1] + wait, corners[-1] + wait + go]
            at += [at[-1], depth]
    return np.interp(T, corners, at)


def stream(*readings):
    """The encoders' Stream of readings (n,) [m] at T."""
    names = tuple(f'pad_{k}' for k in range(len(readings)))
    values = np.stack(readings, axis=1)[..., None]
    return Stream(ENCODER, T, names, values, np.isfinite(values).all(axis=2), names,
                  np.zeros((len(names), 1)))


def loud(run, noise=LOUD):
    """A RunData whose encoders are read with white noise [m]."""
    encoder, rng = run.encoder, np.random.default_rng(7)
    return replace(run, encoder=replace(
        encoder, values=encoder.values + noise * rng.standard_normal(encoder.values.shape)))


@pytest.mark.parametrize('noise', [3e-5, 1e-4, 3e-4])
def test_the_path_is_known_better_than_its_readings(noise):
    true, notes, rng = path(), [], np.random.default_rng(2)
    found = steadied(stream(true + noise * rng.standard_normal(len(T))), notes)
    off = found.values[:, 0, 0] - true
    assert found.taken[0] == pytest.approx(noise, rel=0.1)
    assert np.sqrt(np.mean(off**2)) < REMAINS * noise
    stands = (true == 6e-3) & (np.gradient(true) == 0.0)
    assert np.sqrt(np.mean(off[stands]**2)) < REMAINS * noise
    assert len(notes) == 1 and 'pad_0' in notes[0] and 'noisy' in notes[0]


def test_a_pad_that_stands_is_said_to_stand():
    """By what `motion` calls still, 0.2 s from its moves."""
    true, rng = path(), np.random.default_rng(3)
    found = steadied(stream(true + LOUD * rng.standard_normal(len(T))), []).values[:, 0, 0]
    still = np.convolve(np.gradient(true) == 0.0, np.ones(21), 'same') == 21
    stands = [rows for rows in np.split(np.arange(len(T)), np.flatnonzero(np.diff(still)) + 1)
              if still[rows[0]]]
    flat = [np.ptp(found[rows]) < FINENESS * np.ptp(true) for rows in stands]
    assert len(flat) > 20 and np.mean(flat) >= 0.9


def test_quiet_encoders_and_coarse_counts_are_left_as_they_are():
    true, rng = path(), np.random.default_rng(4)
    for readings in (true, true + 5e-6 * rng.standard_normal(len(T)),
                     np.round(true / 5e-5) * 5e-5):
        notes, given = [], stream(readings)
        assert steadied(given, notes) is given and not notes
        assert np.all(given.path_error(1.0) == 0.0)


def test_a_pad_beside_a_noisy_one_keeps_its_readings():
    true, rng = path(), np.random.default_rng(5)
    found = steadied(stream(true, true + LOUD * rng.standard_normal(len(T))), [])
    assert np.array_equal(found.values[:, 0, 0], true) and found.taken[0] == 0.0


def test_noise_is_that_of_the_readings_whatever_the_motion():
    rng = np.random.default_rng(6)
    assert noise_of(path() + LOUD * rng.standard_normal(len(T))) == pytest.approx(LOUD, rel=0.05)


def test_a_smooth_motion_that_is_coarsely_sampled_is_no_noise():
    """A hertz at 6 mm, 20 readings a second."""
    t = np.arange(0.0, 60.0, 0.05)
    given = replace(stream(3e-3 * (1.0 - np.cos(2.0 * np.pi * t))), t=t)
    notes = []
    assert steadied(given, notes) is given and not notes


def test_a_mean_over_a_stand_is_known_by_its_samples():
    given = replace(stream(path()), taken=np.array([LOUD]))
    assert given.path_error(2.0)[0] == pytest.approx(0.1 * LOUD)
    assert given.path_error(0.0)[0] == pytest.approx(REMAINS * LOUD)


def test_no_cause_is_blamed_for_the_noise_of_encoders(recorded, laboratory):
    found = look(evidence_of(loud(recorded()), laboratory().scene))
    assert not found.structure.findings
    assert any('noisy' in note for note in found.prepared.evidence.notes)


def test_a_gain_is_found_by_noisy_encoders(recorded, laboratory):
    entry = {'name': 'actuator_gain', 'gain': 0.06, 'actuators': [0]}
    found = look(evidence_of(loud(recorded(entry)), laboratory().scene)).structure.findings
    gain, = (f for f in found if f.term == 'actuator_gain')
    assert gain.channel == 'pad_0'
    assert gain.value == pytest.approx(0.06, abs=0.02)
