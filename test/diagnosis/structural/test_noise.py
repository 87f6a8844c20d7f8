"""Noise from idle stretches against what the devices were told to add."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.random import stream
from arm_brachy.devices.em_tracker import EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensorParams
from arm_brachy.devices.optical_tracker import OpticalParams
from arm_brachy.diagnosis.signals.loading import evidence_of
from arm_brachy.diagnosis.signals.noise import Noise, data_sheet_sd, noise_of
from arm_brachy.diagnosis.signals.quantisation import quantum
from arm_brachy.diagnosis.statistics.noise_process import Colour


@pytest.fixture(scope='module')
def coloured(laboratory, pushes):
    lab = laboratory((), 5, optical=OpticalParams(noise=1.5e-4, noise_correlation=0.1),
                     em=EmTrackerParams(position_noise=3e-4),
                     force=ForceSensorParams(noise=0.05, noise_correlation=0.2))
    return evidence_of(lab.record(pushes(pads=(0, 1), speeds=(0.02,))), lab.scene)


def test_standard_deviations_are_those_of_the_devices(coloured):
    noise = noise_of(coloured)
    for kind, sd, rel in (('optical', 1.5e-4 / np.sqrt(3), 0.15), ('em', 3e-4 / np.sqrt(3), 0.05),
                          ('force', 0.05, 0.15)):   # the slower the noise, the less is known of it
        assert noise[kind].source == 'idle'
        assert noise[kind].sd.mean() == pytest.approx(sd, rel=rel)
        assert np.all(np.abs(noise[kind].sd / sd - 1.0) < 0.35)


def test_colour_is_that_of_the_devices(coloured):
    noise = noise_of(coloured)
    assert noise['optical'].colour.share > 0.9
    assert noise['optical'].colour.time == pytest.approx(0.1, rel=0.35)
    assert noise['force'].colour.time == pytest.approx(0.2, rel=0.5)
    assert noise['em'].colour.share < 0.15


def test_effective_number_of_samples(coloured):
    """Markov noise of 0.1 s at 100 Hz: 200 samples are worth (2 s / 2) / 0.1 s = 10, nearly."""
    assert noise_of(coloured)['optical'].effective(200) == pytest.approx(10.5, rel=0.35)


def test_relaxing_forces_are_no_noise(laboratory, pushes):
    """Half of the force relaxes in every hold; the noise stays that of the sensor."""
    lab = laboratory((), 6, relaxing=0.5)
    run = lab.record(pushes(pads=(0, 1), speeds=(0.02,), hold=1.0))
    noise = noise_of(evidence_of(run, lab.scene))['force']
    assert noise.sd.mean() == pytest.approx(ForceSensorParams().noise, rel=0.1)
    assert noise.colour.share < 0.1


def test_an_encoder_has_the_noise_of_its_counts(coloured):
    assert noise_of(coloured)['encoder'].sd.max() == pytest.approx(
        0.0122e-3 / np.sqrt(12.0), rel=1e-3)


def test_without_idle_the_data_sheet_is_asked(laboratory):
    """A pad that goes in at the first sample and never stands."""
    lab = laboratory((), 7)
    run = lab.record([(np.array([8e-3, 0, 0]), 0.004, 0.0)], rest=0.0)
    noise = noise_of(evidence_of(run, lab.scene), {'optical': OpticalParams(noise=6e-4)})
    assert noise['optical'].source == 'data sheet'
    assert np.all(noise['optical'].sd == 6e-4 / np.sqrt(3.0))
    assert 'Rest a second' in noise['optical'].notes[0]


def test_the_count_of_a_digitised_signal():
    rng = stream(1, 'axes')
    assert quantum(np.round(rng.standard_normal(5000), 2)) == pytest.approx(0.01)
    assert quantum(rng.standard_normal(5000)) == 0.0


@pytest.mark.parametrize('kind, sd', [('encoder', 0.0122e-3 / np.sqrt(12)), ('force', 0.025),
                                      ('em', 0.14e-3 / np.sqrt(3)),
                                      ('optical', 0.025e-3 / np.sqrt(3))])
def test_data_sheet_values_per_axis(kind, sd):
    assert data_sheet_sd(kind) == pytest.approx(sd)


def test_means_of_neighbouring_windows_are_correlated_as_their_noise_is(coloured):
    """Against the mean over the matrix of all pairs of samples."""
    noise = noise_of(coloured)['optical']
    n, apart = 20, 0.3
    t = np.concatenate([np.arange(n) * noise.period, apart + np.arange(n) * noise.period])
    C = np.eye(2 * n) * (1 - noise.colour.share) + noise.colour.share * np.exp(
        -np.abs(t[:, None] - t) / noise.colour.time)
    exact = C[:n, n:].mean() / C[:n, :n].mean()
    between = noise.between(np.array([0.0, apart]), np.array([n, n]))
    assert between[0, 0] == between[1, 1] == 1.0
    assert between[0, 1] == between[1, 0] == pytest.approx(exact, rel=0.35)


def test_the_noise_of_a_tracker_turns_with_its_frame():
    """Depth three times as bad, looked along x of the world: there it is bad."""
    rng = np.random.default_rng(5)
    turn = Rotation.from_euler('zyx', [20.0, 90.0, -35.0], degrees=True).as_matrix()
    sd = np.array([[0.1, 0.1, 0.3], [0.1, 0.2, 0.4]])
    axes = np.array([[1.0, 0.3, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 1.0]])
    turned = Noise(sd, Colour(), 0.01, axes, 'idle').turned(turn)
    for own, found in zip(sd, turned.sd, strict=True):
        drawn = rng.multivariate_normal(np.zeros(3), own[:, None] * axes * own, 100_000) @ turn.T
        assert found == pytest.approx(drawn.std(axis=0), rel=0.01)
    assert np.allclose(np.diag(turned.axes), 1.0)
