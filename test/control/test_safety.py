"""What the cell allows: causes latch, the worse wins, only a reset without cause runs again."""

import numpy as np
import pytest

from arm_brachy.control.safety import Permission, Safety


@pytest.mark.parametrize(('note', 'said'), [
    ('doubled', 'two nodes are alive as recorder'),
    ('foreign', 'a stranger publishes what only the cell may: recorder')])
def test_what_should_not_be_there_holds_until_it_is_gone(safety, note, said):
    getattr(safety, note)(('recorder',))
    assert safety.permission is Permission.HOLD and said in safety.reason
    assert safety.reset() == (False, 'still in force: recorder')
    getattr(safety, note)(())
    assert safety.permission is Permission.HOLD
    assert safety.reset() == (True, 'running')


def test_motion_without_permission_stops_and_says_so_in_a_stop_too(safety):
    safety.stop('emergency stop on request')
    safety.breach('pad_1 moved 0.50 mm without permission')
    assert safety.permission is Permission.STOP and 'pad_1 moved' in safety.reason


@pytest.fixture
def safety():
    return Safety(force_limit=30.0)


def test_it_runs_below_the_force_limit_whatever_the_direction(safety):
    for force in ([29.9, 0, 0], [0, -29.9, 0], [17.0, 17.0, 17.0]):  # 29.4 N
        safety.force('pad_1', np.array(force))
    assert safety.permission is Permission.RUN and safety.reason == ''


def test_the_length_of_the_force_counts_and_stops(safety):
    safety.force('pad_2', np.array([18.0, 18.0, 18.0]))  # 31.2 N
    assert safety.permission is Permission.STOP
    assert safety.reason == 'pad_2: force 31.18 N; allowed 30 N'


def test_a_cause_latches_after_it_is_gone(safety):
    safety.force('pad_1', np.array([0.0, 0.0, 40.0]))
    safety.force('pad_1', np.zeros(3))
    assert safety.permission is Permission.STOP
    assert safety.reset() == (True, 'running')
    assert safety.permission is Permission.RUN and safety.reason == ''


def test_reset_is_refused_while_the_cause_lasts(safety):
    safety.force('pad_1', np.array([0.0, 0.0, 40.0]))
    done, said = safety.reset()
    assert not done and 'pad_1' in said
    assert safety.permission is Permission.STOP


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_a_force_that_is_not_finite_holds_and_keeps_holding(safety, value):
    safety.force('pad_3', np.array([value, 0.0, 0.0]))
    assert safety.permission is Permission.HOLD and 'must be finite' in safety.reason
    assert safety.reset()[0] is False
    safety.force('pad_3', np.zeros(3))
    assert safety.reset()[0] is True


def test_silence_holds_until_the_node_is_heard_again(safety):
    safety.silent(['em_tracker'])
    assert safety.permission is Permission.HOLD
    assert safety.reason == 'no sign of life from em_tracker'
    assert safety.reset() == (False, 'still in force: em_tracker')
    safety.silent([])
    assert safety.permission is Permission.HOLD
    assert safety.reset()[0] is True


def test_a_stop_outweighs_a_hold_and_keeps_its_reason(safety):
    safety.hold('first')
    safety.stop('second')
    safety.hold('third')
    assert (safety.permission, safety.reason) == (Permission.STOP, 'second')


def test_the_first_cause_of_a_kind_is_the_one_told(safety):
    safety.hold('first')
    safety.hold('second')
    assert safety.reason == 'first'


def test_it_holds_until_everybody_awaited_has_been_heard():
    safety = Safety(30.0, awaited=('em_tracker', 'actuator_driver'))
    assert safety.permission is Permission.HOLD
    assert safety.reason == 'waiting for actuator_driver, em_tracker'
    assert safety.reset() == (False, 'still in force: actuator_driver, em_tracker')
    safety.heard('em_tracker')
    assert safety.permission is Permission.HOLD
    safety.heard('actuator_driver')
    assert safety.permission is Permission.RUN and safety.reason == ''


def test_a_cause_that_comes_during_the_wait_outlasts_it():
    safety = Safety(30.0, awaited=('em_tracker',))
    safety.stop('on request')
    safety.heard('em_tracker')
    assert (safety.permission, safety.reason) == (Permission.STOP, 'on request')


def test_numbers_are_those_of_the_message():
    assert [int(p) for p in (Permission.RUN, Permission.HOLD, Permission.STOP)] == [0, 1, 2]


def test_probe_and_needle_have_limits_of_their_own():
    safety = Safety(30.0, others={'probe': 10.0})
    safety.force('probe', [9.0])
    assert safety.permission is Permission.RUN
    safety.force('probe', [-11.0])
    assert safety.permission is Permission.STOP and 'probe: force 11.00 N' in safety.reason
    assert not safety.reset()[0]
    safety.force('probe', [1.0])
    assert safety.reset()[0]


def test_old_data_of_the_needle_are_a_hold_until_they_are_new():
    safety = Safety(30.0)
    safety.old('needle', 0.4, 0.5)
    assert safety.permission is Permission.RUN
    safety.old('needle', 0.6, 0.5)
    assert safety.permission is Permission.HOLD
    assert 'needle: last heard 0.60 s ago' in safety.reason
    assert safety.reset() == (False, 'still in force: needle')
    safety.old('needle', 0.0, 0.5)
    assert safety.reset()[0]
