"""C3D import on files made by hand, and on the public silicone beam."""

from dataclasses import replace

import ezc3d
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core import config
from arm_brachy.core.errors import RecordingError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import Marker, MeshFile, Region, Scene
from arm_brachy.recording.import_c3d import C3dImport, Registration, Trigger, import_c3d
from arm_brachy.recording.reader import BagReader

REST = np.array([[0, 0, 0], [50, 0, 0], [0, 40, 0], [10, 10, 30.0]]) * 1e-3
NAMES = ('a', 'b', 'c', 'd')
RELEASE = 40  # last frame at rest
X_MW = Rotation.from_rotvec([0.3, -1.2, 0.4])
SHIFT = np.array([0.1, -0.2, 0.05])
OPTIONS = C3dImport(
    names={n: f'Label {n}' for n in NAMES}, registration=Registration(NAMES),
    trigger=Trigger('d'))


def scene(points=REST):
    return Scene('test', MeshFile('none'), Region('box'),
                 markers=tuple(Marker(n, tuple(p)) for n, p in zip(NAMES, points, strict=True)))


def motion():
    """World positions (n, 4, 3): at rest, then d sinks 1 mm per frame."""
    points = np.repeat(REST[None], 100, axis=0)
    points[RELEASE:, 3, 2] -= 1e-3 * np.arange(60)
    return points


@pytest.fixture
def write_c3d(tmp_path):
    def write(name='run', *, points=None, unit='mm', rate=200.0, hide=()):
        measured = X_MW.apply((motion() if points is None else points).reshape(-1, 3)) + SHIFT
        measured = measured.reshape(-1, 4, 3) / {'mm': 1e-3}.get(unit, 1.0)
        file = ezc3d.c3d()
        file['parameters']['POINT']['RATE']['value'] = [rate]
        file['parameters']['POINT']['LABELS']['value'] = [f'Label {n}' for n in NAMES]
        file['parameters']['POINT']['UNITS']['value'] = [unit]
        data = np.ones((4, 4, len(measured)))
        data[:3] = measured.transpose(2, 1, 0)
        residuals = np.zeros((1, 4, len(measured)))
        for frame, marker in hide:
            residuals[0, marker, frame] = -1.0
        file['data']['points'] = data
        file['data']['meta_points']['residuals'] = residuals
        file.write(str(tmp_path / f'{name}.c3d'))
        return tmp_path / f'{name}.c3d'

    return write


def positions(bag):
    return BagReader(bag).series('/optical/markers', lambda m: [[p.x, p.y, p.z] for p in m.points])


@pytest.mark.parametrize('unit', ['mm', 'm'])
def test_registered_in_metres_with_gaps_and_release(write_c3d, tmp_path, unit):
    path = write_c3d(unit=unit, hide=[(5, 1), (70, 2)])
    (report,) = import_c3d([path], tmp_path / 'out', OPTIONS, scene())['bags']
    assert (report['frames'], report['rate_Hz'], report['missing_values']) == (100, 200.0, 2)
    assert max(report['registration_mm'].values()) < 1e-3  # single precision of the file
    t, x = positions(report['bag'])
    np.testing.assert_allclose(t, np.arange(100) / 200.0, atol=1e-9)
    hidden = np.isnan(x).any(axis=2)
    assert np.argwhere(hidden).tolist() == [[5, 1], [70, 2]]
    np.testing.assert_allclose(x[~hidden], motion()[~hidden], atol=1e-6)
    # d is 1 mm off rest at frame 41, so beyond 1 mm from frame 42 on
    assert report['trigger_s'] == pytest.approx((RELEASE + 1) / 200.0, abs=1 / 200.0)


def test_part_about_the_release(write_c3d, tmp_path):
    options = replace(OPTIONS, start=-0.05, stop=0.1)
    (report,) = import_c3d([write_c3d()], tmp_path / 'out', options, scene())['bags']
    assert report['frames'] == 30
    assert report['trigger_s'] == pytest.approx(0.05)
    numbers = [m.frame_number for _, m in BagReader(report['bag']).messages()]
    assert numbers == list(range(numbers[0], numbers[0] + 30))
    assert positions(report['bag'])[0][0] == 0.0


def test_residual_of_a_marker_off_its_reference(write_c3d, tmp_path):
    moved = REST.copy()
    moved[1] += [0.0, 0.0, 4e-3]
    (report,) = import_c3d([write_c3d()], tmp_path / 'out', OPTIONS, scene(moved))['bags']
    left = np.array(list(report['registration_mm'].values())) * 1e-3
    _, best = Rotation.align_vectors(moved - moved.mean(axis=0), REST - REST.mean(axis=0))
    assert np.sqrt(np.sum(left**2)) == pytest.approx(best, rel=1e-4)


def test_several_files_and_labels_as_they_are(write_c3d, tmp_path):
    files = [write_c3d('one'), write_c3d('two')]
    report = import_c3d(files, tmp_path / 'out', C3dImport(unit='mm'))
    assert [b['bag'] for b in report['bags']] == [str(tmp_path / 'out' / n)
                                                  for n in ('one', 'two')]
    _, message = next(BagReader(tmp_path / 'out' / 'one').messages())
    assert message.ids == [f'Label {n}' for n in NAMES]
    x = positions(tmp_path / 'out' / 'two')[1]  # tracker frame kept
    np.testing.assert_allclose(x[0], X_MW.apply(REST) + SHIFT, atol=1e-6)


@pytest.mark.parametrize(('options', 'words'), [
    (replace(OPTIONS, names={'a': 'Label z'}), "no marker labelled 'Label z'; the file has"),
    (replace(OPTIONS, registration=Registration(('a', 'b', 'z'))), "no marker 'z' in the scene"),
    (replace(OPTIONS, trigger=Trigger('z')), "no marker 'z' in the capture"),
    (replace(OPTIONS, trigger=Trigger('a')), 'never leaves its rest'),
    (replace(OPTIONS, registration=Registration(NAMES, 0.0, 9.0)), 'within the 0.5 s recorded'),
    (replace(OPTIONS, start=-5.0), 'within the 0.5 s recorded'),
])
def test_refusals(write_c3d, tmp_path, options, words):
    with pytest.raises(RecordingError, match=words) as caught:
        import_c3d([write_c3d()], tmp_path / 'out', options, scene())
    assert '\n' not in str(caught.value)
    assert not (tmp_path / 'out').exists()


def test_unreadable_files(write_c3d, tmp_path):
    with pytest.raises(RecordingError, match="unit 'inch'; must be m or mm"):
        import_c3d([write_c3d(unit='inch')], tmp_path / 'out', C3dImport())
    (tmp_path / 'text.c3d').write_text('words ' * 200)
    for path, words in ((tmp_path / 'text.c3d', 'not a readable C3D'),
                        (tmp_path / 'none.c3d', 'no such file')):
        with pytest.raises(RecordingError, match=words):
            import_c3d([path], tmp_path / 'out', C3dImport())
    with pytest.raises(RecordingError, match='needs a scene'):
        import_c3d([write_c3d()], tmp_path / 'out', OPTIONS)


def test_unseen_marker_at_rest_is_refused(write_c3d, tmp_path):
    path = write_c3d(hide=[(k, 1) for k in range(60)])
    with pytest.raises(RecordingError, match="marker 'b' is never seen during the rest"):
        import_c3d([path], tmp_path / 'out', OPTIONS, scene())


def test_silicone_beam(recordings, tmp_path):
    reference = {'Tip-1': (0, 15, 36), 'Tip-2': (0, -6, 24), 'Tip-3': (0, 36, 6),
                 'Base-1': (-94, -10, -1), 'Base-2': (-94, 40, 27.5), 'Base-3': (-94, 40, 0)}
    beam = Scene('beam', MeshFile('none'), Region('box'), markers=tuple(
        Marker(n, tuple(1e-3 * v for v in p)) for n, p in reference.items()))
    options = config.load(C3dImport, config_dir() / 'imports' / 'silicone_beam.yaml')
    options = replace(options, start=None)  # whole files, for the protocol's frame numbers
    files = sorted((recordings / 'silicone_beam').glob('*.c3d'))
    bags = import_c3d(files, tmp_path / 'out', options, beam)['bags']
    assert [b['frames'] for b in bags] == [500, 500, 600, 600]
    for report in bags:
        assert (report['rate_Hz'], report['missing_values']) == (100.0, 0)
        # the protocol's own figures: released in frames 45-73, fit leaves 0.3-2.0 mm
        assert 0.44 <= report['trigger_s'] <= 0.74
        assert 0.25 < min(report['registration_mm'].values())
        assert max(report['registration_mm'].values()) < 2.0
        x = positions(report['bag'])[1]
        settled = x[round(100 * report['trigger_s']) + 100:]
        base = np.linalg.norm(settled[:, 3:, None] - settled[:, None, 3:], axis=-1)
        assert np.ptp(base, axis=0).max() < 0.2e-3  # a second after release the clamp is rigid
        assert (x[-50:, :3, 2].mean(axis=0) < x[:30, :3, 2].mean(axis=0) - 5e-3).all()  # sagged
