"""The study asks about every recording once, goes on where it was, and can do a part."""

import argparse
import json
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from arm_brachy.core.errors import NotConverged
from arm_brachy.diagnosis.report.answer import Diagnosis, Provenance
from arm_brachy.experiments import diagnosis_cases as cases
from arm_brachy.experiments import diagnosis_study as study
from arm_brachy.experiments.diagnosis_plan import plan
from arm_brachy.experiments.diagnosis_recordings import observe
from arm_brachy.experiments.diagnosis_score import score

MM = 1e-3
PLAN = plan()


def detect(evidences, scene, *, seed):
    """A detector that finds nothing, and gives up with seed 0."""
    if seed == 0:
        raise NotConverged('gave up')
    source = Provenance('stub', seed, 'unknown', 'none', str(scene), ())
    one, = evidences
    return Diagnosis('nothing_missing', source, notes=(one.name,))


@pytest.fixture
def pushed(push, tmp_path):
    """A folder with one recording of it; its index."""
    cases.store(tmp_path / 'case_000.npz', observe(PLAN[0], push))
    return tmp_path, [cases.labels(PLAN[0], 'case_000.npz')]


def test_every_recording_is_answered_once(pushed, monkeypatch):
    monkeypatch.setattr(cases, 'process_pool', ThreadPoolExecutor)
    folder, index = pushed
    lines = study.answer_all(folder, index, detect, seed=5)
    line, = lines.values()
    assert line['name'] == 'case_000' and line['cpu_s'] > 0.0
    assert line['answer']['verdict'] == 'nothing_missing'
    assert line['answer']['notes'] == ['case_000'] and line['answer']['provenance']['seed'] == 5
    assert study.answer_all(folder, index, None) == lines   # nobody is asked


def test_a_detector_that_gives_up_has_failed(label, pushed):
    line = study.answer_one(pushed[0] / 'case_000.npz', detect, study.SCENE, 0)
    row = score(label('backlash'), line)
    assert (row['outcome'], row['said']) == ('failed', 'gave up')
    assert score(label(None), line)['outcome'] == 'failed'


def test_a_line_that_was_cut_short_is_no_answer(label, answer, tmp_path):
    index = [label(None)]
    whole = {'name': index[0]['name'], 'cpu_s': 1.0, 'answer': answer('nothing_missing')}
    path = tmp_path / 'answers.jsonl'
    path.write_text(json.dumps(whole) + '\n{"name": "case_0', encoding='utf-8')
    lines = study.answer_all(tmp_path, index, None)
    assert lines == {whole['name']: whole}
    assert path.read_text(encoding='utf-8') == json.dumps(whole) + '\n'


def asked(folder):
    return [json.loads(line)['name'] for line in (folder / 'answers.jsonl').open()]


def test_a_part_is_studied_and_the_rest_later(push, tmp_path, monkeypatch):
    monkeypatch.setattr(cases, 'process_pool', ThreadPoolExecutor)
    monkeypatch.setattr(cases, 'plan', lambda seed: PLAN[:3])
    monkeypatch.setattr(cases, 'move', lambda plant: push)
    for only, names in ((slice(1, 2), ['case_001']), (slice(0, 2), ['case_001', 'case_000']),
                        (slice(None), ['case_001', 'case_000', 'case_002'])):
        study.reproduce(tmp_path, tmp_path, detect, only)
        found = json.loads((tmp_path / 'diagnosis-terms.json').read_text())
        judged, = (row for row in found['rows'] if row.get('what', '').startswith('cases judged'))
        assert asked(tmp_path) == names
        assert (judged['count'], judged['of']) == (len(names), 3)
        goals = {one['name']: one['met'] for one in found['targets']}
        assert goals['false alarms, nothing planted'] is (True if len(names) == 3 else None)


def test_what_was_answered_before_a_bug_is_kept(push, tmp_path, monkeypatch):
    def stumbles(evidences, scene, *, seed):
        if evidences[0].name == 'case_000':
            return detect(evidences, scene, seed=seed)
        end = time.monotonic() + 10.0
        while not (tmp_path / 'answers.jsonl').stat().st_size and time.monotonic() < end:
            time.sleep(0.01)    # the other answer is on its way
        raise RuntimeError('a bug')

    monkeypatch.setattr(cases, 'process_pool', ThreadPoolExecutor)
    index = [cases.labels(case, f'{case.name}.npz') for case in PLAN[:2]]
    for case in PLAN[:2]:
        cases.store(tmp_path / f'{case.name}.npz', observe(case, push))
    with pytest.raises(RuntimeError, match='a bug'):
        study.answer_all(tmp_path, index, stumbles)
    assert asked(tmp_path) == ['case_000']
    assert list(study.answer_all(tmp_path, index, detect)) == ['case_000', 'case_001']


def test_a_stretch_is_first_and_end():
    assert study.stretch('0:45') == slice(0, 45)
    assert study.stretch(f'120:{len(PLAN)}') == slice(120, len(PLAN))
    for text in ('45', ':45', '4:4', '9:3', '-3:4', f'0:{len(PLAN) + 1}', 'a:b', '1:2:3'):
        with pytest.raises(argparse.ArgumentTypeError, match=f'0 <= FIRST < END <= {len(PLAN)}'):
            study.stretch(text)
