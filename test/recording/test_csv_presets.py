"""Exports of instruments, made here in the layouts that their vendors document, to column maps."""

import io

import numpy as np
import pytest
from ruamel.yaml import YAML

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError, RecordingError
from arm_brachy.recording.csv_map import ColumnMap
from arm_brachy.recording.csv_presets import PRESETS, preset_map
from arm_brachy.recording.import_csv import import_csv, import_map
from arm_brachy.recording.reader import BagReader

ROWS = 40
T = np.arange(ROWS) / 100.0
X = 10.0 + np.sin(T)        # mm, of m1; m2 is at 20, 5, 6
ROWS_OF = list(zip(T.tolist(), X.tolist(), strict=True))


def write(path, lines, end='\r\n', encoding='utf-8'):
    path.write_bytes((end.join(lines) + end).encode(encoding))
    return path


def motive(path, *, version='1.23', unit='Millimeters', parent=False, body=False):
    """docs.optitrack.com, Data Export: CSV."""
    owners = ['gel:m1'] * 3 + ['gel:m2'] * 3 + (['probe'] * 7 if body else [])
    kinds = ['Marker'] * 6 + (['Rigid Body'] * 7 if body else [])
    parts = ['Position'] * 6 + (['Rotation'] * 4 + ['Position'] * 3 if body else [])
    axes = [*'XYZXYZ', *('XYZWXYZ' if body else '')]
    scale = {'Millimeters': 1.0, 'Meters': 1e-3}[unit]
    lines = [f'Format Version,{version},Take Name,Take 1,Capture Frame Rate,100.000000,Export '
             f'Frame Rate,100.000000,Rotation Type,Quaternion,Length Units,{unit},Coordinate '
             'Space,Global', '', ',Type,' + ','.join(kinds), ',Name,' + ','.join(owners),
             ',ID,' + ','.join(['A1'] * len(owners)),
             *([',Parent,' + ','.join([''] * len(owners))] if parent else []),
             ',,' + ','.join(parts), 'Frame,Time (Seconds),' + ','.join(axes)]
    for i, (t, x) in enumerate(ROWS_OF):
        cells = [x, 2, 3, 20, 5, 6]
        row = [repr(v * scale) for v in cells] if i != 7 else ['', '', '', *(
            repr(v * scale) for v in cells[3:])]
        row += ['0', '0', '0', '1', *(repr(v * scale) for v in (x, 1, 1))] if body else []
        lines.append(f'{i},{t:.6f},' + ','.join(row))
    return write(path, lines)


def nexus(path, *, devices=False, delimiter=',', decimal='.'):
    """Nexus, Export ASCII: sections with a rate, names, axes and units."""
    lines = []
    if devices:
        lines += ['Devices', '1000', ',,Plate - Force,,', 'Frame,Sub Frame,Fx,Fy,Fz', ',,N,N,N',
                  '1,0,1,2,3', '']
    lines += ['Trajectories', '100', ',,gel:m1,,,gel:m2,,', 'Frame,Sub Frame,X,Y,Z,X,Y,Z',
              ',,mm,mm,mm,mm,mm,mm']
    lines += [f'{i + 1},0,{x!r},2,3,20,5,6' if i != 7 else f'{i + 1},0,,,,20,5,6'
              for i, (_, x) in enumerate(ROWS_OF)]
    if devices:
        lines += ['', 'Model Outputs', '100', ',,gel:angle', 'Frame,Sub Frame,X', ',,deg',
                  '1,0,1']
    lines = [line.replace(',', delimiter).replace('.', decimal) for line in lines]
    return write(path, lines)


def qualisys(path, *, meta=True, header=True, leads=True):
    """QTM user manual, TSV export: the gap is zeros, as is its default."""
    lines = ['NO_OF_FRAMES\t40', 'NO_OF_CAMERAS\t8', 'NO_OF_MARKERS\t2', 'FREQUENCY\t100',
             'NO_OF_ANALOG\t0', 'ANALOG_FREQUENCY\t0', 'DESCRIPTION\t--',
             'TIME_STAMP\t2022-06-03, 10:47:36.627\t94247.45402301', 'DATA_INCLUDED\t3D',
             'MARKER_NAMES\tm1\tm2\t', 'TRAJECTORY_TYPES\tMeasured\tMeasured'] if meta else []
    lead = 'Frame\tTime\t' if leads else ''
    lines += [lead + 'm1 X\tm1 Y\tm1 Z\tm2 X\tm2 Y\tm2 Z\t'] if header else []
    for i, (t, x) in enumerate(ROWS_OF):
        place = '0.000\t0.000\t0.000' if i == 7 else f'{x!r}\t2\t3'
        lines.append((f'{i + 1}\t{t:.5f}\t' if leads else '') + f'{place}\t20\t5\t6')
    return write(path, lines)


def ndi(path, *, tools=('gel_1', 'gel_2'), stamped=False, delimiter=',', markers=False):
    """NDI Track and ToolBox: `Port`, then the columns of a tool; strays are those of its markers.
    """
    strays = ['State', 'Tx', 'Ty', 'Tz'] if markers else []
    own = ['Frame', *(['Time [sec]'] if stamped else []), 'Face', 'State', 'Q0', 'Qx', 'Qy', 'Qz',
           'Tx', 'Ty', 'Tz', 'Error', 'Markers', *strays]
    ports = [f'Port {10 + k}: {tool}  s/n:3E4C8{k}' for k, tool in enumerate(tools)]
    lines = [delimiter.join(['Tools', *(cell for port in ports for cell in (port, *own))])]
    for i, (t, x) in enumerate(ROWS_OF):
        row = [str(len(tools))]
        for k, port in enumerate(ports):
            row += [port, str(1000 + i), *([f'{1778067471.25 + t:.9f}'] if stamped else []),
                    '0']
            lost = i == 7 and k == 0
            row += (['Missing', *['-3.697314E28'] * 8, '0'] if lost else
                    ['OK', '1', '0', '0', '0', repr(x) if k == 0 else '20', '2', '3', '0.1', '0'])
            row += ['OK', '7', '7', '7'] if markers else []
        lines.append(delimiter.join(row))
    return write(path, lines)


def ati(path, *, unit='N', counts=1000000):
    """ATI Net F/T manual, Demo CSV file format."""
    head = ['Start Time: 5/3/24 2:02 PM', 'RDT Sample Rate: 100',
            '"PLEASE NOTE: The sample rate is read when the program starts."',
            f'Force Units: {unit}', f'Counts per Unit Force: {counts}', 'Torque Units: Nm',
            'Counts per Unit Torque: 1000000',
            'Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, Time']
    rows = [f'0x00000000,{i + 1},{7 * i},{round(x * counts)},{-2 * counts},0,1,2,3,'
            '"2:02:03.125 PM"' for i, (_, x) in enumerate(ROWS_OF)]
    return write(path, head + rows)


def imported(preset, files, tmp_path, **options):
    """(bag, report) by the map of a preset as a person would have it printed, saved and read."""
    text = io.StringIO()
    YAML().dump(preset_map(preset, [str(file) for file in files], **options), text)
    (tmp_path / 'map.yaml').write_text(text.getvalue())
    found = import_csv(tmp_path / 'map.yaml', tmp_path / 'bag')
    return BagReader(tmp_path / 'bag'), found


def check_optical(bag, found, *, first=0.0):
    t, points = bag.series('/optical/markers', lambda m: [
        [p.x, p.y, p.z] for p in m.points], clock='stamp')
    np.testing.assert_allclose(t, first + T, atol=1e-9)
    ids = next(m for _, m in bag.messages(['/optical/markers'])).ids
    assert list(ids) == ['m1', 'm2']
    x = 1e-3 * X
    x[7] = np.nan
    np.testing.assert_allclose(points[:, 0, 0], x, atol=1e-9)
    np.testing.assert_allclose(points[:7, 0, 1:], [[2e-3, 3e-3]] * 7)
    np.testing.assert_allclose(points[:, 1], [[20e-3, 5e-3, 6e-3]] * ROWS)
    assert found['streams']['/optical/markers']['missing_values'] == 1
    assert found['streams']['/optical/markers']['rate_Hz'] == pytest.approx(100.0)


@pytest.mark.parametrize('options', [{}, {'unit': 'Meters'}, {'version': '1.25', 'parent': True}])
def test_motive(tmp_path, options):
    bag, found = imported('motive', [motive(tmp_path / 'take.csv', **options)], tmp_path)
    check_optical(bag, found)


def test_motive_rigid_bodies_are_tools(tmp_path):
    bag, found = imported('motive', [motive(tmp_path / 'take.csv', body=True)], tmp_path)
    check_optical(bag, found)
    poses = [m.pose for _, m in bag.messages(['/em/probe/pose'])]
    np.testing.assert_allclose([p.position.x for p in poses], 1e-3 * X, atol=1e-9)
    assert {p.orientation.w for p in poses} == {1.0}


@pytest.mark.parametrize('options', [{}, {'devices': True}, {'delimiter': ';', 'decimal': ','}])
def test_nexus(tmp_path, options):
    bag, found = imported('nexus', [nexus(tmp_path / 'trial.csv', **options)], tmp_path)
    check_optical(bag, found)


@pytest.mark.parametrize('options', [
    {}, {'meta': False}, {'header': False}, {'header': False, 'leads': False}])
def test_qualisys(tmp_path, options):
    bag, found = imported('qualisys', [qualisys(tmp_path / 'qtm.tsv', **options)], tmp_path)
    check_optical(bag, found)
    assert '1 positions are 0 0 0 and count as not measured: m1 1' in found['notes'][-1]


@pytest.mark.parametrize('options', [
    {}, {'tools': ('gel_1',)}, {'markers': True}, {'delimiter': '\t'},
    {'tools': ('gel 1', 'gel-2'), 'stamped': True}])
def test_ndi(tmp_path, options):
    stamped = options.get('stamped')
    rate = {} if stamped else {'rate': 100.0}
    bag, found = imported('ndi', [ndi(tmp_path / 'track.csv', **options)], tmp_path, **rate)
    t, p = bag.series('/em/gel_1/pose', lambda m: [m.pose.position.x, m.pose.position.y,
                                                   m.pose.orientation.w], clock='stamp')
    note = next(note for note in found['notes'] if 'says' in note)
    assert 'gel_1 says Missing in 1 rows, the first in line 9' in note
    assert not any('quaternion' in one for one in found['notes'])
    seen = np.arange(ROWS) != 7
    np.testing.assert_allclose(t, (T + (1778067471.25 if stamped else 10.0))[seen], atol=1e-6)
    np.testing.assert_allclose(p, np.column_stack([1e-3 * X, 2e-3 + 0 * X, 1 + 0 * X])[seen],
                               atol=1e-9)
    status = [m.status for _, m in bag.messages(['/em/gel_1/status'])]
    assert status.count(1) == 1 and len(status) == ROWS
    if len(options.get('tools', 'xx')) > 1:
        assert len(list(bag.messages(['/em/gel_2/pose']))) == ROWS


@pytest.mark.parametrize('unit, scale', [('N', 1.0), ('lbf', 4.4482216152605)])
def test_ati(tmp_path, unit, scale):
    bag, _ = imported('ati', [ati(tmp_path / 'east.csv', unit=unit)], tmp_path)
    t, f = bag.series('/force/east/wrench', lambda m: [m.wrench.force.x, m.wrench.force.y],
                      clock='stamp')
    np.testing.assert_allclose(t, T + 0.01, atol=1e-9)
    np.testing.assert_allclose(f, scale * np.column_stack([X, -2.0 + 0 * X]), atol=1e-5)


def test_what_a_preset_refuses(tmp_path):
    for preset, file, words in (
            ('motive', nexus(tmp_path / 'a.csv'), 'an export of Vicon Nexus; must be one of .*'
             'use --preset nexus'),
            ('ndi', write(tmp_path / 'b.csv', ['t,x', '0,1']), 'no layout that is known'),
            ('ndi', ndi(tmp_path / 'c.csv'), 'states no rate; give --rate')):
        with pytest.raises(RecordingError, match=words):
            preset_map(preset, [str(file)])
    with pytest.raises(ConfigError, match=', '.join(PRESETS)):
        preset_map('vicon', [str(tmp_path / 'a.csv')])


def test_a_unit_of_the_map_that_is_not_the_files_is_refused(tmp_path):
    mapping = preset_map('motive', [str(motive(tmp_path / 'take.csv'))])
    mapping['optical'][0]['unit'] = 'm'
    column_map = config.from_mapping(ColumnMap, mapping, 'map.yaml')
    with pytest.raises(RecordingError, match='states its values in mm, the map says m'):
        import_map(column_map, tmp_path / 'map.yaml', tmp_path / 'bag', text='')


@pytest.mark.parametrize('make, csv', [
    (motive, {'time': 'Time (Seconds)', 'header_line': 7}), (motive, {'time': 'Time (Seconds)'}),
    (nexus, {'time': 'Frame', 'header_line': 4, 'skip_below': 1}), (nexus, {'time': 'Frame'})])
def test_a_map_that_says_less_is_helped_by_what_the_export_says_of_itself(tmp_path, make, csv):
    """Names above the axes, and the rate of frame numbers, stand in the file."""
    make(tmp_path / 'a.csv')
    (tmp_path / 'map.yaml').write_text('')
    column_map = config.from_mapping(ColumnMap, {'name': 'x', 'optical': [{
        'csv': {'path': 'a.csv', **csv}, 'columns': '{key}{axis}', 'unit': 'mm',
        'axes': ['X', 'Y', 'Z'], 'names': {'m1': 'gel:m1', 'm2': 'gel:m2'}}]}, 'map.yaml')
    found = import_map(column_map, tmp_path / 'map.yaml', tmp_path / 'bag')
    check_optical(BagReader(tmp_path / 'bag'), found, first=0.01 if make is nexus else 0.0)
