"""The scene and the column map of the tutorial are taken as they stand there."""

import re
from pathlib import Path

import pytest

from arm_brachy.core.scene import load_scene
from arm_brachy.recording.import_csv import import_csv

PAGE = Path(__file__).parents[1] / 'docs' / 'tutorials' / 'own_phantom.md'
FILES = {'motors.csv': 't_ms,E_pos_mm,W_pos_mm\n0,0,0\n100,1,0\n',
         'cells.csv': 't_ms,E_load,W_load\n0,0,0\n10,2,0\n',
         'camera.csv': 'time,m1.X,m1.Y,m1.Z\n0,1,2,60\n0.02,-9999,-9999,-9999\n',
         'aurora.csv': 'time,lump_x,lump_y,lump_z\n0,5,3,28\n'}


@pytest.fixture
def laboratory(tmp_path):
    text = PAGE.read_text(encoding='utf-8')
    for name, block in re.findall(r'```yaml\n# (\S+)\n(.*?)```', text, re.DOTALL):
        (tmp_path / name).write_text(block)
    for name, table in FILES.items():
        (tmp_path / name).write_text(table)
    return tmp_path


def test_the_scene_of_the_tutorial_is_one(laboratory):
    scene = load_scene(laboratory / 'phantom.yaml')
    assert scene.pads[0].radius == 0.012 and scene.markers[1].body == 'east'


def test_its_column_map_imports_every_stream(laboratory):
    found = import_csv(laboratory / 'columns.yaml', laboratory / 'bag')
    assert set(found['streams']) == {
        '/actuators/state', '/force/east/wrench', '/force/west/wrench', '/optical/markers',
        '/em/lump/pose'}
    assert found['streams']['/optical/markers']['missing_values'] == 1


def test_it_does_for_a_recording_without_cells_and_tools(laboratory):
    for name in ('cells.csv', 'aurora.csv'):
        (laboratory / name).unlink()
    found = import_csv(laboratory / 'columns.yaml', laboratory / 'bag')
    assert found['absent'] == ['cells.csv', 'aurora.csv']
    assert set(found['streams']) == {'/actuators/state', '/optical/markers'}
