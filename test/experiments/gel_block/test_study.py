"""What counts as right, the row of a case, and the scene that is handed over."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.signals.loading import load_evidence
from arm_brachy.experiments import laboratory, told
from arm_brachy.experiments.diagnosis_cases import save
from arm_brachy.experiments.gel_block import study
from arm_brachy.experiments.gel_block.bodies import BODIES, RAYS
from arm_brachy.experiments.gel_block.cases import CASES
from arm_brachy.experiments.gel_block.layout import PADS, SIDE, SIZE
from arm_brachy.experiments.gel_block.protocol import PUSHES
from arm_brachy.experiments.gel_block.scene import write_scene
from arm_brachy.registry import by_name
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import boundary_faces, volumes

BY_NAME = {case.name: case for case in CASES}


def cause(term, option=0, probability=0.9, applies_to=None, **parameters):
    told = {key: {'value': v, 'interval_90': [lo, hi]} for key, (v, lo, hi) in parameters.items()}
    return {'term': term, 'option': option, 'probability': probability,
            'applies_to': applies_to or {}, 'parameters': told}


def answer(verdict, *causes):
    return {'verdict': verdict, 'causes': list(causes), 'recalibrated': {}, 'fit': []}


def row(case, said, cpu_s=1.0):
    return laboratory.row(case, {'cpu_s': cpu_s, 'answer': said}, study.truth(case))


def test_cases_plant_what_the_registry_knows():
    assert len(BY_NAME) == len(CASES)
    for case in CASES:
        assert case.body in BODIES
        if case.term is None:
            assert not case.truth and not case.place
        else:
            assert by_name(case.term).spec.name == case.term


@pytest.mark.parametrize('case, said, right', [
    ('null_1', answer('nothing_missing'), True),
    ('null_1', answer('named', cause('backlash')), False),
    ('null_1', answer('unexplained'), False),
    ('null_1', {'error': 'no state'}, False),
    ('gain_b', answer('named', cause('actuator_gain')), True),
    ('gain_b', answer('named', cause('actuator_gain'), cause('discretisation')), True),
    ('gain_b', answer('named', cause('actuator_gain'), cause('backlash')), False),
    ('gain_b', answer('equivalent', cause('actuator_compliance', 2, 0.3),
                      cause('actuator_gain', 1, 0.7)), True),
    ('gain_b', answer('equivalent', cause('actuator_compliance', 2, 0.7),
                      cause('actuator_gain', 1, 0.3)), False),
    ('gain_b', answer('unexplained', cause('actuator_gain')), False),
    ('gain_b', answer('nothing_missing'), False),
])
def test_right_is_the_planted_term_alone_or_at_the_head(case, said, right):
    assert told.right(BY_NAME[case], said) is right


def test_a_row_sets_what_was_found_beside_what_was_planted():
    drift = cause('force_drift', applies_to={'pads': ['pad_b']},
                 rate_N_min=([0.38, 0.29, 0.0], [0.30, 0.21, -0.1], [0.46, 0.37, 0.1]))
    one = row(BY_NAME['drift_b'], answer('named', drift), 3.0)
    assert (one['parameter'], one['true'], one['found']) == ('rate_N_min x', 0.4, 0.38)
    assert (one['low'], one['high']) == (0.30, 0.46)
    assert one['right'] and one['place_right'] and one['intervals_hold']
    drift['applies_to'] = {'pads': []}
    drift['parameters']['rate_N_min']['interval_90'][0][1] = 0.31
    one = row(BY_NAME['drift_b'], answer('named', drift), 3.0)
    assert not one['place_right'] and not one['intervals_hold']


def test_rows_have_the_same_columns_and_a_line_each_in_the_readme():
    rows = [row(case, answer('nothing_missing')) for case in CASES]
    rows.append(row(CASES[0], {'error': 'no state'}))
    assert len({tuple(one) for one in rows}) == 1
    lines = laboratory.markdown(json.loads(json.dumps({'rows': rows}))).splitlines()
    assert len(lines) == len(rows) + 2
    assert len({line.count('|') for line in lines}) == 1


def test_a_delay_includes_what_the_clock_is_off():
    for name in ('late_optical', 'late_force'):
        assert abs(study.truth(BY_NAME[name])['delay_ms'] - 60.0) == pytest.approx(2.0)


def test_the_modulus_is_the_one_that_a_slow_test_finds():
    assert BY_NAME['null_1'].modulus_kPa == pytest.approx(12.0 * 1.15)
    assert BY_NAME['visco'].modulus_kPa == pytest.approx(12.0 * 1.15 * 0.8)


def test_every_gain_has_its_rays():
    """No push of any case leaves what is solved."""
    for case in CASES:
        for push in PUSHES:
            travel = push.travel * np.array(case.setup.gain)
            found = [name for name, full in RAYS.items()
                     if abs(travel[0] * full[1] - travel[1] * full[0]) < 1e-12
                     and np.all(travel <= np.array(full) + 1e-12)]
            assert found, (case.name, push)


def test_a_study_goes_on_where_it_was(rays, tmp_path, monkeypatch):
    """Solved and answered once, though asked for twice; each recording is read by its scene."""
    (tmp_path / 'states').mkdir()
    for name, ray in rays.items():
        save(tmp_path / 'states' / f'fine_{name}.npz', vars(ray))
    asked = []

    def diagnosed(bag, scene, page, seed):
        asked.append(load_evidence((bag,), load_scene(scene))[0].name)
        return answer('nothing_missing')

    monkeypatch.setattr(laboratory, '_diagnosed', diagnosed)
    monkeypatch.setattr(laboratory, 'hasty_pool', lambda jobs: ThreadPoolExecutor(1))
    gain = BY_NAME['gain_b']
    two = (BY_NAME['poor_null'], replace(gain, setup=replace(gain.setup, poor=True)))
    for cases in (two[:1], two, two):
        found = study.reproduce(tmp_path, tmp_path, cases)
    assert asked == ['poor_null', 'gain_b']
    assert [(one['case'], one['right']) for one in found.rows] == [('poor_null', True),
                                                                   ('gain_b', False)]
    assert json.loads((tmp_path / 'gel-block.json').read_text())['rows'][1][
        'true'] == pytest.approx(-0.08)


def test_the_scene_is_the_block_with_its_pads(tmp_path):
    write_scene(tmp_path / 'scene.yaml')
    body = build_body(load_scene(tmp_path / 'scene.yaml'))
    corners = body.mesh.nodes[boundary_faces(body.mesh).ravel()]
    np.testing.assert_allclose(np.ptp(corners, axis=0), SIZE, atol=1e-9)
    assert volumes(body.mesh).sum() == pytest.approx(np.prod(SIZE), rel=1e-9)
    for pad, built in zip(PADS, body.pads, strict=True):
        nodes = body.mesh.nodes[built.nodes]
        assert pad.carries(nodes).all()
        assert np.ptp(nodes, axis=0).max() == pytest.approx(SIDE, abs=1e-9)
