"""What the sensors make of a block, and its files read back by the project's import."""

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.signals.loading import load_evidence
from arm_brachy.experiments.csv_files import write_recording
from arm_brachy.experiments.gel_block import protocol, recorder
from arm_brachy.experiments.gel_block.layout import MM, PADS
from arm_brachy.experiments.gel_block.recorder import FORMATS, Recorder, Setup, lateness
from arm_brachy.experiments.gel_block.scene import write_scene
from arm_brachy.recording.import_csv import import_csv


@pytest.fixture(scope='module')
def recorded(rays):
    return lambda **setup: Recorder(rays, Setup(**setup), 3, 'made_up').record()


def test_devices_keep_their_rates_and_noise(recorded):
    streams = recorded()
    for device, of in recorder.DEVICES.items():
        steps = np.diff(streams[device].stamps)
        assert steps.mean() == pytest.approx(1.0 / of.rate, rel=1e-3)
        # two independent instants: sqrt(2) of the jitter; 1400 steps tell it to 2 %
        assert steps.std() == pytest.approx(np.sqrt(2.0) * of.jitter, rel=0.1)
        still = streams[device].stamps < 3.9
        spread = np.nanstd(streams[device].values[still], axis=0)
        assert np.sqrt(np.mean(spread ** 2)) == pytest.approx(of.noise, rel=0.1)


def test_encoders_show_the_motors_and_marker_on_the_pad_the_gain(recorded):
    streams = recorded(gain=(1.0, 0.92))
    encoders, optical = streams['encoders'], streams['optical']
    # jitter is in the instants, and told: 3 um of noise and nothing else, five sd
    assert np.abs(encoders.values - protocol.motors(encoders.stamps)).max() < 5 * 3e-3 * MM
    t = optical.stamps - lateness(Setup(), 3, 'made_up')['optical']
    seen = optical.values[:, optical.names.index('on_pad_b')]
    travel = -(seen[:, 1] - np.nanmean(seen[t < 3.9, 1]))
    there = np.isfinite(travel) & (protocol.motors(t)[:, 1] > 1 * MM)
    slope = np.sum(travel[there] * protocol.motors(t[there])[:, 1]) / np.sum(
        protocol.motors(t[there])[:, 1] ** 2)
    assert slope == pytest.approx(0.92, abs=0.01)       # the frame's turn is 0.14 %


def test_late_stamps_are_late(rays):
    """The correlation with the travel is best where the stamps are put right."""
    setup = Setup(late={'forces': 0.06})
    forces = Recorder(rays, setup, 3, 'made_up').record()['forces']
    pushed = forces.values[:, 0, 0] - forces.values[forces.stamps < 3.9, 0, 0].mean()
    delays = np.arange(0.0, 0.12, 1e-3)
    misfit = [np.sum((pushed - 500.0 * protocol.motors(forces.stamps - d)[:, 0]) ** 2)
              for d in delays]
    told = lateness(setup, 3, 'made_up')['forces']
    assert abs(told - 0.06) == pytest.approx(recorder.CLOCK)
    assert delays[np.argmin(misfit)] == pytest.approx(told, abs=2e-3)


def test_one_marker_slips_one_force_drifts(recorded):
    plain = recorded()
    slipped = recorded(slip=('m07', 32.5, (1e-3, 0.0, 0.0)))['optical']
    moved = slipped.values - plain['optical'].values
    after, marker = slipped.stamps > 32.6, slipped.names.index('m07')
    assert np.nanmax(np.abs(np.delete(moved, marker, axis=1))) < 1e-12     # the same noise
    assert np.nanmax(np.abs(moved[slipped.stamps < 32.4])) < 1e-12
    # seen in a frame that is turned by 1.4 mrad
    np.testing.assert_allclose(np.nanmean(moved[after, marker], axis=0), [1e-3, 0, 0], atol=2e-6)
    drifted = recorded(drift={'pad_b': (0.0, 0.01, 0.0)})['forces']
    grown = drifted.values - plain['forces'].values
    t = drifted.stamps - lateness(Setup(), 3, 'made_up')['forces']
    np.testing.assert_allclose(grown[:, 1, 1], 0.01 * t, atol=1e-9)
    assert np.abs(grown[:, 0]).max() < 1e-12


def test_memory_relaxes_in_a_hold(rays):
    """At the end of a ramp of duration T: e (1 - g + g tau / T (1 - exp(-T / tau))); then the
    overstress goes with exp(-t / tau). The corner lies within a step of 2 ms, which rounds it."""
    g, tau = 0.2, 3.0
    made = Recorder(rays, Setup(memory=(g, tau)), 3, 'made_up')
    push, knots = protocol.TIMED[0]
    peak, ramp, hold = 500.0 * push.travel[0], knots[1] - knots[0], knots[2] - knots[1]
    over = g * tau / ramp * (1.0 - np.exp(-ramp / tau))
    force = made._remembered(np.array([knots[1], knots[2]]))[:, 0, 0]
    wanted = peak * (1.0 - g + over * np.array([1.0, np.exp(-hold / tau)]))
    assert force == pytest.approx(wanted, abs=recorder.FINE_STEP * peak / ramp)


def test_a_seed_and_a_name_give_the_recording(rays):
    def of(seed, name):
        return Recorder(rays, Setup(), seed, name).record()['em'].values

    assert np.array_equal(of(3, 'a'), of(3, 'a'), equal_nan=True)
    assert not np.array_equal(of(3, 'a'), of(3, 'b'), equal_nan=True)
    assert not np.array_equal(of(3, 'a'), of(4, 'a'), equal_nan=True)


def test_pads_that_leave_the_rays_are_refused(recorded):
    with pytest.raises(InputError, match='no ray goes to pad_a 9 mm, pad_b 4 mm'):
        recorded(gain=(1.0, 0.5))


@pytest.fixture(scope='module')
def evidence(recorded, tmp_path_factory):
    """Files written, imported, and read as the diagnosis reads them: rich and poor."""
    out = {}
    for name, poor in (('rich', False), ('poor', True)):
        folder = tmp_path_factory.mktemp(name)
        streams = recorded(poor=poor, modulus=1.2)
        columns = write_recording(streams, folder / 'csv', name, FORMATS)
        write_scene(folder / 'scene.yaml', poor=poor)
        import_csv(columns, folder / 'bag')
        scene = load_scene(folder / 'scene.yaml')
        out[name] = streams, load_evidence((folder / 'bag',), scene)[0]
    return out


def test_import_gives_the_signals_back(evidence):
    """To the last digit of the files: 1 um for positions, 0.1 mN, half of it rounded."""
    streams, read = evidence['rich']
    assert set(read.streams) == {'encoder', 'force', 'optical', 'em'}
    encoder = read.streams['encoder']
    assert encoder.values.reshape(len(encoder.t), -1) == pytest.approx(
        streams['encoders'].values, abs=0.06e-3 * MM)
    force = read.streams['force']
    gap = abs(len(force.t) - len(streams['forces'].stamps))
    assert gap == 0 and force.values == pytest.approx(streams['forces'].values, abs=6e-5)
    # pushed out, against the push, and stiffer than the made-up block by the modulus
    held = (force.t > 7.5) & (force.t < 9.2)
    assert force.values[held, 0, 0].mean() == pytest.approx(1.2 * 500.0 * 10 * MM, abs=0.05)


def test_the_poor_recording_has_encoders_and_markers_alone(evidence):
    streams, read = evidence['poor']
    assert set(streams) == {'encoders', 'optical'} and set(read.streams) == {'encoder', 'optical'}
    assert not any(name.startswith('on_') for name in streams['optical'].names)
    assert {pad.name for pad in read.scene.pads} == {pad.name for pad in PADS}
