"""Test of prove/outcome.py, detail.py and score.py on answers made by hand."""

import numpy as np
import pytest
from made_up_answers import answer, cause, effect, record, truth

from arm_brachy.prove.outcome import confidence, outcome, rank
from arm_brachy.prove.score import first_said, score
from arm_brachy.prove.totals import shares

BACKLASH = effect('backlash', {'width_mm': 0.2, 'actuators': ['pad_2']}, size=0.8,
                  place=[0.05, 0.0, 0.02])
GAIN = effect('force_gain', {'gain': 0.1, 'pads': ['pad_1']})
STIFF = effect('stiffness_scale', {'factor': 1.5})
SILENT, UNEXPLAINED = answer('nothing_missing'), answer('unexplained', where=[{'stream': 'force'}])


def told(value, low, high):
    return {'value': value, 'interval_90': [low, high], 'unit': ''}


@pytest.mark.parametrize(('given', 'true', 'word'), [
    (answer('named', cause('backlash')), truth(BACKLASH), 'right'),
    (answer('named', cause('backlash'), cause('discretisation')), truth(BACKLASH), 'right'),
    (answer('named', cause('backlash'), cause('gravity')), truth(BACKLASH), 'wrong'),
    (answer('named', cause('gravity')), truth(BACKLASH), 'wrong'),
    (answer('named', cause('gravity')), truth(kind='null'), 'wrong'),
    (SILENT, truth(kind='null'), 'silent'),
    (SILENT, truth(BACKLASH), 'silent'),
    (UNEXPLAINED, truth(BACKLASH), 'abstained'),
    (answer('unexplained', cause('gravity'), where=[{}]), truth(BACKLASH), 'wrong'),
    (answer('equivalent', cause('backlash', 1, 0.6), cause('gravity', 2, 0.4)), truth(BACKLASH),
     'wide'),
    (answer('equivalent', cause('actuator_gain', 1, 0.6), cause('actuator_compliance', 2, 0.4)),
     truth(effect('actuator_gain', {'gain': 0.1})), 'class'),
    (answer('named', cause('backlash'), cause('force_gain')), truth(BACKLASH, GAIN, kind='pair'),
     'right'),
    (answer('named', cause('backlash')), truth(BACKLASH, GAIN, kind='pair'), 'partly'),
    (answer('named', cause('backlash'), cause('gravity')), truth(BACKLASH, GAIN, kind='pair'),
     'wrong'),
    (UNEXPLAINED, truth(effect('air_gap', {'pad': 'pad_1'}), kind='strange', in_catalogue=False),
     'abstained'),
    (answer('named', cause('backlash')),
     truth(effect('air_gap', {'pad': 'pad_1'}), kind='strange', in_catalogue=False), 'wrong'),
    (answer('equivalent', cause('actuator_lag', 1, 0.5), cause('clock_offset', 2, 0.5)),
     truth(effect('actuator_lag', {}), kind='confounded', alike=('actuator_lag', 'clock_offset')),
     'right'),
    (answer('named', cause('actuator_lag')),
     truth(effect('actuator_lag', {}), kind='confounded', alike=('actuator_lag', 'clock_offset')),
     'wide'),
    (answer('nothing_missing', recalibrated={'E_kPa': told(9.1, 8.0, 10.0)}), truth(STIFF),
     'right'),
    (answer('nothing_missing', recalibrated={'E_kPa': told(6.5, 6.0, 7.0)}), truth(STIFF),
     'silent'),
    (None, truth(BACKLASH), 'failed'),
    (None, truth(kind='null'), 'failed'),
])
def test_what_an_answer_is_worth(given, true, word):
    assert outcome(record(given), true) == word


def test_a_failure_is_wrong_in_every_count():
    row = score(record(None), truth(kind='null'))
    assert (row['top_1'], row['top_3'], row['one_right']) == (False, False, False)
    assert row['said'] == 'answered' or row['said']


def test_the_modulus_of_the_set_up_counts_with_the_planted_factor():
    true = truth(STIFF, modulus=0.9)    # 6 kPa x 1.5 x 0.9 = 8.1 kPa
    row = score(record(answer('nothing_missing', recalibrated={'E_kPa': told(8.31, 8, 9)})), true)
    assert row['outcome'] == 'right'
    assert row['parameter_error_percent'] == pytest.approx(100 * 0.21 / 2.1)
    assert row['interval_holds']


def test_the_second_of_a_list_is_no_top_1_but_a_top_3():
    given = answer('equivalent', cause('gravity', 1, 0.7), cause('backlash', 2, 0.3))
    row = score(record(given), truth(BACKLASH))
    assert (row['outcome'], row['top_1'], row['top_3']) == ('wide', False, True)
    lost = [{'terms': [name]} for name in ('obstacle', 'backlash', 'inclusion')]
    assert rank(record(answer('unexplained', where=[{}], alternatives=lost)), truth(BACKLASH),
                'abstained') == 3


def test_a_null_is_won_by_silence_and_the_unknown_by_abstention():
    assert score(record(SILENT), truth(kind='null'))['top_1']
    assert not score(record(UNEXPLAINED), truth(kind='null'))['top_1']
    strange = truth(effect('air_gap', {'pad': 'pad_1'}), kind='strange', in_catalogue=False)
    assert score(record(UNEXPLAINED), strange)['top_1']
    assert not score(record(SILENT), strange)['top_1']


def test_place_of_a_lump_in_millimetres():
    lump = effect('inclusion', {'centre_mm': [10.0, 0.0, 30.0], 'radius_mm': 10.0, 'ratio': 4.0},
                  place=[0.010, 0.0, 0.030])
    given = answer('named', cause('inclusion'), where=[
        {'term': 'inclusion', 'option': 0, 'position_m': [0.013, 0.004, 0.030],
         'radius_m': 0.01}])
    row = score(record(given), truth(lump))
    assert row['place_error_mm'] == pytest.approx(5.0)
    assert row['place_right']


def test_a_pad_is_the_right_place_by_its_name():
    def place(name):
        where = [{'term': 'backlash', 'option': 0, 'actuator': name}]
        given = answer('named', cause('backlash'), where=where)
        return score(record(given), truth(BACKLASH))['place_right']
    assert place('pad_2')
    assert not place('pad_1')


def test_onset_counts_from_the_start_of_the_bag():
    lost = effect('lost_steps', {'onset_s': 20.0, 'shortfall_mm': 0.6, 'actuators': ['pad_1']},
                  onset=20.0)
    given = answer('named', cause('lost_steps'), when=[
        {'term': 'lost_steps', 'onset_s': [20.4, 20.8], 't_start_s': 20.4, 't_end_s': None}])
    row = score(record(given), truth(lost))
    assert row['onset_error_s'] == pytest.approx(0.1)
    assert row['onset_right']
    slipping = {**lost, 'form': 'slipping', 'same': ['shortfall_mm']}
    assert score(record(given), truth(slipping))['onset_right'] is None


def test_error_of_a_parameter_is_relative_to_its_departure_from_off():
    given = answer('named', cause('backlash', parameters={'width_mm': told(0.23, 0.21, 0.25)}))
    row = score(record(given), truth(BACKLASH))
    assert row['parameter_error_percent'] == pytest.approx(15.0)
    assert row['parameter_right']
    assert not row['interval_holds']
    stiff = effect('skin_layer', {'ratio': 3.0, 'thickness_mm': 2.0})
    given = answer('named', cause('skin_layer', parameters={
        'ratio': told(5.0, 2.0, 8.0), 'thickness_mm': told(1.0, 0.5, 2.5)}))
    row = score(record(given), truth(stiff))
    # (ratio - 1) x thickness is known together only: 4 x 1 for 2 x 2
    assert row['parameter_error_percent'] == pytest.approx(0.0)
    assert row['interval_holds']


def test_what_means_something_else_in_the_law_that_was_planted_does_not_count():
    gap = effect('backlash', {'width_mm': 0.5}, form='rounded', same=[])
    row = score(record(answer('named', cause('backlash', parameters={
        'width_mm': told(0.2, 0.1, 0.3)}))), truth(gap))
    assert (row['outcome'], row['parameter_right'], row['intervals']) == ('right', None, 0)
    assert row['numbers'] == []


def test_a_parameter_that_was_not_told_is_not_right():
    row = score(record(answer('named', cause('backlash'))), truth(BACKLASH))
    assert row['parameter_right'] is False
    assert row['interval_holds'] is False


def test_an_interval_that_is_not_known_does_not_count():
    given = answer('named', cause('backlash', parameters={'width_mm': told(0.23, None, None)}))
    row = score(record(given), truth(BACKLASH))
    assert row['parameter_right']
    assert (row['interval_holds'], row['intervals'], row['intervals_held']) == (None, 0, 0)


def test_each_interval_counts_components_of_vectors_too():
    """A 90 % interval is one of ten times beside the truth, so that all of several seldom hold."""
    force = effect('external_force', {'force_N': [0.2, 0.0, -0.1], 'radius_mm': 8.0})
    given = answer('named', cause('external_force', parameters={'force_N': {
        'value': [0.21, 0.0, 0.1], 'interval_90': [[0.1, -0.1, 0.0], [0.3, 0.1, 0.2]]}}))
    row = score(record(given), truth(force))
    assert (row['intervals'], row['intervals_held']) == (3, 2)
    assert row['interval_holds'] is False
    told_all, = (one for one in shares([row]) if one['what'].startswith('90 % intervals'))
    assert (told_all['count'], told_all['of']) == (2, 3)
    kept, = (one for one in row['numbers'] if one['parameter'] == 'external_force force_N')
    assert kept == {'parameter': 'external_force force_N', 'planted': [0.2, 0.0, -0.1],
                    'told': [0.21, 0.0, 0.1], 'interval_90': [[0.1, -0.1, 0.0], [0.3, 0.1, 0.2]]}


def test_intervals_of_both_causes_of_a_pair_count():
    play, gain = BACKLASH, effect('actuator_gain', {'actuators': ['pad_2'], 'gain': 1.1})
    given = answer('named', cause('backlash', parameters={'width_mm': told(0.2, 0.1, 0.3)}),
                   cause('actuator_gain', parameters={'gain': told(1.2, 1.15, 1.25)}))
    row = score(record(given), truth(play, gain))
    assert (row['intervals'], row['intervals_held']) == (2, 1)
    assert [one['parameter'] for one in row['numbers']] == ['backlash width_mm',
                                                            'actuator_gain gain']


def test_what_is_strange_has_to_be_found_where_and_when_it_is():
    slow = effect('slow_cure', {'onset_s': 30.0, 'pad': 'pad_3'}, onset=30.0,
                  place=[0.05, 0.0, 0.02])

    def row(where, span):
        given = answer('unexplained', where=[where], when=[
            {'t_start_s': span[0], 't_end_s': span[1]}])
        return score(record(given), truth(slow, kind='strange', in_catalogue=False))
    right = row({'stream': 'force', 'channel': 'pad_3'}, (25.0, 60.0))
    assert (right['place_right'], right['onset_right']) == (True, True)
    away = row({'stream': 'force', 'channel': 'pad_1'}, (40.0, 60.0))
    assert (away['place_right'], away['onset_right']) == (False, False)


def test_identifiable_needs_size_and_distance():
    def flag(seen, apart, kind='single'):
        row = score(record(SILENT), truth(BACKLASH, kind=kind),
                    {'detectability_sd': seen, 'separation_sd': apart, 'rival': 'x'})
        return row['identifiable']
    assert flag(6.0, 5.5)
    assert flag(6.0, None)
    assert not flag(4.0, None)
    assert not flag(60.0, 3.0)
    assert flag(6.0, 6.0, kind='confounded') is None
    assert score(record(SILENT), truth(BACKLASH))['identifiable'] is None


def test_confidence_and_first_word():
    given = answer('equivalent', cause('gravity', 1, 0.7), cause('backlash', 2, 0.3))
    assert confidence(record(given)) == 0.7
    assert first_said(record(given)) == 'gravity'
    assert first_said(record(SILENT)) == 'silent'
    assert first_said(record(UNEXPLAINED)) == 'abstained'
    assert first_said(record(None)) == 'failed'
    assert np.isclose(confidence(record(SILENT)), 0.5)
