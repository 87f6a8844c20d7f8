"""What an answer is worth beside what was planted: words, places, onsets, parameters."""

import numpy as np
import pytest

from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.results.parts import Interval, Place, StreamFit
from arm_brachy.experiments.diagnosis_score import all_hold, score

MM = 1e-3


@pytest.fixture
def judged(label, answer):
    """Function: name of what is planted, what `answer` takes -> row."""
    return lambda name, *said, **more: score(
        label(name), {'cpu_s': 1.0, 'answer': answer(*said, **more)})


def test_right_is_the_planted_term_alone(judged):
    gain = Cause('actuator_gain')
    assert judged('actuator_gain', 'named', gain)['outcome'] == 'right'
    assert judged('backlash', 'named', gain)['outcome'] == 'wrong'
    assert judged('actuator_gain', 'named', gain, Cause('gravity'))['outcome'] == 'wrong'
    assert judged('actuator_gain', 'nothing_missing')['outcome'] == 'silent'
    assert judged('actuator_gain', 'unexplained')['outcome'] == 'abstained'
    assert judged('actuator_gain', 'unexplained', Cause('gravity'))['outcome'] == 'wrong'


def test_a_class_counts_if_it_says_so_and_theory_does(judged):
    def either(*names):
        return ['equivalent', *(Cause(n, probability=0.5, option=i + 1)
                                for i, n in enumerate(names))]

    assert judged('actuator_gain', *either('actuator_compliance', 'actuator_gain'))[
        'outcome'] == 'class'
    assert judged('actuator_gain', 'named', Cause('actuator_compliance'))['outcome'] == 'wrong'
    assert judged('actuator_gain', *either('gravity', 'actuator_gain'))['outcome'] == 'wide'
    assert judged('backlash', *either('actuator_compliance', 'actuator_gain'))[
        'outcome'] == 'wrong'
    row = judged('actuator_gain', *either('actuator_gain', 'discretisation'))
    assert row['outcome'] == 'wide'


def test_nulls_and_what_does_nothing_want_silence(judged):
    for name in (None, 'damping', 'actuator_lag', 'point_mass'):
        assert judged(name, 'nothing_missing')['outcome'] == 'silent'
        assert judged(name, 'named', Cause('gravity'))['outcome'] == 'wrong'
        assert judged(name, 'unexplained')['outcome'] == 'abstained'
    assert judged('damping', 'named', Cause('damping'))['outcome'] == 'wrong'
    assert judged(None, 'named', Cause('discretisation'))['outcome'] == 'silent'


def test_a_modulus_is_found_by_recalibration(judged):
    """Planted: 6 kPa x 1.2 = 7.2 kPa; 20 % of the 1.2 kPa that it departs by are 0.24 kPa."""
    for told, worth in ((7.1e3, 'right'), (7.5e3, 'silent')):
        row = judged('stiffness_scale', 'nothing_missing',
                     recalibrated={'E': Estimate(told, told - 200.0, told + 200.0)})
        assert row['outcome'] == worth
    row = judged('stiffness_scale', 'nothing_missing',
                 recalibrated={'E': Estimate(7.1e3, 6.9e3, 7.3e3)})
    assert row['parameter_error_percent'] == pytest.approx(100.0 * 0.1 / 1.2)
    assert row['interval_holds']
    assert judged('stiffness_scale', 'nothing_missing')['outcome'] == 'silent'


def test_parameters_are_judged_by_their_departure_from_off(judged):
    """Compressibility 0.3 is 0.7 from off: 0.37 is 10 % wrong."""
    row = judged('compressibility', 'named',
                 Cause('compressibility', {'factor': Estimate(0.37, 0.31, 0.45)}))
    assert row['parameter_error_percent'] == pytest.approx(10.0)
    assert row['parameter_right'] and not row['interval_holds']
    row = judged('base_compliance', 'named', Cause('base_compliance', {
        'normal': Estimate(1.3e6, 0.5e6, np.inf), 'tangential': Estimate(1e6, 0.5e6, np.inf)}))
    assert row['parameter_error_percent'] == pytest.approx(30.0) and row['interval_holds']
    assert not judged('backlash', 'named', Cause('backlash'))['parameter_right']


def test_vectors_are_judged_by_length_of_the_difference(named, judged):
    true = np.array(named('gravity').planted.term.added)
    across = np.cross(true, [0.0, 0.0, 1.0]) * 0.15
    told = tuple(true + across)
    row = judged('gravity', 'named', Cause('gravity', {'added': Estimate(
        told, tuple(np.array(told) - 1.0), tuple(np.array(told) + 1.0))}))
    assert row['parameter_error_percent'] == pytest.approx(15.0) and row['interval_holds']


def test_a_lump_is_known_by_its_product(named, judged):
    """Radius 8 mm, ratio 5: V (c - 1) / (3 + 2 c) = 4/13; rigid, at 1/2, it needs 8/13 of V."""
    centre = named('inclusion').planted.term.centre
    radius = 8 * MM * (8.0 / 13.0) ** (1.0 / 3.0)
    lump = Cause('inclusion', {'centre': Estimate(centre, centre, centre),
                               'radius': Estimate(radius, radius, radius),
                               'ratio': Estimate(99.9, 2.0, 100.0)})
    row = judged('inclusion', 'named', lump, where=(
        Place(position=tuple(np.array(centre) + [3 * MM, 0.0, 4 * MM]), radius=5 * MM,
              term='inclusion'),))
    assert row['parameter_error_percent'] < 3.0 and row['interval_holds']
    assert row['place_error_mm'] == pytest.approx(5.0) and row['place_right']
    assert not judged('inclusion', 'named', lump)['place_right']


def test_place_and_onset_are_the_planted_ones(label, judged):
    fault = label('lost_steps')
    pad = f'pad_{fault["place"]["actuators"][0] + 1}'
    onset = fault['place']['onset']
    row = judged('lost_steps', 'named', Cause('lost_steps', {'onset': Estimate(
        onset + 3.0, onset, onset + 6.0)}), where=(Place(actuator=pad, term='lost_steps'),),
        when=(Interval('r', 0.0, 80.0, onset=(onset - 0.1, onset + 0.3), term='lost_steps'),))
    assert row['place_right'] and row['onset_right']
    assert row['onset_error_s'] == pytest.approx(0.1)
    row = judged('lost_steps', 'named', Cause('lost_steps'), where=(
        Place(actuator='pad_4', term='lost_steps'),))
    assert row['place_right'] is False and row['onset_right'] is False
    row = judged('clock_offset', 'named', Cause('clock_offset'), where=(
        Place(stream=label('clock_offset')['place']['stream'], term='clock_offset'),))
    assert row['place_right'] and row['onset_right'] is None


def test_the_error_is_the_worst_streams_over_its_floor(judged):
    fit = (StreamFit('optical', 0.6 * MM, 0.4 * MM, 0.15 * MM, 0.18 * MM),
           StreamFit('force', 0.3, 0.1, 0.03, 0.033))
    row = judged('backlash', 'named', Cause('backlash'), fit=fit)
    assert row['error_over_floor'] == pytest.approx(1.2)


def test_intervals_that_are_not_known_hold_nothing_and_miss_nothing():
    width, force = [0.1, 0.3], [[None, None, None], [None, None, None]]
    true = {'width_mm': 0.2, 'force_N': (0.1, 0.0, 0.2)}
    assert all_hold({'width_mm': width, 'force_N': force}, true) is True
    assert all_hold({'width_mm': [0.1, 0.15], 'force_N': force}, true) is False
    assert all_hold({'width_mm': [None, None], 'force_N': force}, true) is None
    assert all_hold({'force_N': force}, true) is False      # a width that was not told
    assert all_hold({'width_mm': [0.1, None]}, {'width_mm': 0.2}) is True
