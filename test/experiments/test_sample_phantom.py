"""The recording of the sample is of its scene; its eastern pad has the fault that pages name."""

import shutil

import numpy as np
import pytest

from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.bags import diagnose_bags
from arm_brachy.experiments import sample_phantom
from arm_brachy.experiments.sample_phantom import FAULT, RECORDING, SAMPLE, SURFACE
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.tissue.mesh_command import mesh_command
from arm_brachy.tissue.surface import read_surface


def table(name):
    """Column name -> values of a file of the shipped recording, NaN where nothing was measured."""
    rows = np.genfromtxt(SAMPLE / RECORDING / name, delimiter=',', names=True, deletechars='')
    return {key: np.where(rows[key] == -9999, np.nan, rows[key]) for key in rows.dtype.names}


def test_its_motors_go_as_the_script_says():
    motors, path = table('motors.csv'), sample_phantom.travel()
    q = 1e3 * path.at(1e-3 * motors['t_ms'])
    np.testing.assert_allclose(motors['E_pos_mm'], q[:, 0], atol=0.02)
    np.testing.assert_allclose(motors['W_pos_mm'], q[:, 1], atol=0.02)


@pytest.mark.parametrize(('marker', 'column', 'gain'), [
    ('on_east', 0, FAULT['gain']), ('on_west', 1, 0.0)])
def test_one_pad_goes_less_far_than_its_motor(marker, column, gain):
    camera, path = table('camera.csv'), sample_phantom.travel()
    q = 1e3 * path.at(camera['time'])
    deep = q[:, column] > 4.9
    went = np.abs(camera[f'{marker}.X'] - np.median(camera[f'{marker}.X'][:30]))
    assert np.median(went[deep] / q[deep, column]) == pytest.approx(1.0 + gain, abs=0.005)


def test_its_markers_rest_where_the_scene_has_them_and_its_surface_is_closed():
    camera = table('camera.csv')
    for marker in load_scene(SAMPLE / 'phantom.yaml').markers:
        rest = [np.nanmedian(camera[f'{marker.name}.{axis}'][:30]) for axis in 'XYZ']
        np.testing.assert_allclose(rest, 1e3 * np.array(marker.position), atol=0.06)
    surface, repairs = read_surface(SAMPLE / SURFACE, unit='mm')
    assert not repairs and np.ptp(surface.vertices, axis=0) == pytest.approx(
        [0.106, 0.106, 0.06], abs=1e-3)


@pytest.mark.validate
def test_the_diagnosis_of_the_sample_names_its_fault(tmp_path):
    """On a mesh of its own, as the tutorial makes it."""
    lab = shutil.copytree(SAMPLE, tmp_path / 'lab')
    pads = load_scene(lab / 'phantom.yaml').pads
    mesh_command(lab / SURFACE, lab / 'phantom.msh', edge_length_mm=12.0, patches=pads)
    import_csv(lab / 'columns.yaml', lab / 'bag', folder=lab / RECORDING)
    found = diagnose_bags([lab / 'bag'], lab / 'phantom.yaml').diagnosis
    cause, = found.causes
    assert (found.verdict, cause.term, cause.applies_to) == (
        'named', FAULT['name'], {'actuators': (0,)})
    gain = cause.parameters['gain']
    assert gain.low < FAULT['gain'] < gain.high and gain.high < -0.03
