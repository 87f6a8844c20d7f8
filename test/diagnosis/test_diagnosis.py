"""The answer as JSON, key by key, and the contradictions that it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.scene import Marker, MeshFile, PadPatch, Region, Scene
from arm_brachy.devices.terms.backlash import Backlash
from arm_brachy.diagnosis.report.finding_estimates import cause_of, interval_of, place_of
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.results.finding import Finding
from arm_brachy.diagnosis.results.parts import Interval, NextExperiment, Place, StreamFit
from arm_brachy.scenario import Scenario

# ARCHITECTURE's eight, then what explains them
KEYS = ('verdict', 'where', 'when', 'causes', 'alternatives', 'fit', 'next_experiment', 'scene')


def body(answer):
    return json.loads(answer.to_json())


@pytest.mark.parametrize('name', ['named', 'structural', 'equivalent', 'nothing_missing',
                                  'unexplained'])
def test_every_answer_has_every_key(answers, name):
    found = body(answers[name])
    assert set(KEYS) < found.keys()
    assert found['verdict'] in ('named', 'nothing_missing', 'equivalent', 'unexplained')
    assert found['sentence'] == answers[name].sentence
    assert found['provenance'].keys() >= {'seed', 'commit', 'machine', 'recordings', 'command'}


def test_file_and_text_are_the_same(answers, tmp_path):
    text = answers['named'].to_json(tmp_path / 'answer.json')
    assert (tmp_path / 'answer.json').read_text(encoding='utf-8') == text


def test_where_is_in_metres(answers):
    [where] = body(answers['named'])['where']
    assert where == {'position_m': [0.0182, 0.0081, 0.0284], 'radius_m': 0.0031,
                     'term': 'inclusion', 'option': 0}
    region, marker = body(answers['unexplained'])['where']
    assert region == {'position_m': [-0.031, 0.024, 0.041], 'radius_m': 0.0086}
    assert marker == {'stream': 'optical', 'channel': 'tissue_10'}
    assert body(answers['structural'])['where'][0]['actuator'] == 'pad_1'


def test_what_comes_nearest_has_no_interval_and_is_no_cause(answers):
    found = body(answers['unexplained'])
    assert found['causes'] == []
    near, = found['nearest']['causes']
    assert near['parameters']['radius_mm'] == {'value': pytest.approx(24.2), 'unit': 'mm'}
    assert 'radius_m' not in found['nearest']['where'][0]
    assert [one['stream'] for one in found['nearest']['fit']] == ['optical', 'force']
    with pytest.raises(InputError, match='named with what comes nearest'):
        replace(answers['named'], nearest=answers['unexplained'].nearest)


def test_when_is_in_seconds_with_its_regime(answers):
    assert body(answers['unexplained'])['when'] == [{
        'recording': 'rich', 't_start_s': 23.4, 't_end_s': 27.2, 'regime': 'unload',
        'onset_s': [23.31, 23.47]}]


def test_causes_carry_units_and_intervals_in_them(answers):
    [cause] = body(answers['named'])['causes']
    assert cause['term'] == 'inclusion' and cause['probability'] == 0.9993
    assert cause['parameters']['radius_mm'] == {'value': 9.3, 'interval_90': [7.1, 11.8],
                                                'unit': 'mm'}
    assert cause['parameters']['centre_mm']['value'] == [18.2, 8.1, 28.4]
    assert cause['parameters']['ratio']['unit'] == '1'


def test_a_cause_of_some_scenes_alone_says_of_which(answers):
    found = answers['named']
    assert 'scenes' not in body(found)['causes'][0]
    alone = replace(found, causes=(replace(found.causes[0], scenes=('hung',)),))
    assert body(alone)['causes'][0]['scenes'] == ['hung']


def test_options_are_told_apart(answers):
    first, second = body(answers['equivalent'])['causes']
    assert (first['term'], second['term']) == ('actuator_gain', 'actuator_compliance')
    assert first['option'] != second['option'] and 0 not in (first['option'], second['option'])
    assert first['probability'] + second['probability'] == pytest.approx(1.0)
    assert first['applies_to'] == {'actuators': [0]}


def test_alternatives_say_why_they_lost(answers):
    lost = {one['terms'][0]: one for one in body(answers['named'])['alternatives']}
    assert lost['stiffness_gradient']['held_out_score'] == 31.4
    assert all(one['why'] for one in lost.values())
    named = body(answers['named'])
    assert (named['evidence_nats'], named['held_out_score']) == (198.3, 212.7)
    assert lost['pad_slip']['visible'] is False and 'not ruled out' in lost['pad_slip']['why']


def test_fit_is_per_stream_in_its_unit(answers):
    optical, force = body(answers['named'])['fit']
    assert optical == {'stream': 'optical', 'unit': 'mm', 'as_given': pytest.approx(0.62),
                       'recalibrated': pytest.approx(0.41), 'with_the_causes': pytest.approx(0.16),
                       'noise_floor': pytest.approx(0.15), 'mesh': None, 'held_out': 'pairs'}
    assert force['unit'] == 'N' and force['noise_floor'] == pytest.approx(0.03)
    assert body(answers['nothing_missing'])['fit'][0]['with_the_causes'] is None


def test_what_is_fitted_anyway_is_told_in_edge_units(answers):
    (name, _, unit, *numbers), = answers['nothing_missing'].fitted_anyway()
    assert (name, unit) == ('E', 'kPa') and numbers == [5.96, 5.84, 6.08]


def test_limits_are_told_in_edge_units(answers):
    first, _ = body(answers['nothing_missing'])['would_have_shown_from']
    assert first == {'term': 'backlash', 'parameter': 'width', 'unit': 'mm', 'value': 0.0432,
                     'typical_sizes': 0.14}
    assert body(answers['named'])['would_have_shown_from'] == []


def test_next_experiment_holds_moves_that_a_scenario_takes(answers):
    asked = body(answers['equivalent'])['next_experiment']
    scenario = config.from_mapping(Scenario, {
        'name': 'next', 'seed': 1, 'scene': 'x.yaml', 'moves': asked['moves']}, 'test')
    assert scenario.moves == answers['equivalent'].next_experiment.moves
    assert asked['record'] == ['force'] and asked['separation_sd'] == 9.6
    assert asked['splits'] == [['actuator_gain', 'actuator_compliance']]


def test_what_is_not_finite_is_null(answers):
    odd = replace(answers['structural'], apart=np.inf)
    assert body(odd)['separation_sd'] is None


@pytest.mark.parametrize('change, complaint', [
    ({'verdict': 'perhaps'}, 'must be one of named'),
    ({'causes': ()}, 'named without a cause'),
    ({'verdict': 'nothing_missing'}, 'must have none'),
    ({'verdict': 'equivalent'}, 'at least two'),
    ({'verdict': 'unexplained', 'where': (), 'when': ()}, 'where or when'),
    ({'recalibrated': {'density': Estimate(1.0, 1.0, 1.0)}}, 'must be of E, nu'),
])
def test_contradictions_are_refused(answers, change, complaint):
    with pytest.raises(InputError, match=complaint):
        replace(answers['named'], **change)


def test_an_option_of_its_own_is_no_name(answers):
    with pytest.raises(InputError, match='option 0'):
        replace(answers['named'], causes=(Cause('inclusion', option=1),))


@pytest.mark.parametrize('make, complaint', [
    (lambda: Cause('backlsh'), "did you mean 'backlash'"),
    (lambda: Cause('backlash', {'depth': Estimate(1.0, 1.0, 1.0)}), 'must be of start, width'),
    (lambda: Cause('backlash', applies_to={'pads': ('pad_1',)}), 'must be of actuators'),
    (lambda: Cause('backlash', probability=1.2), 'must be 0 to 1'),
    (lambda: Estimate(3.0, 1.0, 2.0), 'outside its interval'),
    (lambda: Estimate((1.0, 2.0, 3.0), 0.0, 4.0), 'one shape'),
    (lambda: Place(), 'by nothing'),
    (lambda: Place(stream='optical', actuator='pad_1'), 'by stream and actuator'),
    (lambda: Place(stream='sonar'), "'sonar'"),
    (lambda: Place(position=(0.0, 0.0, 0.0)), 'radius of the region around it'),
    (lambda: Interval('a', 3.0, 2.0), 'not end before'),
    (lambda: Interval('a', 2.0, 3.0, 'thursday'), "'thursday'"),
    (lambda: StreamFit('sonar', 1.0, 1.0, 1.0), "'sonar'"),
    (lambda: NextExperiment(), 'ask for something'),
])
def test_bad_parts_are_refused(make, complaint):
    with pytest.raises((InputError, ConfigError), match=complaint):
        make()


def test_a_cause_builds_its_term(answers):
    assert answers['structural'].causes[0].build() == Backlash(0.31e-3, (0,))


def test_the_likeliest_option_is_what_gets_built(answers):
    d = answers['equivalent']
    assert [cause.term for cause in d.likeliest()] == ['actuator_gain']
    sure = replace(d, causes=(*d.causes, Cause('gravity')))
    assert [cause.term for cause in sure.likeliest()] == ['gravity', 'actuator_gain']


def test_the_mesh_is_no_physics():
    assert not Cause('discretisation').physical
    assert Cause('inclusion').physical


@pytest.fixture
def scene():
    pad = PadPatch('left', centre=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0))
    return Scene('s', MeshFile('m.msh'), Region('set', 'base'), pads=(pad,),
                 markers=(Marker('m1', (0.0, 0.0, 0.0)),))


def finding(*args, **more):
    return Finding(*args, 8.0, 2.0, 9.0, 'said.', **more)


def test_a_finding_becomes_a_cause_with_its_90_percent(scene):
    one = finding('encoder', 'left', 'backlash', 'width', 3e-4, 'm', 1e-5,
                  parameters={'width': 3e-4, 'actuators': (0,)})
    cause = cause_of(one, 0.97)
    width = cause.parameters['width']
    # 1.645 is the 95 % quantile of the normal distribution
    assert (width.low, width.high) == pytest.approx((3e-4 - 1.645e-5, 3e-4 + 1.645e-5), rel=1e-4)
    assert cause.build() == Backlash(3e-4, (0,)) and cause.probability == 0.97
    assert place_of(one, scene) == Place(actuator='left', term='backlash')
    assert interval_of(one, 'run') == Interval('run', 2.0, 9.0, term='backlash')


def test_a_sudden_finding_keeps_the_interval_of_its_onset(scene):
    one = finding('optical', 'm1', 'marker_slip', 'offset', np.array([1e-3, 0.0, 0.0]), 'm',
                  np.full(3, 1e-4), onset=(1.9, 2.1),
                  parameters={'marker': 'm1', 'onset': 2.0, 'offset': (1e-3, 0.0, 0.0)})
    cause = cause_of(one, 1.0)
    assert cause.parameters['onset'] == Estimate(2.0, 1.9, 2.1)
    assert cause.applies_to == {'marker': 'm1'}
    assert place_of(one, scene) == Place(stream='optical', channel='m1', term='marker_slip')
    assert interval_of(one, 'run').onset == (1.9, 2.1)


def test_what_a_finding_has_no_error_for_is_unbounded():
    one = finding('optical', 'm1', 'pad_misplacement', 'tilt_up', 0.1, 'rad', 0.01,
                  parameters={'tilt_up': 0.1, 'tilt_side': 0.02, 'pads': ('left',)})
    assert cause_of(one, 1.0).parameters['tilt_side'] == Estimate(0.02, -np.inf, np.inf)


def test_a_finding_without_a_term_is_a_place_only(scene):
    one = finding('optical', 'm1', None, '', 1.0, 'm', 0.1)
    assert place_of(one, scene) == Place(stream='optical', channel='m1')
    with pytest.raises(InputError, match='names no term'):
        cause_of(one, 1.0)
