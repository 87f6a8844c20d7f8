"""The sample that the tutorial starts from, and the files of it that the tutorial shows."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from arm_brachy.cli import main
from arm_brachy.core.scene import load_scene
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.scenario import load_cell

PAGE = Path(__file__).parents[1] / 'docs' / 'tutorials' / 'own_phantom.md'
PUSH = Path('monday') / 'push_1'


def sample(folder):
    return CliRunner().invoke(main, ['import', 'sample', '--out', str(folder)])


@pytest.fixture
def laboratory(tmp_path):
    answer = sample(tmp_path / 'lab')
    assert answer.exit_code == 0 and 'lab/monday/push_1/camera.csv' in answer.stdout
    return tmp_path / 'lab'


def test_the_tutorial_shows_the_files_of_the_sample(laboratory):
    shown = dict(re.findall(r'```yaml\n# (\S+)\n(.*?)```', PAGE.read_text(encoding='utf-8'),
                            re.DOTALL))
    assert set(shown) == {'phantom.yaml', 'columns.yaml', 'push_1.yaml'}
    for name, block in shown.items():
        assert (laboratory / name).read_text(encoding='utf-8') == f'# {name}\n{block}'


def test_the_sample_goes_into_no_folder_that_holds_something(laboratory):
    again = sample(laboratory)
    assert again.exit_code == 2 and again.stderr.count('\n') == 1
    assert 'is not empty; name another folder with --out' in again.stderr


def test_the_scene_of_the_tutorial_is_one(laboratory):
    scene = load_scene(laboratory / 'phantom.yaml')
    assert scene.pads[0].radius == 0.012 and scene.markers[5].body == 'east'
    (laboratory / 'phantom.msh').touch()       # `arm-brachy mesh` makes it
    assert load_cell(laboratory / 'push_1.yaml').scenario.name == 'push_1'


def test_its_column_map_imports_every_stream(laboratory):
    found = import_csv(laboratory / 'columns.yaml', laboratory / 'bag', folder=laboratory / PUSH)
    assert set(found['streams']) == {
        '/actuators/state', '/force/east/wrench', '/force/west/wrench', '/optical/markers',
        '/em/lump/pose', '/em/deep/pose'}
    assert found['streams']['/optical/markers']['missing_values'] > 0
    assert not [note for note in found['notes'] if 'apart' in note]


def test_it_does_for_a_recording_without_cells_and_tools(laboratory):
    for name in ('cells.csv', 'aurora.csv'):
        (laboratory / PUSH / name).unlink()
    found = import_csv(laboratory / 'columns.yaml', laboratory / 'bag', folder=laboratory / PUSH)
    assert found['absent'] == ['cells.csv', 'aurora.csv']
    assert set(found['streams']) == {'/actuators/state', '/optical/markers'}
