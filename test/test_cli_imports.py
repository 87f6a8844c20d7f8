"""`arm-brachy import`, as it is typed: presets, scenes, pictures, errors of one line."""

import numpy as np
import pytest
from click.testing import CliRunner

from arm_brachy.cli import main
from arm_brachy.recording.csv_presets import PRESETS

LINES = ['Frame\tTime\tm1 X\tm1 Y\tm1 Z\t', *(
    f'{i + 1}\t{0.01 * i:.2f}\t{10 + 0.01 * i:.3f}\t2\t3' for i in range(100))]
SCENE = """\
name: rig
mesh: {file: none.msh}
fixed: {kind: half_space}
pads:
- {name: east, centre_mm: [40, 0, 20], direction: [-1, 0, 0], radius_mm: 8, stroke_mm: 12}
- {name: west, centre_mm: [-40, 0, 20], direction: [1, 0, 0], radius_mm: 8, stroke_mm: 12}
markers:
- {name: on_east, position_mm: [48, 0, 26], body: east}
- {name: on_west, position_mm: [-48, 0, 26], body: west}
- {name: floor_1, position_mm: [60, 45, 0], body: base}
- {name: floor_2, position_mm: [-60, 45, 0], body: base}
- {name: floor_3, position_mm: [0, -50, 0], body: base}
"""
MAP = """\
name: rig
encoders: [{csv: {path: q.csv, time: t}, columns: '{key}', unit: mm, names: {east: e, west: w}}]
optical: [{csv: {path: p.csv, time: t}, columns: '{key}_{axis}', unit: mm}]
"""


def run(*args):
    return CliRunner().invoke(main, [str(a) for a in args])


@pytest.fixture
def export(tmp_path):
    (tmp_path / 'qtm.tsv').write_text('\n'.join(LINES) + '\n')
    return tmp_path / 'qtm.tsv'


@pytest.fixture
def rig(tmp_path):
    """Two pads pushed one after the other, a marker on each, three on the base."""
    t = np.arange(1000) * 0.01
    q = np.stack([np.interp(t, [1, 2, 7, 8], [0, 6, 6, 0]),
                  np.interp(t, [3, 4, 5, 6], [0, 5, 5, 0])], axis=1)
    places = np.array([[48, 0, 26], [-48, 0, 26], [60, 45, 0], [-60, 45, 0], [0, -50, 0]])
    points = np.repeat(places[None].astype(float), len(t), axis=0)
    points[:, 0, 0] -= q[:, 0]
    points[:, 1, 0] += q[:, 1]
    points += np.random.default_rng(0).normal(0.0, 0.02, points.shape)
    names = ['on_east', 'on_west', 'floor_1', 'floor_2', 'floor_3']
    np.savetxt(tmp_path / 'q.csv', np.column_stack([t, q]), '%.5f', ',', header='t,e,w',
               comments='')
    np.savetxt(tmp_path / 'p.csv', np.column_stack([t, points.reshape(len(t), -1)]), '%.5f', ',',
               header=','.join(['t', *(f'{n}_{a}' for n in names for a in 'xyz')]), comments='')
    (tmp_path / 'scene.yaml').write_text(SCENE)
    (tmp_path / 'none.msh').touch()
    (tmp_path / 'map.yaml').write_text(MAP)
    return tmp_path


def test_a_preset_imports_prints_its_map_and_the_map_imports_the_same(export, tmp_path):
    answer = run('import', 'csv', '--preset', 'qualisys', export, '--out', tmp_path / 'one',
                 '--map', tmp_path / 'map.yaml')
    assert answer.exit_code == 0 and 'rate_Hz          100' in answer.stdout
    printed = run('import', 'csv', '--preset', 'qualisys', export)
    assert printed.stdout == (tmp_path / 'map.yaml').read_text()
    assert run('import', 'csv', tmp_path / 'map.yaml', '--out', tmp_path / 'two').exit_code == 0
    hashes = run('hashes', tmp_path / 'one', tmp_path / 'two')
    assert hashes.exit_code == 0 and 'DIFFER' not in hashes.stdout


def test_presets_are_named_by_help_and_by_the_error(export):
    text = ' '.join(run('import', 'csv', '--help').stdout.split())
    error = run('import', 'csv', '--preset', 'vicon', export).stderr
    assert all(name in text and name in error for name in PRESETS)
    assert error.count('\n') == 1
    answer = run('import', 'csv', export, export, '--out', 'x')
    assert answer.exit_code == 2 and 'are for --preset' in answer.stderr
    assert "Missing option '--out'" in run('import', 'csv', export).stderr


@pytest.mark.parametrize('old, new, words', [
    ('{east: e, west: w}', '{east: w, west: e}', 'two pads are exchanged'),
    ('on_east', 'on_east', ''),
    ('unit: mm, names', 'unit: cm, names', 'go a tenth as far')])
def test_what_a_diagnosis_would_refuse_is_refused_with_the_scene_at_hand(rig, old, new, words):
    (rig / 'map.yaml').write_text(MAP.replace(old, new))
    answer = run('import', 'csv', rig / 'map.yaml', '--out', rig / 'bag', '--scene',
                 rig / 'scene.yaml', '--picture', rig / 'picture.png')
    assert answer.exit_code == (2 if words else 0) and words in answer.stderr
    assert (rig / 'bag').exists() == (rig / 'picture.png').exists() == (not words)


def test_evaluate_draws_an_import(rig):
    assert run('import', 'csv', rig / 'map.yaml', '--out', rig / 'bag').exit_code == 0
    answer = run('evaluate', rig / 'bag', '--out', rig / 'page')
    assert answer.exit_code == 0 and 'Optical markers' in answer.stdout
    assert 'data:image/svg+xml' in (rig / 'page/report_streams.html').read_text()
