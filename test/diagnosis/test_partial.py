"""A diagnosis that is ended early says what it knows, and that it is no verdict."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from ruamel.yaml import YAML

from arm_brachy.cli import diagnose as command
from arm_brachy.cli import main
from arm_brachy.core import config
from arm_brachy.core.errors import InputError
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import MeshFile, load_scene, with_mesh
from arm_brachy.diagnosis.bags import LoadedBags
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.partial import quick_answer
from arm_brachy.diagnosis.progress import ERRORS, FITS, MESHES, MODEL, SCREEN, SIGNALS, STEPS
from arm_brachy.diagnosis.report.answer import Diagnosis, Provenance
from arm_brachy.diagnosis.results.parts import Unfinished
from arm_brachy.diagnosis.signals.loading import load_evidence
from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.stream import FORCE, OPTICAL
from arm_brachy.diagnosis.stages import Quick
from arm_brachy.experiments.csv_files import (
    ENCODERS,
    FORCES,
    Recorded,
    write_recording,
)
from arm_brachy.experiments.csv_files import OPTICAL as MARKERS
from arm_brachy.recording.import_csv import import_csv
from arm_brachy.registry import parse_terms

SCENES = config_dir() / 'scenes'
STIFFENING = ({'name': 'strain_stiffening', 'ratio': 6.0},)
FORMATS = {ENCODERS: ('q_{key}', '%.5f'), MARKERS: ('{key}_{axis}', '%.4f'),
           FORCES: ('F{axis}_{key}', '%.5f')}


@pytest.fixture(scope='module')
def scene():
    """The breast on 600 linear elements, alike in truth and model."""
    coarse = with_mesh(load_scene(SCENES / 'breast.yaml'), SCENES / 'breast' / 'breast_600.msh')
    return replace(coarse, element='linear')


@pytest.fixture(scope='module')
def recording(scene, tmp_path_factory):
    """(bag, scene file): one push of two pads, in tissue that stiffens."""
    folder = tmp_path_factory.mktemp('recording')
    corners = np.array([(0, 0), (2, 0), (2.5, 8), (4, 8), (4.5, 0), (6, 0), (6.5, 5), (8, 5),
                        (8.5, 0), (10.5, 0)])
    t = np.arange(0.0, 10.5, 0.05)
    depth = 1e-3 * np.interp(t, *corners.T)
    q = np.stack([np.where(t < 6.0, depth, 0.0), np.where(t < 6.0, 0.0, depth),
                  0.0 * t, 0.0 * t], axis=1)
    specimen = specimen_of(scene)
    seen = ForwardModel(specimen, parse_terms(STIFFENING, 'test')).predict(Path(t, q), t)
    rng = np.random.default_rng(1)
    points, forces = seen.get(OPTICAL), seen.get(FORCE)
    columns = write_recording({
        ENCODERS: Recorded(specimen.pads, t, q),
        MARKERS: Recorded(specimen.markers, t, points + 5e-5 * rng.standard_normal(points.shape)),
        FORCES: Recorded(specimen.pads, t, forces + 0.02 * rng.standard_normal(forces.shape))},
        folder / 'csv', 'pushed', FORMATS)
    import_csv(columns, folder / 'bag')
    file = folder / 'scene.yaml'
    with file.open('w', encoding='utf-8') as out:
        YAML().dump(config.to_mapping(replace(scene, mesh=MeshFile(
            str(SCENES / 'breast' / 'breast_600.msh'), scene.mesh.unit))), out)
    return folder / 'bag', file


def test_ctrl_c_writes_what_is_known(recording, tmp_path):
    """A real process and its forks, in the middle of the linear screen, as a terminal does it."""
    bag, scene = recording
    process = subprocess.Popen(
        [sys.executable, '-m', 'arm_brachy', 'diagnose', str(bag), '--scene', str(scene), '--out',
         str(tmp_path / 'out'), '--quick', '--jobs', '2'], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, start_new_session=True)
    seen = []
    for line in process.stderr:
        seen.append(line)
        if f'step 4 of 6: {SCREEN}' in line:
            break
    time.sleep(0.1)     # until they are at work; an idle machine has done all after 0.5 s
    os.killpg(process.pid, signal.SIGINT)
    said, rest = process.communicate(timeout=300)
    assert process.returncode == 130, rest
    with pytest.raises(ProcessLookupError):     # no fork goes on
        os.killpg(process.pid, 0)
    assert 'Traceback' not in rest and f'error: interrupted; what was known until then is in ' \
        f'{tmp_path / "out"}' in rest
    steps = [line.split(': ')[1].split(',')[0] for line in seen if 'step' in line]
    assert list(dict.fromkeys(steps)) == [step.split(',')[0] for step in STEPS[:4]]
    found = json.loads((tmp_path / 'out' / 'diagnosis.json').read_text(encoding='utf-8'))
    assert found['verdict'] == 'partial' and found['causes'] == []
    assert found['unfinished']['why'] == 'interrupted'
    assert found['unfinished']['done'] == [SIGNALS, MESHES, MODEL]
    assert found['unfinished']['left'] == [SCREEN, FITS, ERRORS]
    assert {one['stream'] for one in found['fit']} == {'optical', 'force'}
    assert all(one['with_the_causes'] is None for one in found['fit'])
    page = (tmp_path / 'out' / 'diagnosis.html').read_text(encoding='utf-8')
    assert 'No verdict: interrupted after' in page and 'No verdict: interrupted after' in said
    assert not (tmp_path / 'out' / 'corrected.yaml').exists()


def test_a_quick_look_ranks_what_was_planted_first_and_gives_no_verdict(recording):
    bag, file = recording
    scene = load_scene(file)
    told = []
    answer = quick_answer(load_evidence([bag], scene), Provenance('x', 0, '', '', '', ()),
                          progress=lambda *one: told.append(one), quick=Quick())
    d = answer.diagnosis
    assert d.verdict == 'partial' and d.unfinished.why == 'quick'
    assert d.screen[0].term == 'strain_stiffening'
    assert d.screen[0].evidence > d.screen[1].evidence and d.screen[0].full_fit is None
    assert any(one.variant.endswith(') mm') for one in d.screen)
    assert d.unfinished.left == (FITS, ERRORS) and 0.0 <= d.chance <= 1.0
    assert any('12 load states' in note for note in d.notes)
    counts = [(done, total) for step, done, total, *_ in told if step == SCREEN]
    assert [done for done, _ in counts] == list(range(len(counts)))
    assert len({total for _, total in counts}) == 1
    assert 'ranks strain stiffening first' in d.sentence, d.screen


def ended(monkeypatch, tmp_path, end, *words):
    """(exit status, stderr, diagnosis.json) of a diagnosis that `end` ends in its first step."""
    scene = load_scene(SCENES / 'breast.yaml')

    def begin(evidences, *_, known, **__):
        known.evidences = evidences
        end()

    monkeypatch.setattr(command.stages, 'diagnose', begin)
    monkeypatch.setattr(command, 'load_bags', lambda *_, **__: LoadedBags((
        SimpleNamespace(name='one', scene=scene, span=(0.0, 1.0)),)))
    answer = CliRunner().invoke(main, ['diagnose', 'bag', '--scene',
                                       str(SCENES / 'breast.yaml'), '--out',
                                       str(tmp_path / 'out'), *words])
    file = tmp_path / 'out' / 'diagnosis.json'
    return answer.exit_code, answer.stderr, json.loads(file.read_text(encoding='utf-8'))


def test_a_time_limit_ends_with_status_1_and_what_is_known(monkeypatch, tmp_path):
    code, said, found = ended(monkeypatch, tmp_path, lambda: time.sleep(60.0),
                              '--time-limit', '0.2')
    assert code == 1 and 'the time limit of 0.2 s is over' in said
    assert found['verdict'] == 'partial' and found['unfinished']['why'] == 'time_limit'
    assert found['unfinished']['done'] == [] and found['unfinished']['seconds'] < 60.0
    assert 'longer --time-limit' in found['what_next'][0]


def test_a_partial_answer_has_a_reason_and_no_other_has_one():
    source = Provenance('x', 0, '', '', '', ())
    with pytest.raises(InputError, match='only a partial one has it'):
        Diagnosis('partial', source)
    with pytest.raises(InputError, match='only a partial one has it'):
        Diagnosis('nothing_missing', source, unfinished=Unfinished('quick', 1.0, (), ()))
    with pytest.raises(InputError, match='must be interrupted, time_limit or quick'):
        Unfinished('tired', 1.0, (), ())
