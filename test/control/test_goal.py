"""Goals: what is refused, and what the three published tasks mean."""

import numpy as np
import pytest

from arm_brachy.control.goal import Goal, GoalKind, task
from arm_brachy.core.errors import CommandRefused

REST = np.array([1.0, 2.0, 3.0])


def test_the_three_published_tasks():
    assert np.allclose(task(1, 't').position(REST) - REST, [-5e-3, 0, 0])
    assert np.allclose(task(2, 't').position(REST) - REST, [0, -5e-3, 0])
    assert np.allclose(task(3, 't').position(REST) - REST, [5e-3, 5e-3, 0])
    assert [task(n, 't').axes for n in (1, 2, 3)] == [
        (True, False, False), (False, True, False), (True, True, False)]


def test_a_position_is_taken_as_it_is_on_controlled_axes_only():
    goal = Goal('t', (9.0, 8.0, np.nan), GoalKind.POSITION, (True, True, False))
    assert np.array_equal(goal.position(REST), [9.0, 8.0, 3.0])


@pytest.mark.parametrize(('value', 'axes', 'said'), [
    ((np.nan, 0, 0), (True, True, False), 'x = nan'),
    ((0, np.inf, 0), (True, True, False), 'y = inf'),
    ((0, 0, 0), (False, False, False), 'no axis'),
    ((0, 0), (True, True, False), '3 entries'),
])
def test_a_goal_nobody_could_act_on_is_refused(value, axes, said):
    with pytest.raises(CommandRefused, match=said):
        Goal('t', value, axes=axes)
