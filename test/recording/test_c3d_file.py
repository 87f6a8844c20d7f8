"""C3D files as writers make them: right, or refused in one line, and never more than the file."""

import importlib.util
import resource
import struct
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording.import_c3d import read_c3d

SPEC = importlib.util.spec_from_file_location('c3d_writer', Path(__file__).with_name(
    'c3d_writer.py'))
writer = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(writer)
LABELS = ['east', 'west', 'top']


@pytest.fixture
def points():
    """(50, 3, 3) [mm]; quarters of a millimetre are exact as floats and as integers."""
    made = np.tile([[10.0, 20.0, 30.0], [40.0, 50.0, 60.0], [70.0, 80.0, 90.0]], (50, 1, 1))
    made[:, 0, 2] += np.rint(20.0 * np.sin(np.arange(50) / 5.0)) / 4.0
    return made


@pytest.mark.parametrize('scale', [-1.0, 0.25])
@pytest.mark.parametrize('processor', [writer.INTEL, writer.DEC, writer.MIPS])
def test_every_processor_reads_the_same(tmp_path, points, processor, scale):
    residual = np.zeros((50, 3))
    residual[7:9, 1] = -1
    path = writer.write_c3d(tmp_path / 'x.c3d', points, LABELS, processor=processor, scale=scale,
                            residual=residual, analog=6, declared=6)
    found = read_c3d(path)
    assert (found.names, found.rate, found.first, found.notes) == (tuple(LABELS), 100.0, 0, ())
    assert np.argwhere(np.isnan(found.points).any(axis=2)).tolist() == [[7, 1], [8, 1]]
    seen = residual >= 0
    np.testing.assert_allclose(found.points[seen], 1e-3 * points[seen], rtol=1e-15)


def test_a_second_reader_agrees(tmp_path, points):
    path = writer.write_c3d(tmp_path / 'x.c3d', points, LABELS)
    other = np.moveaxis(ezc3d.c3d(str(path))['data']['points'][:3], 0, -1).swapaxes(0, 1)
    assert np.array_equal(read_c3d(path).points, 1e-3 * other)


def test_analog_values_that_no_parameter_declares(tmp_path, points):
    path = writer.write_c3d(tmp_path / 'x.c3d', points, LABELS, analog=6)
    found = read_c3d(path)
    np.testing.assert_allclose(found.points, 1e-3 * points, rtol=1e-15)
    assert len(found.notes) == 1 and 'analog values 6 or 0' in found.notes[0]


def test_what_no_reading_explains_is_refused(tmp_path, points):
    path = writer.write_c3d(tmp_path / 'x.c3d', points, LABELS, header_points=5, frames=70)
    path.write_bytes(path.read_bytes()[:-2 * writer.BLOCK])
    with pytest.raises(RecordingError, match=r'x\.c3d: header and parameters differ \(points 5 or '
                                             '3; frames 50 or 70'):
        read_c3d(path)


def test_labels_beyond_one_parameter_and_beyond_the_points(tmp_path):
    names = [f'm{k:03d}' for k in range(300)]
    many = np.arange(1.0, 901.0).reshape(1, 300, 3)
    rest = ('LABELS2', -1, [4, 45], ''.join(names[255:]).encode())
    path = writer.write_c3d(tmp_path / 'x.c3d', many, names[:255], more=[rest])
    found = read_c3d(path)
    assert found.names == tuple(names)
    np.testing.assert_allclose(found.points, 1e-3 * many, rtol=1e-6)
    path = writer.write_c3d(tmp_path / 'y.c3d', many[:, :2], ['a', 'b', 'spare'])
    assert read_c3d(path).names == ('a', 'b')
    assert read_c3d(path).notes == ('3 labels for 2 points: the first 2 belong to them',)


def test_a_label_there_twice_is_refused_unless_it_is_not_wanted(tmp_path, points):
    path = writer.write_c3d(tmp_path / 'x.c3d', points, ['east', 'east', 'top'])
    with pytest.raises(RecordingError, match="2 points are labelled 'east'"):
        read_c3d(path)
    assert read_c3d(path, {'t': 'top'}).names == ('t',)


def test_outputs_of_a_body_model_are_no_markers(tmp_path, points):
    angles = ('ANGLES', -1, [3, 1], b'top')
    path = writer.write_c3d(tmp_path / 'x.c3d', points, LABELS, more=[angles])
    found = read_c3d(path)
    assert found.names == ('east', 'west')
    assert found.notes == ('1 outputs of a body model left out (POINT:ANGLES): top',)
    with pytest.raises(RecordingError, match="'top' is an output of a body model"):
        read_c3d(path, {'t': 'top'})


def test_zeros_where_a_point_is_lost_are_gaps(tmp_path, points):
    points[20:30, 1] = 0.0
    points[:, 2] = 0.0                        # never seen, residual 0
    found = read_c3d(writer.write_c3d(tmp_path / 'x.c3d', points, LABELS))
    assert np.isnan(found.points).all(axis=2).sum(axis=0).tolist() == [0, 10, 50]
    assert found.notes == ('west: 10 of 50 frames are 0 0 0: read as not seen',
                           'top: 50 of 50 frames are 0 0 0: read as not seen')


def test_a_point_that_passes_the_origin_is_seen_there(tmp_path, points):
    points[:, 0] = (np.arange(50)[:, None] - 25) * [1.0, 0.5, 0.25]
    points[:20, 1] = 0.0                      # at rest in the origin, then off
    points[20:, 1] = np.arange(1, 31)[:, None] * [0.0, 0.0, 0.5]
    found = read_c3d(writer.write_c3d(tmp_path / 'x.c3d', points, LABELS))
    assert found.notes == () and np.isfinite(found.points).all()
    np.testing.assert_allclose(found.points, 1e-3 * points, rtol=1e-15)


def test_numbers_no_camera_gives_are_gaps(tmp_path, points):
    points[5, 2] = 1e38
    found = read_c3d(writer.write_c3d(tmp_path / 'x.c3d', points, LABELS))
    assert np.argwhere(np.isnan(found.points).all(axis=2)).tolist() == [[5, 2]]
    assert found.notes == ('top: 1 of 50 frames are more than 1000 m away: read as not seen',)


def test_more_frames_than_the_header_can_say(tmp_path):
    n = 70000
    track = np.linspace(1.0, 2.0, n)[:, None, None] * np.ones((1, 1, 3))
    path = writer.write_c3d(tmp_path / 'x.c3d', track, ['a'])
    assert len(read_c3d(path).points) == pytest.approx(n, abs=32)  # the last block is filled up
    long = ('LONG_FRAMES', 4, [], struct.pack('<f', float(n)))
    path = writer.write_c3d(tmp_path / 'y.c3d', track, ['a'], more=[long])
    assert len(read_c3d(path).points) == n


@pytest.mark.parametrize('keep', [0, 100, 700, 1100, 2000])
def test_a_file_cut_short_is_refused(tmp_path, points, keep):
    path = writer.write_c3d(tmp_path / 'x.c3d', points, LABELS)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(RecordingError, match=r'x\.c3d: ') as caught:
        read_c3d(path)
    assert '\n' not in str(caught.value)


def test_no_byte_of_header_or_parameters_asks_for_more_than_the_file(tmp_path, points):
    """Each byte in turn at its extremes; ezc3d takes 12.5 GB of some and dies of others."""
    path = writer.write_c3d(tmp_path / 'x.c3d', points, LABELS)
    sound = path.read_bytes()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # KB
    for at in [*range(24), *range(512, 900)]:
        for value in (0, 228, 255):
            path.write_bytes(sound[:at] + bytes([value]) + sound[at + 1:])
            try:
                found = read_c3d(path)
            except RecordingError as error:
                assert '\n' not in str(error)
                continue
            assert found.points.size <= len(sound) // 4
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20e3
