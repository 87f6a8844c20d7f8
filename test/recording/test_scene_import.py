"""Another laboratory's scene: geometry, sign and files arrive; what does not is reported."""

import gzip
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from arm_brachy.core.errors import ConfigError, RecordingError
from arm_brachy.core.scene import load_scene
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.recording.reader import BagReader
from arm_brachy.recording.scene_import import import_scene

THEIRS = {
    'units': {'length': 'm', 'force': 'N', 'time': 's', 'pressure': 'Pa'},
    'mesh': {'file': 'x.msh', 'npz': 'x.npz'},
    'material': {'model': 'neo_hookean', 'E': 8000.0, 'nu': 0.48, 'density': 1000.0,
                 'novelty': 3.0},
    'gravity': [0.0, 0.0, -9.81],
    'fixed': {'set': 'base_nodes'},
    'pads': [{'name': 'p', 'centre': [0.05, 0.0, 0.03], 'radius': 0.009,
              'direction': [-1.0, 0.0, 0.0], 'stroke_max': 0.009, 'node_set': 'pad_nodes_0'}],
    'markers': [{'id': 'm', 'reference': [0.0, 0.01, 0.05], 'body': 'tissue'},
                {'id': 'b', 'reference': [0.08, 0.01, 0.0], 'body': 'base'}],
    'em_targets': [{'id': 'e', 'reference': [0.0, 0.0, 0.02]}],
    'sensors': {'forces': {'sign': 'force the pad exerts on the tissue'}},
    'recordings': [{'name': 'A', 'folder': 'rec/A'}],
}


@pytest.fixture
def rig(tmp_path):
    def write(change=None):
        (tmp_path / 'lab').mkdir(exist_ok=True)
        theirs = YAML(typ='safe').load(_text(THEIRS))
        if change:
            change(theirs)
        (tmp_path / 'lab' / 'scene.yaml').write_text(_text(theirs))
        return tmp_path / 'lab' / 'scene.yaml'

    return write


def _text(data):
    stream = StringIO()
    YAML(typ='safe').dump(data, stream)
    return stream.getvalue()


def test_scene_in_our_terms(rig, tmp_path):
    report = import_scene(rig(), tmp_path / 'out')
    scene = load_scene(report['scene'])
    assert scene.name == 'lab'
    assert scene.mesh.file == str(tmp_path / 'lab' / 'x.npz')
    assert (scene.material.E, scene.material.nu) == (8000.0, 0.48)
    assert (scene.fixed.kind, scene.fixed.set) == ('set', 'base_nodes')
    (pad,) = scene.pads
    assert (pad.name, pad.set, pad.direction) == ('p', 'pad_nodes_0', (-1.0, 0.0, 0.0))
    assert (pad.radius, pad.stroke) == pytest.approx((0.009, 0.009))
    assert [m.body for m in scene.markers] == ['tissue', 'base']
    np.testing.assert_allclose(scene.targets[0].position, [0.0, 0.0, 0.02])
    np.testing.assert_allclose(scene.gravity, [0.0, 0.0, -9.81])
    assert set(report['unused']) == {'mesh.file', 'material.novelty'}


def test_column_map_takes_their_sign(rig, tmp_path):
    report = import_scene(rig(), tmp_path / 'out')
    assert 'sign: on_tissue' in open(report['maps']['A'], encoding='utf-8').read()


@pytest.mark.parametrize(('change', 'kept'), [
    (lambda d: d.pop('em_targets'), {'encoders', 'forces', 'optical'}),
    (lambda d: d.pop('markers'), {'encoders', 'forces', 'em'}),
    (lambda d: d.pop('sensors'), {'encoders', 'optical', 'em'}),
    (lambda d: None, {'encoders', 'forces', 'optical', 'em'})])
def test_streams_that_were_not_recorded(rig, tmp_path, change, kept):
    """Nothing says how to read them; files that lie there all the same are listed as unused."""
    files = tmp_path / 'lab' / 'rec' / 'A'
    files.mkdir(parents=True)
    for kind in ('encoders', 'forces', 'optical', 'em'):
        (files / f'{kind}.csv.gz').touch()
    report = import_scene(rig(change), tmp_path / 'out')
    with open(report['maps']['A'], encoding='utf-8') as stream:
        columns = YAML(typ='safe').load(stream)
    sections = {kind: columns.get(kind) for kind in ('encoders', 'forces', 'optical', 'em')}
    assert {kind for kind, said in sections.items() if said} == kept
    assert {kind for kind in sections if f'rec/A/{kind}.csv.gz' in report['unused']} == (
        set(sections) - kept)
    assert {kind for kind in kept if sections[kind][0]['csv']['optional']} == kept - {'encoders'}


def test_a_pad_without_a_load_cell_is_left_out_of_the_forces(rig, tmp_path):
    """One that has a part of its columns is not, nor is any where no name is known."""
    def three(theirs):
        theirs['pads'] = [{**theirs['pads'][0], 'name': name} for name in 'pqr']

    files = tmp_path / 'lab' / 'rec' / 'A'
    files.mkdir(parents=True)
    for kind, header in (('encoders', 't_s,q0_m,q1_m,q2_m'), ('forces', 't_s,f0x_N,f2x_N,f2y_N'),
                         ('optical', 't_s,m_x_m,m_y_m,m_z_m'), ('em', 't_s,other_x_m')):
        with gzip.open(files / f'{kind}.csv.gz', 'wt') as stream:
            stream.write(f'{header}\n')
    report = import_scene(rig(three), tmp_path / 'out')
    with open(report['maps']['A'], encoding='utf-8') as stream:
        columns = YAML(typ='safe').load(stream)
    assert columns['forces'][0]['names'] == {'p': '0', 'r': '2'}
    assert list(columns['encoders'][0]['names']) == ['p', 'q', 'r']
    assert list(columns['optical'][0]['names']) == ['m']
    assert list(columns['em'][0]['names']) == ['e']
    assert report['absent'] == ['rec/A/forces.csv.gz: q', 'rec/A/optical.csv.gz: b']


@pytest.mark.parametrize(('change', 'words'), [
    (lambda d: d['units'].update(length='mm'), 'units.length'),
    (lambda d: d['material'].update(model='ogden'), 'material.model'),
    (lambda d: d['material'].update(E='soft'), r'scene.yaml:\d+: material'),
    (lambda d: d['sensors']['forces'].update(sign='outwards'), 'sensors.forces.sign'),
    (lambda d: d.pop('fixed'), "'fixed' is missing"),
    (lambda d: d['pads'][0].pop('centre'), 'centre'),
])
def test_what_cannot_be_converted_is_refused(rig, tmp_path, change, words):
    with pytest.raises(ConfigError, match=words) as caught:
        import_scene(rig(change), tmp_path / 'out')
    assert '\n' not in str(caught.value)


def test_dome_rig(recordings, tmp_path):
    report = import_scene(recordings / 'dome_rig' / 'scene.yaml', tmp_path / 'out')
    scene = load_scene(report['scene'])
    assert scene.name == 'dome_rig'
    assert (len(scene.pads), len(scene.markers), len(scene.targets)) == (4, 23, 2)
    for pad in scene.pads:
        assert np.linalg.norm(pad.direction) == pytest.approx(1.0, abs=1e-6)
    with np.load(scene.mesh.file) as mesh:
        for name in (scene.fixed.set, *(p.set for p in scene.pads)):
            assert len(mesh[name]) > 3
        near = mesh['nodes'][mesh[scene.pads[0].set]].mean(axis=0)
    assert np.linalg.norm(near - scene.pads[0].centre) < scene.pads[0].radius
    messages = import_csv(report['maps']['C'], tmp_path / 'bag')['messages']
    assert messages['/optical/markers'] == 2338


def sound_files(folder):
    folder.mkdir(parents=True)
    for kind, header in {'encoders': 't_s,q0_m', 'optical': 't_s,' + ','.join(
            f'{m}_{a}_m' for m in 'mb' for a in 'xyz')}.items():
        width = header.count(',')
        with gzip.open(folder / f'{kind}.csv.gz', 'wt') as stream:
            stream.write('\n'.join([header, *(f'{0.01 * i:.2f}' + ',0.1' * width
                                              for i in range(5))]) + '\n')


def test_recordings_that_begin_before_zero_are_shifted_alike(rig, tmp_path):
    def two(theirs):
        theirs['recordings'] = [{'name': 'A', 'folder': 'rec/A', 'lab_time_start_s': 20.0},
                                {'name': 'null', 'folder': 'rec/null', 'lab_time_start_s': -75.0}]
    sound_files(tmp_path / 'lab/rec/A')
    sound_files(tmp_path / 'lab/rec/null')
    report = import_scene(rig(two), tmp_path / 'out')
    assert report['shift_s'] == 75.0
    spans = []
    for name, file in report['maps'].items():
        import_csv(file, tmp_path / f'bag_{name}')
        with BagReader(tmp_path / f'bag_{name}') as bag:
            spans.append(bag.span_ns[0] * 1e-9)
    assert spans == [95.0, 0.0]


def test_maps_work_from_another_place_with_a_folder(rig, tmp_path):
    """Named may be that of the rig, or that of the recording itself."""
    sound_files(tmp_path / 'lab/rec/A')
    column_map, = import_scene(rig(), tmp_path / 'out')['maps'].values()
    (tmp_path / 'elsewhere/deep').mkdir(parents=True)
    moved = tmp_path / 'elsewhere/deep/map.yaml'
    moved.write_text(Path(column_map).read_text())
    for i, folder in enumerate((tmp_path / 'lab', tmp_path / 'lab/rec/A')):
        for j, file in enumerate((moved, column_map)):
            found = import_csv(file, tmp_path / f'bag{i}{j}', folder=folder)
            assert set(found['streams']) == {'/actuators/state', '/optical/markers'}
    with pytest.raises(RecordingError, match='no such file, which .* names; if it was moved'):
        import_csv(moved, tmp_path / 'none')
