"""A move is over when the target rests: at its goal, at the closest place, or when time is up."""

import numpy as np
import pytest

from arm_brachy.control.arrival import Arrival
from arm_brachy.control.loop import ManipulatorStep
from arm_brachy.core.outcome import Outcome


def step(t, reached, settled=False, message=''):
    z = np.zeros(3)
    return ManipulatorStep(t, z.copy(), Outcome.OK, z.copy(), z.copy(), z.copy(), 0.0,
                           np.zeros((3, 3)), z.copy(), z.copy(), reached, settled,
                           message=message)


def ending(arrival, reached, period=0.1, **kwargs):
    """(time, Ending) of a move whose steps are within the dead band or not."""
    for k, inside in enumerate(reached):
        found = arrival.judge(step(k * period, inside, **kwargs), True)
        if found is not None:
            return k * period, found
    return None


def test_the_time_in_the_dead_band_counts_from_where_it_came_in_last():
    t, found = ending(Arrival(settle=0.5), [False, True, True, False] + 10 * [True])
    assert found.reached and t == pytest.approx(0.4 + 0.5)


def test_it_is_given_up_when_its_time_is_over_and_not_before():
    t, found = ending(Arrival(timeout=2.0), 100 * [False], message='a pad does not follow')
    assert not found.reached and t == pytest.approx(2.0)
    assert 'a pad does not follow' in found.message
    assert ending(Arrival(), 1000 * [False]) is None


def test_out_of_reach_it_ends_where_the_loop_rests():
    far = 'pad_1 is at its end'
    assert ending(Arrival(unreachable=far), 50 * [False]) is None
    t, found = ending(Arrival(unreachable=far), [False], settled=True)
    assert not found.reached and far in found.message
    assert ending(Arrival(), 50 * [False], settled=True) is None    # within reach it goes on


def test_a_goal_that_somebody_dropped_is_no_success():
    found = Arrival(settle=0.0).judge(step(0.0, True, message='HOLD says the supervisor'), False)
    assert not found.reached and 'HOLD' in found.message
