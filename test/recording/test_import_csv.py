"""CSV import on files made by hand, and on another laboratory's recording."""

import gzip

import numpy as np
import pytest
from ruamel.yaml import YAML

from arm_brachy.core.errors import ConfigError, RecordingError
from arm_brachy.core.paths import config_dir
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.recording.reader import BagReader

MAP = """\
name: test
start_s: 1.0
encoders:
  - csv: {path: enc.csv, time: t_ms, time_unit: ms, clock_offset_ms: -3.0}
    columns: 'q{key}_mm'
    unit: mm
    names: {left: '1', right: '0'}
    frame: rig
forces:
  - csv: {path: force.csv.gz, time: t}
    columns: 'f{key}{axis}'
    sign: on_tissue
    unit: mN
    axes: [X, Y, Z]
    names: {left: '1'}
optical:
  - csv: {path: opt.csv, time: t}
    columns: '{key}_{axis}_mm'
    unit: mm
em:
  - csv: {path: em.csv, time: t}
    columns: '{key}_{axis}'
    quaternion: '{key}_q{axis}'
    quality: '{key}_err'
"""


@pytest.fixture
def rig(tmp_path):
    (tmp_path / 'map.yaml').write_text(MAP)
    (tmp_path / 'enc.csv').write_text('t_ms,q0_mm,q1_mm\n0,0,10\n10,,11\n20,2,12\n')
    with gzip.open(tmp_path / 'force.csv.gz', 'wt') as stream:
        stream.write('t,f1X,f1Y,f1Z\n0,1000,0,-500\n0.01,nan,0,0\n')
    (tmp_path / 'opt.csv').write_text(
        't,m a_x_mm,m a_y_mm,m a_z_mm,b_x_mm,b_y_mm,b_z_mm\n'
        '0,1,2,3,4,5,6\n0.01,1,2,3,,,\n0.02,1,2,3,4,5,6\n0.04,1,2,3,4,5,6\n')
    (tmp_path / 'em.csv').write_text(
        't,s_x,s_y,s_z,s_qx,s_qy,s_qz,s_qw,s_err\n0,1,2,3,0,0,1,0,0.5\n0.025,,,,,,,,9.0\n')
    return tmp_path


def test_every_stream_arrives_in_si(rig):
    report = import_csv(rig / 'map.yaml', rig / 'bag', attachments={'scene.yaml': 'name: s\n'})
    assert report['messages'] == {
        '/actuators/state': 3, '/force/left/wrench': 1, '/optical/markers': 4, '/em/s/pose': 1,
        '/em/s/status': 2}
    bag = BagReader(rig / 'bag')
    encoders = [m for _, m in bag.messages(['/actuators/state'])]
    assert [m.name for m in encoders] == [['left', 'right'], ['left'], ['left', 'right']]
    np.testing.assert_allclose(encoders[2].position, [0.012, 0.002])
    assert encoders[0].header.frame_id == 'rig'
    t, _ = bag.series('/actuators/state', lambda m: 0.0, clock='stamp')
    np.testing.assert_allclose(t, [0.997, 1.007, 1.017], atol=1e-12)
    force = next(bag.messages(['/force/left/wrench']))[1].wrench
    assert (force.force.x, force.force.z) == (-1.0, 0.5)  # on the tissue there, on the tool here
    assert np.isnan(force.torque.x)
    frames = [m for _, m in bag.messages(['/optical/markers'])]
    assert frames[0].ids == ['m a', 'b']
    assert [m.visible for m in frames] == [
        [True, True], [True, False], [True, True], [True, True]]
    assert [m.frame_number for m in frames] == [0, 1, 2, 4]
    assert frames[2].points[1].z == pytest.approx(0.006)
    assert np.isnan(frames[1].points[1].x)
    pose = next(bag.messages(['/em/s/pose']))[1].pose
    assert (pose.position.z, pose.orientation.z, pose.orientation.w) == (3.0, 1.0, 0.0)
    assert [(m.status, m.quality) for _, m in bag.messages(['/em/s/status'])] == [(0, 0.5),
                                                                                  (1, 9.0)]
    assert bag.attachment_text('columns.yaml') == MAP


def test_recordings_of_one_map_have_names_of_their_own(rig):
    for name in (None, 'second'):
        import_csv(rig / 'map.yaml', rig / str(name), name=name)
    assert [BagReader(rig / str(name)).metadata()['arm_brachy']['name']
            for name in (None, 'second')] == ['test', 'second']


@pytest.mark.parametrize('zero', [0, 1_760_000_000], ids=['from zero', 'since 1970'])
@pytest.mark.parametrize(('begin', 'notes'), [(0.0, 0), (1.5, 0), (9.0, 1), (-9.0, 1)])
def test_streams_that_begin_seconds_apart_are_told_in_one_line(rig, begin, notes, zero):
    found = [note for note in clocks(rig, begin, zero)['notes'] if 'apart' in note]
    assert len(found) == notes
    left, right = max(-begin, 0.0), max(begin, 0.0)
    for note in found:
        assert (f'after the first sample, actuators/state {left:g} to {20 + left:g} s, '
                f'optical/markers {right:g} to {20 + right:g} s; 11 s are common to all') in note
        assert 'clock_offset_ms' in note and '\n' not in note


def test_streams_that_share_no_time_are_refused(rig):
    with pytest.raises(RecordingError, match='actuators/state and optical/markers share no time: '
                       'after the first sample, actuators/state 0 to 20 s, optical/markers 30 to '
                       '50 s; must overlap'):
        clocks(rig, 30.0)


def clocks(rig, begin, zero=0):
    """The import of 20 s of encoders, from `zero` [s], and of a camera `begin` [s] later."""
    (rig / 'map.yaml').write_text(
        "name: two\nencoders: [{csv: {path: enc.csv, time: t}, columns: '{key}', unit: mm}]\n"
        "optical: [{csv: {path: opt.csv, time: t}, columns: '{key}_{axis}', unit: mm}]\n")
    (rig / 'enc.csv').write_text('t,left\n' + ''.join(f'{zero + 0.5 * k},0\n' for k in range(41)))
    (rig / 'opt.csv').write_text('t,a_x,a_y,a_z\n' + ''.join(
        f'{zero + begin + 0.5 * k},4,5,6\n' for k in range(41)))
    return import_csv(rig / 'map.yaml', rig / 'bag')


def test_stamps_may_begin_before_zero(rig):
    """All are shifted alike, by whole seconds, and the report says so."""
    (rig / 'map.yaml').write_text(MAP.replace('start_s: 1.0', 'start_s: -74.5'))
    found = import_csv(rig / 'map.yaml', rig / 'bag')
    assert 'begins at -74.503 s: its times are shifted by 75 s' in found['notes'][-1]
    t, _ = BagReader(rig / 'bag').series('/actuators/state', lambda m: 0.0, clock='stamp')
    np.testing.assert_allclose(t, [0.497, 0.507, 0.517], atol=1e-9)
    t, _ = BagReader(rig / 'bag').series('/optical/markers', lambda m: 0.0, clock='stamp')
    np.testing.assert_allclose(t, [0.5, 0.51, 0.52, 0.54], atol=1e-9)


def test_messages_are_ordered_by_time_across_files(rig):
    import_csv(rig / 'map.yaml', rig / 'bag')
    times = [r.log_time_ns for r in BagReader(rig / 'bag').records()]
    assert times == sorted(times)


@pytest.mark.parametrize(('old', 'new', 'error', 'words'), [
    ('sign: on_tissue', 'sign: towards', ConfigError, 'sign'),
    ('sign: on_tissue', '', ConfigError, 'sign'),
    ('unit: mN', 'unit: lb', ConfigError, 'unit'),
    ("'q{key}_mm'", "'q{index}_mm'", ConfigError, r'may hold only \{key\}'),
    ("'q{key}_mm'", "'q_mm'", ConfigError, r'must hold \{key\}'),
    ("'q{key}_mm'", "'q{key_mm'", ConfigError, 'expected'),
    ('time_unit: ms', 'timeunit: ms', ConfigError, "did you mean 'time_unit'"),
    ('path: opt.csv', 'path: opt2.csv', RecordingError, 'no such file'),
    ('path: opt.csv', "path: opt.csv, decimal: ','", ConfigError, 'as is csv.delimiter; must be'),
    ('path: opt.csv', 'path: opt.csv, skip_below: -1', ConfigError, 'skip_below is -1; must be'),
])
def test_mistakes_in_the_map(rig, old, new, error, words):
    (rig / 'map.yaml').write_text(MAP.replace(old, new))
    with pytest.raises(error, match=words) as caught:
        import_csv(rig / 'map.yaml', rig / 'bag')
    assert '\n' not in str(caught.value)
    assert not (rig / 'bag').exists()


def test_a_map_of_nothing_is_refused(rig):
    (rig / 'map.yaml').write_text('name: nothing\n')
    with pytest.raises(ConfigError, match='names no file'):
        import_csv(rig / 'map.yaml', rig / 'bag')


@pytest.mark.parametrize('name', ['A', 'B', 'C'])
def test_dome_rig(recordings, tmp_path, name):
    folder = recordings / 'dome_rig' / 'recordings' / name
    report = import_csv(config_dir() / 'imports' / 'dome_rig.yaml', tmp_path / 'bag',
                        folder=folder)
    rates = {topic: s['rate_Hz'] for topic, s in report['streams'].items()}
    assert rates['/actuators/state'] == rates['/optical/markers'] == pytest.approx(100.0)
    assert rates['/em/em0/pose'] == pytest.approx(40.0)


def test_dome_rig_tissue_pushes_back_on_every_pad(recordings, tmp_path):
    rig = recordings / 'dome_rig'
    import_csv(config_dir() / 'imports' / 'dome_rig.yaml', tmp_path / 'bag',
               folder=rig / 'recordings' / 'C')
    bag = BagReader(tmp_path / 'bag')
    t, q = bag.series('/actuators/state', lambda m: m.position)
    for k, pad in enumerate(YAML(typ='safe').load(rig / 'scene.yaml')['pads']):
        t_f, force = bag.series(f'/force/pad_{k}/wrench', lambda m: [
            m.wrench.force.x, m.wrench.force.y, m.wrench.force.z])
        dq = np.diff(np.interp(t_f, t, q[:, k]))
        along = force @ np.array(pad['direction'])
        work = 0.5 * (along[1:] + along[:-1]) * dq  # of the tissue on the pad [J]
        taken = work[dq > 0].sum()
        assert taken < 0.0  # sign `on_tool`: the force opposes the push
        assert abs(work.sum()) < 0.1 * abs(taken)  # and gives back what it took



CELLS = """\
name: cells
forces:
  - csv: {path: cells.csv, time: t}
    columns: 'cell{key}'
    sign: on_tissue
    names: {a: '1', b: '2'}
    directions: {a: [0, 3, 0], b: [3, 0, -4]}
"""


def imported(folder, column_map, table):
    """Forces on cells a and b as the bag has them, name -> [(x, y, z)]."""
    (folder / 'cells.csv').write_text(table)
    (folder / 'cells.yaml').write_text(column_map)
    import_csv(folder / 'cells.yaml', folder / 'bag')
    return {name: [(m.wrench.force.x, m.wrench.force.y, m.wrench.force.z) for _, m in BagReader(
        folder / 'bag').messages([f'/force/{name}/wrench'])] for name in 'ab'}


def cells(folder, old='', new=''):
    return imported(folder, CELLS.replace(old, new), 't,cell1,cell2\n0,2,5\n0.01,,10\n')


def test_load_cells_of_one_axis_push_back_along_it(tmp_path):
    found = cells(tmp_path)
    np.testing.assert_allclose(found['a'], [(0, -2, 0)])
    np.testing.assert_allclose(found['b'], [(-3, 0, 4), (-6, 0, 8)])


@pytest.mark.parametrize(('old', 'new', 'message'), [
    ('{a: [0, 3, 0], b: [3, 0, -4]}', '{}',
     r"forces\[0\].columns = 'cell\{key\}'; must hold \{axis\}, or have `directions`"),
    ("'cell{key}'", "'cell{key}{axis}'", 'and not both'),
    ('b: [3, 0, -4]', 'b: [0, 0, 0]', r'forces\[0\].directions.b = \[0.0, 0.0, 0.0\]; must be'),
    ('b: [3, 0, -4]', 'c: [0, 0, 1]', r'forces\[0\].directions: lacks b; must have every pad'),
    ("{a: '1', b: '2'}", "{a: '1'}", r'forces\[0\].names: lacks b; must have every pad'),
    ('directions:', 'axes: [Z]\n    directions:', r"axes = \['Z'\]; must have 3 entries")])
def test_cells_without_a_direction_are_refused_in_a_line(tmp_path, old, new, message):
    with pytest.raises(ConfigError, match=message) as refused:
        cells(tmp_path, old, new)
    assert '\n' not in str(refused.value) and 'cells.yaml' in str(refused.value)


MOUNTED = """\
name: cells
forces:
  - csv: {path: cells.csv, time: t}
    columns: '{key}{axis}'
    sign: on_tool
    names: {a: A, b: B}
    mounted: {a: [[0, 2, 0], [-1, 0, 0]]}
"""


def mounted(folder, old='', new=''):
    return imported(folder, MOUNTED.replace(old, new), 't,Ax,Ay,Az,Bx,By,Bz\n0,1,2,3,1,2,3\n')


def test_cells_mounted_otherwise_are_turned_into_the_axes_of_the_scene(tmp_path):
    found = mounted(tmp_path)
    # x of the cell along +y, z along -x, hence y = z x x along -z.
    np.testing.assert_allclose(found['a'], [(-3, 1, -2)], atol=1e-12)
    np.testing.assert_allclose(found['b'], [(1, 2, 3)])


@pytest.mark.parametrize(('old', 'new', 'message'), [
    ('[-1, 0, 0]', '[-1, 1, 0]', r'forces\[0\].mounted.a = .*; must be two directions at right'),
    ('[-1, 0, 0]', '[0, 0, 0]', 'must be two directions at right angles'),
    ('[[0, 2, 0], [-1, 0, 0]]', '[[0, 2, 0]]', 'mounted.a .* must have 2 entries'),
    ('mounted: {a', 'mounted: {c', r'forces\[0\].mounted: has c; must be a three-axis cell')])
def test_a_mounting_that_is_none_is_refused_in_a_line(tmp_path, old, new, message):
    with pytest.raises(ConfigError, match=message) as refused:
        mounted(tmp_path, old, new)
    assert '\n' not in str(refused.value) and 'cells.yaml' in str(refused.value)


def test_a_mounting_of_a_cell_that_the_file_does_not_have_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r'cells.csv: has the cells A, B; `mounted` has a as'):
        mounted(tmp_path, '    names: {a: A, b: B}\n', '')


def test_an_optional_file_may_be_missing(tmp_path):
    (tmp_path / 'a.csv').write_text('t,q\n0,1\n1,2\n')
    section = "- csv: {{path: {}.csv, time: t, optional: true}}\n    columns: '{{key}}'\n"
    (tmp_path / 'map.yaml').write_text('name: some\nencoders:\n  ' + '  '.join(
        section.format(name) for name in 'ab'))
    found = import_csv(tmp_path / 'map.yaml', tmp_path / 'bag')
    assert found['absent'] == ['b.csv'] and list(found['streams']) == ['/actuators/state']
    (tmp_path / 'a.csv').unlink()
    with pytest.raises(ConfigError, match=r'names no file that is there; .* has no a.csv, b.csv'):
        import_csv(tmp_path / 'map.yaml', tmp_path / 'none')
