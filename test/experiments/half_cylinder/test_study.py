"""What counts as right, and the scene that is handed over."""

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.signals.loading import load_evidence
from arm_brachy.experiments import laboratory, told
from arm_brachy.experiments.diagnosis_cases import save
from arm_brachy.experiments.half_cylinder import recorder, study
from arm_brachy.experiments.half_cylinder.bodies import BODIES, PLAIN, REMEMBERING
from arm_brachy.experiments.half_cylinder.cases import BESIDE, CASES
from arm_brachy.experiments.half_cylinder.layout import LENGTH, MM, PADS, RADIUS
from arm_brachy.experiments.half_cylinder.scene import write_scene
from arm_brachy.registry import by_name
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import volumes

BY_NAME = {case.name: case for case in CASES}


def answer(verdict, *causes, where=(), when=()):
    return {'verdict': verdict, 'causes': list(causes), 'recalibrated': {}, 'fit': [],
            'where': list(where), 'when': list(when)}


def row(case, said):
    return laboratory.row(case, {'cpu_s': 1.0, 'answer': said}, beside=BESIDE)


def test_cases_plant_what_the_registry_knows_or_does_not():
    assert len(BY_NAME) == len(CASES)
    for case in CASES:
        assert case.body in (*BODIES, REMEMBERING)
        if case.term is None:
            assert not case.truth and not case.place
        elif case.term != told.OUTSIDE:
            assert by_name(case.term).spec.name == case.term


def cause(term):
    return {'term': term, 'option': 0, 'probability': 0.9, 'applies_to': {}, 'parameters': {}}


@pytest.mark.parametrize('case, said, right', [
    ('null', answer('nothing_missing'), True),
    ('null', answer('named', cause('clock_offset')), True),
    ('null', answer('named', cause('clock_offset'), cause('backlash')), False),
    ('null', answer('unexplained'), False),
    ('loose_base', answer('named', cause('base_debond'), cause('em_offset')), True),
    ('loose_base', answer('named', cause('em_offset')), False),
    ('loose_base', answer('nothing_missing'), False)])
def test_clocks_and_frames_that_are_off_may_be_named(case, said, right):
    assert row(BY_NAME[case], said)['right'] is right


JUMP = {'where': [{'actuator': 'left'}, {'stream': 'force', 'channel': 'top'}],
        'when': [{'recording': 'r', 't_start_s': 0.0, 't_end_s': 9.0, 'regime': ''},
                 {'recording': 'r', 't_start_s': 44.2, 't_end_s': 97.0, 'regime': '',
                  'onset_s': [44.2, 44.4]}]}


def test_right_of_what_no_term_is_for_is_to_abstain_and_say_where_and_when():
    case = BY_NAME['force_jump']
    one = row(case, answer('unexplained', **JUMP))
    assert one['right'] and one['place_right'] and one['intervals_hold']
    assert (one['planted'], one['parameter']) == (told.OUTSIDE, 'onset_s')
    assert (one['true'], one['found']) == (44.3, pytest.approx(44.3))
    assert (one['low'], one['high']) == (44.2, 44.4)


@pytest.mark.parametrize('said', [
    answer('nothing_missing'), {'error': 'no state'},
    answer('named', cause('force_drift'), **JUMP),
    answer('unexplained', cause('force_drift'), **JUMP)])
def test_wrong_is_silence_and_any_claim(said):
    assert not row(BY_NAME['force_jump'], said)['right']


def test_elsewhere_and_without_an_onset_is_said_so():
    one = row(BY_NAME['force_jump'], answer(
        'unexplained', where=[{'stream': 'force', 'channel': 'left'}], when=[JUMP['when'][0]]))
    assert one['right'] and one['place_right'] is False and one['found'] is None
    one = row(BY_NAME['hysteresis'], answer('unexplained', **JUMP))
    assert one['right'] and one['place_right'] is None and one['parameter'] is None


def test_rows_have_the_same_columns_and_a_line_each():
    rows = [row(case, answer('nothing_missing')) for case in CASES]
    rows.append(row(BY_NAME['force_jump'], answer('unexplained', **JUMP)))
    rows.append(row(BY_NAME['force_jump'], {'error': 'no state'}))
    assert len({tuple(one) for one in rows}) == 1
    lines = laboratory.markdown(json.loads(json.dumps({'rows': rows}))).splitlines()
    assert len(lines) == len(rows) + 2
    assert len({line.count('|') for line in lines}) == 1


def test_the_modulus_is_the_one_that_a_slow_test_finds():
    assert BY_NAME['null_stiffer'].modulus_kPa == pytest.approx(9.0 * 1.08)
    assert BY_NAME['visco'].modulus_kPa == pytest.approx(9.0 * 1.05 * 0.8)


def test_a_study_goes_on_where_it_was(rays, tmp_path, monkeypatch):
    """Solved and answered once, though asked for twice; each recording is read by its scene."""
    (tmp_path / 'states').mkdir()
    for name, ray in rays.items():
        save(tmp_path / 'states' / f'{PLAIN}_{name}.npz', vars(ray))
    asked = []

    def diagnosed(bag, scene, page, seed):
        asked.append(load_evidence((bag,), load_scene(scene))[0].name)
        return answer('nothing_missing')

    monkeypatch.setattr(recorder, 'END', 12.0)
    monkeypatch.setattr(laboratory, '_diagnosed', diagnosed)
    monkeypatch.setattr(laboratory, 'hasty_pool', lambda jobs: ThreadPoolExecutor(1))
    cases = (BY_NAME['null'], BY_NAME['slip_m4'])
    for some in (cases[:1], cases):
        found = study.reproduce(tmp_path, tmp_path, some)
    assert asked == ['null', 'slip_m4']
    assert [(one['case'], one['right']) for one in found.rows] == [('null', True),
                                                                   ('slip_m4', False)]
    assert json.loads((tmp_path / 'half-cylinder.json').read_text())['rows'][1][
        'parameter'] == 'offset_mm y'


def test_the_scene_is_the_half_cylinder_with_its_pads(tmp_path):
    write_scene(tmp_path / 'scene.yaml')
    body = build_body(load_scene(tmp_path / 'scene.yaml'))
    nodes = body.mesh.nodes
    np.testing.assert_allclose(np.ptp(nodes, axis=0), [LENGTH, 2 * RADIUS, RADIUS], atol=0.4 * MM)
    assert volumes(body.mesh).sum() == pytest.approx(np.pi / 2 * RADIUS ** 2 * LENGTH, rel=0.01)
    assert np.abs(nodes[body.fixed, 2]).max() < 0.5 * MM
    for pad, built in zip(PADS, body.pads, strict=True):
        away = np.linalg.norm(nodes[built.nodes] - pad.centre, axis=1)
        assert len(away) > 10 and 8 * MM < away.max() < 9.5 * MM
