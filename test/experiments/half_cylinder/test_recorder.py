"""What the sensors make of a half-cylinder, and its files read back by the project's import."""

import numpy as np
import pytest

from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.isolation.recordings import look
from arm_brachy.diagnosis.signals.loading import load_evidence
from arm_brachy.experiments.csv_files import write_recording
from arm_brachy.experiments.half_cylinder import protocol, recorder
from arm_brachy.experiments.half_cylinder.bodies import Beyond
from arm_brachy.experiments.half_cylinder.cases import BESIDE, CASES
from arm_brachy.experiments.half_cylinder.layout import MARKERS, MM
from arm_brachy.experiments.half_cylinder.recorder import FORMATS, Recorder, Setup, yielding
from arm_brachy.experiments.half_cylinder.scene import write_scene
from arm_brachy.recording.import_csv import import_csv

SETUPS = {case.name: case.setup for case in CASES}


@pytest.fixture(scope='module')
def recorded(rays):
    return lambda setup=None, name='made_up', **more: Recorder(
        rays, setup or Setup(), 3, name, **more).record()


@pytest.fixture(scope='module')
def plain(recorded):
    return recorded()


def clock_of(device):
    """What the recorder draws for a device of 'made_up' under seed 3."""
    return Recorder({}, Setup(), 3, 'made_up')._begun(device)[1:]


def test_encoders_show_the_pads(plain):
    encoders = plain['encoders']
    # jitter is told with the stamps: 4 um of noise and nothing else, five sd
    assert np.abs(encoders.values - protocol.travel(encoders.stamps)).max() < 5 * 4e-3 * MM


def test_stamps_are_as_late_as_the_clock(plain):
    """The misfit to springs of 200 N/m is least where the stamps are put right."""
    t, stamps = clock_of('forces')
    seen = np.linalg.norm(plain['forces'].values[:, 0], axis=-1)
    delays = np.arange(-0.02, 0.02, 5e-4)
    misfit = [np.nansum((seen - 200.0 * protocol.travel(stamps - d)[:, 0]) ** 2) for d in delays]
    assert delays[np.argmin(misfit)] == pytest.approx(np.mean(stamps - t), abs=1.5e-3)
    np.testing.assert_array_equal(stamps, plain['forces'].stamps)


def test_markers_are_glued_alike_in_all_recordings(recorded, plain):
    """Between recordings the frame differs, and gaps between markers only by noise."""
    other = recorded(name='another')
    places = []
    for streams in (plain, other):
        optical = streams['optical']
        still = np.nanmean(optical.values[optical.stamps < 4.5], axis=0)
        places.append(np.linalg.norm(still[:, None] - still, axis=-1))
    # 180 frames: white noise 3 um, the slow 12 um per axis, two markers
    assert np.abs(places[0] - places[1]).max() < 5 * 18e-3 * MM
    at = np.array([*MARKERS.values()])
    beside = places[0][:9, :9] - np.linalg.norm(at[:, None] - at, axis=-1)
    assert beside.std() > 0.08 * MM         # glued 0.1 mm per axis beside the scene


def test_one_marker_slips(recorded, plain):
    slip = SETUPS['slip_m4'].slip
    moved = recorded(Setup(slip=slip))['optical'].values - plain['optical'].values
    t, marker = clock_of('optical')[0], plain['optical'].names.index('m4')
    assert np.nanmax(np.abs(np.delete(moved, marker, axis=1))) < 1e-12     # the same noise
    assert np.nanmax(np.abs(moved[t < slip[1]])) < 1e-12
    # seen in a frame that is turned by some 7 mrad
    np.testing.assert_allclose(np.nanmean(moved[t >= slip[1], marker], axis=0), slip[2],
                               atol=0.01 * MM)


def test_one_force_zero_jumps_and_comes_back(recorded, plain):
    name, onset, size, tau = SETUPS['force_jump'].jump
    grown = recorded(Setup(jump=(name, onset, size, tau)))['forces'].values
    grown = grown - plain['forces'].values
    t = clock_of('forces')[0]
    wanted = np.where(t >= onset, np.exp(-np.maximum(t - onset, 0.0) / tau), 0.0)
    np.testing.assert_allclose(np.nan_to_num(grown[:, 2] - np.outer(wanted, size)), 0.0,
                               atol=1e-12)
    assert np.nanmax(np.abs(grown[:, :2])) < 1e-12


def test_a_pad_aside_takes_its_marker_along(recorded, plain):
    moved = recorded(Setup(aside=('right', 2.5 * MM)))['optical'].values - plain['optical'].values
    right = plain['optical'].names.index('right')
    np.testing.assert_allclose(np.nanmean(moved[:, right], axis=0), [2.5 * MM, 0.0, 0.0],
                               atol=0.03 * MM)
    assert np.nanmax(np.abs(np.delete(moved, right, axis=1))) < 1e-12


def test_memory_is_added_and_the_modulus_is_of_all_forces(recorded, plain):
    t = np.array([0.0, protocol.END + 1.0])
    beyond = Beyond(t, np.zeros((2, 11, 3)), np.full((2, 3, 3), 0.1))
    forces = recorded(Setup(modulus=1.2), beyond=beyond)['forces'].values
    t = clock_of('forces')[0]
    held = (t > 7.0) & (t < 10.0)           # left, 6 mm
    more = np.nanmean(forces[held, 0] - plain['forces'].values[held, 0], axis=0)
    pushed = np.nanmean(plain['forces'].values[held, 0], axis=0)
    np.testing.assert_allclose(more, 0.2 * pushed + 1.2 * 0.1, atol=0.02)     # zeros: 0.02 N


def test_what_yields_does_so_whatever_the_rate():
    """There and back, at one rate and at a third of it: as much behind at both ends."""
    most = sum(where * share for where, share in recorder.YIELDS)
    up = np.linspace(0.0, 2.0, 400)
    for force in (np.concatenate([up, up[::-1]]), np.repeat(np.concatenate([up, up[::-1]]), 3)):
        added = yielding(force, 0.36)
        half = len(force) // 2
        assert added[half - 1] == pytest.approx(0.36 * most)
        assert added[-1] == pytest.approx(-0.36 * most)
    small = np.linspace(0.0, 0.02, 10)      # before any yields: in proportion
    np.testing.assert_allclose(yielding(small, 0.36), 0.36 * small)
    assert not yielding(up, 0.0).any()


def test_a_seed_and_a_name_give_the_recording(recorded, plain):
    assert np.array_equal(recorded()['em'].values, plain['em'].values, equal_nan=True)
    assert not np.array_equal(recorded(name='b')['em'].values, plain['em'].values,
                              equal_nan=True)


SHORT = 36.0        # s: three pushes
SLIPPED = Setup(slip=('m4', 20.0, (0.42 * MM, 0.43 * MM, -0.36 * MM)))


@pytest.fixture(scope='module')
def seen(recorded, tmp_path_factory):
    """(streams, loading.Evidence) of a short recording in which m4 slips: files written,
    imported and read by the scene."""
    folder = tmp_path_factory.mktemp('seen')
    with pytest.MonkeyPatch.context() as short:
        short.setattr(recorder, 'END', SHORT)
        streams = recorded(SLIPPED)
    columns = write_recording(streams, folder / 'csv', 'made_up', FORMATS)
    write_scene(folder / 'scene.yaml')
    import_csv(columns, folder / 'bag')
    return streams, load_evidence((folder / 'bag',), load_scene(folder / 'scene.yaml'))[0]


def test_import_gives_the_signals_back(seen):
    """To the last digit of the files: 10 nm for encoders, 10 uN, half of it rounded."""
    streams, read = seen
    assert set(read.streams) == {'encoder', 'force', 'optical', 'em'}
    encoder = read.streams['encoder']
    assert encoder.values.reshape(len(encoder.t), -1) == pytest.approx(
        streams['encoders'].values, abs=0.06e-4 * MM)
    force, whole = read.streams['force'], ~np.isnan(streams['forces'].values).any(axis=(1, 2))
    assert whole.sum() == len(whole) - 12
    assert force.values[~np.isnan(force.values).any(axis=(1, 2))] == pytest.approx(
        streams['forces'].values[whole], abs=6e-6)
    # on the tool, against the push: 6 mm by 200 N/m
    held = (force.t > 7.0) & (force.t < 10.0)
    pushed = np.nanmean(force.values[held, 0], axis=0)
    assert np.linalg.norm(pushed) == pytest.approx(1.2, abs=0.06)


def test_the_slip_shows_without_a_model(seen):
    """And nothing else does, but for what is off in every recording."""
    found = {one.term: one for one in look(seen[1]).structure.findings}
    slip = found.pop('marker_slip')
    assert slip.channel == 'm4' and slip.onset[0] - 0.03 < 20.0 < slip.onset[1] + 0.03
    assert slip.value == pytest.approx(SLIPPED.slip[2], abs=0.05 * MM)
    assert set(found) <= set(BESIDE)
