"""The clinician's schedule: rest, goal, wait, home, next."""

from types import SimpleNamespace

import pytest

from arm_brachy.control.sequencer import Action, Phase, Sequencer

TICK = 0.1


def tasks(*durations):
    return [SimpleNamespace(duration=d) for d in durations]


def play(sequencer, until, at_home=lambda t, released: True):
    """Step every TICK; returns [(t, action)] without the waiting, and when homing began."""
    said, released = [], None
    for k in range(round(until / TICK) + 1):
        t = k * TICK
        action = sequencer.step(t, at_home(t, released))
        if action is not Action.WAIT:
            said.append((round(t, 6), action))
        released = t if action is Action.RELEASE else released
    return said


def test_one_task_after_another_with_rest_before_each():
    said = play(Sequencer(tasks(3.0, 5.0), 2.0), 13.0)
    first_finish = next(i for i, (_, a) in enumerate(said) if a is Action.FINISH)
    # homing takes one tick here, then 2 s of rest
    assert said[:first_finish + 1] == [
        (2.0, Action.SET_GOAL), (5.0, Action.RELEASE), (7.1, Action.SET_GOAL),
        (12.1, Action.RELEASE), (12.2, Action.FINISH)]
    assert {a for _, a in said[first_finish:]} == {Action.FINISH}


def test_the_next_task_waits_until_the_pads_are_home():
    said = play(Sequencer(tasks(1.0, 1.0), 0.5), 6.0,
                lambda t, released: released is None or t > released + 2.0)
    assert [a for _, a in said[:3]] == [Action.SET_GOAL, Action.RELEASE, Action.SET_GOAL]
    assert said[2][0] - said[1][0] == pytest.approx(2.0 + 0.5, abs=2 * TICK)


def test_whether_the_pads_are_home_matters_in_homing_only():
    assert play(Sequencer(tasks(1.0), 0.5), 1.5, lambda t, released: False) == [
        (0.5, Action.SET_GOAL), (1.5, Action.RELEASE)]


def test_a_homing_that_never_ends_ends_the_sequence():
    sequencer = Sequencer(tasks(1.0, 1.0), 0.0, homing_limit=3.0)
    said = play(sequencer, 6.0, lambda t, released: False)
    assert said[:3] == [(0.0, Action.SET_GOAL), (1.0, Action.RELEASE), (4.1, Action.FINISH)]
    assert sequencer.phase is Phase.FINISHED


def test_without_tasks_it_is_finished_after_the_rest():
    assert play(Sequencer((), 2.0), 2.0) == [(2.0, Action.FINISH)]


def test_time_counts_from_the_first_step():
    sequencer = Sequencer(tasks(1.0), 2.0)
    assert sequencer.step(100.0, True) is Action.WAIT
    assert sequencer.step(101.9, True) is Action.WAIT
    assert sequencer.step(102.0, True) is Action.SET_GOAL
    assert sequencer.index == 0 and sequencer.phase is Phase.ACTIVE


@pytest.mark.parametrize(('tasks_left', 'durations'), [(1, (1.0, 1.0)), (0, (1.0,))])
def test_a_sequence_that_ends_early_says_what_was_left_out(tasks_left, durations):
    sequencer = Sequencer(tasks(*durations), 0.0, homing_limit=3.0)
    assert sequencer.verdict == ''
    play(sequencer, 6.0, lambda t, released: False)
    assert f'{tasks_left} of {len(durations)} tasks not begun' in sequencer.verdict
    good = Sequencer(tasks(*durations), 0.0)
    play(good, 6.0)
    assert good.phase is Phase.FINISHED and good.verdict == ''
