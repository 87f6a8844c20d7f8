"""What is put wrong in another laboratory's recordings, and nothing besides."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from arm_brachy.core.scene import load_scene
from arm_brachy.evaluation.timeseries import EmSamples, OpticalFrames, RunData, Series
from arm_brachy.experiments import dome_rig
from arm_brachy.experiments.dome_faults import study
from arm_brachy.experiments.dome_faults.faults import BY_NAME, FAULTS, ONSET
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.recording.scene_import import import_scene
from arm_brachy.registry import by_name
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import load_mesh

T = np.linspace(0.0, 36.0, 73)
PADS = tuple(f'pad_{i}' for i in range(4))
STREAMS = ('encoder', 'force', 'optical', 'em')


@pytest.fixture
def run():
    rng = np.random.default_rng(1)
    n, ids = len(T), ('m03', 'm04', 'm05')
    return RunData('made up', '', 0, 'unknown', 'unknown',
                   em={'em0': EmSamples(T, rng.random((n, 3)), np.zeros(n), np.zeros(n, int))},
                   encoder=Series(T, rng.random((n, 4))), encoder_pads=PADS,
                   force=Series(T, rng.random((n, 4, 3))), force_pads=PADS,
                   optical=OpticalFrames(T, ids, rng.random((n, 3, 3)), np.ones((n, 3), bool)))


@pytest.fixture(scope='module')
def dome(recordings, tmp_path_factory):
    """(scene, bags) of the shortest of the dome rig's recordings."""
    scratch = tmp_path_factory.mktemp('dome')
    files = import_scene(recordings / 'dome_rig' / 'scene.yaml', scratch / 'dome', name='dome')
    import_csv(files['maps']['C'], scratch / 'dome_C')
    return Path(files['scene']), {'C': scratch / 'dome_C'}


def changed(before, after):
    """Names of the streams that differ."""
    return {name for name in STREAMS if not same(getattr(before, name), getattr(after, name))}


def same(a, b):
    if isinstance(a, dict):
        return all(same(a[key], b[key]) for key in a)
    return all(np.array_equal(vars(a)[key], vars(b)[key]) for key in vars(a))


def test_faults_are_terms_of_the_registry_with_their_fields():
    assert len(BY_NAME) == len(FAULTS)
    for fault in FAULTS:
        if fault.term is not None:
            fields = by_name(fault.term).__dataclass_fields__
            assert all(name in fields for name in fault.place)


@pytest.mark.parametrize(('name', 'stream'), [
    ('sound', None), ('undercounted', 'encoder'), ('steps_lost', 'encoder'),
    ('late_force', 'force'), ('early_optical', 'optical'), ('slipped', 'optical'),
    ('scaled', 'optical'), ('louder', 'force'), ('drifting', 'force'), ('tool_moved', 'em'),
    ('weighed', None)])
def test_a_fault_of_one_stream_leaves_the_others(run, name, stream):
    assert changed(run, BY_NAME[name].spoil(run, 0)) == ({stream} if stream else set())


def test_the_encoder_of_one_pad_counts_too_little(run):
    spoilt = BY_NAME['undercounted'].spoil(run, 0)
    gain = BY_NAME['undercounted'].truth['gain']
    np.testing.assert_allclose((1.0 + gain) * spoilt.encoder.values[:, 1],
                               run.encoder.values[:, 1])
    np.testing.assert_array_equal(spoilt.encoder.values[:, [0, 2, 3]],
                                  run.encoder.values[:, [0, 2, 3]])


def test_what_happens_once_happens_in_the_first_recording_from_the_onset_on(run):
    for name in ('steps_lost', 'slipped'):
        spoil = BY_NAME[name].spoil
        assert not changed(run, spoil(run, 1))
        stream = 'encoder' if name == 'steps_lost' else 'optical'
        key = 'values' if name == 'steps_lost' else 'points'
        more = getattr(getattr(spoil(run, 0), stream), key) - getattr(getattr(run, stream), key)
        assert not more[ONSET > T].any() and more[ONSET <= T].any(axis=tuple(
            range(1, more.ndim))).all()


def test_altered_scenes_build_and_say_what_their_faults_say(dome, tmp_path):
    scene = load_scene(dome[0])
    plain = load_mesh(scene.mesh.file).nodes
    for name in ('incompressible', 'too_high', 'turned', 'weighed', 'soft_label'):
        altered = study.altered_scene(BY_NAME[name], scene, tmp_path)
        assert altered != scene
        build_body(altered)
        height = np.ptp(load_mesh(altered.mesh.file).nodes[:, 2]) / np.ptp(plain[:, 2])
        truth = BY_NAME[name].truth.get('height', 0.0)
        assert height * (1.0 + truth) == pytest.approx(1.0)


def test_a_study_goes_on_where_it_was(dome, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(dome_rig, 'imported', lambda source, scratch: dome)

    def diagnosed(runs, scene, zero, page):
        asked.append(page.stem)
        return {'verdict': 'nothing_missing', 'causes': [], 'fit': []}

    monkeypatch.setattr(study, '_diagnosed', diagnosed)
    monkeypatch.setattr(study, 'hasty_pool', lambda jobs: ThreadPoolExecutor(1))
    two = BY_NAME['sound'], BY_NAME['louder']
    for faults in (two[:1], two, two):
        found = study.reproduce(tmp_path, tmp_path / 'answers', faults)
    assert asked == ['sound', 'louder']
    assert [(one['case'], one['right']) for one in found.rows] == [('sound', True),
                                                                   ('louder', False)]
    body = json.loads((tmp_path / f'{study.NAME}.json').read_text())
    lines = study.markdown(body).splitlines()
    assert len(lines) == 4 and len({line.count('|') for line in lines}) == 1
