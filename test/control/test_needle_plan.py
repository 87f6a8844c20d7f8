"""Hole, bevel and goal: against geometry worked out by hand."""

import numpy as np
import pytest

from arm_brachy.control.needle_plan import NeedleCourse, NoPlan, plan
from arm_brachy.core.outcome import Outcome

AXIS, SIDE = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
RADIUS, PITCH = 0.4, 5e-3


def arc(roll, depth):
    """The unicycle model with one side of the bevel."""
    n = np.cos(roll) * SIDE + np.sin(roll) * np.cross(AXIS, SIDE)
    return RADIUS * (np.sin(depth / RADIUS) * AXIS + (1.0 - np.cos(depth / RADIUS)) * n)


def straight(roll, depth):
    return depth * AXIS


def grid(n=5):
    """Holes in the plane x = -0.1, columns along y, rows along z."""
    at = PITCH * (np.arange(n) - (n - 1) / 2)
    return np.array([[(-0.1, y, z) for z in at] for y in at])


def planned(target, offset=arc, length=0.2, axes=(True, True, False), reach=0.008, hole=()):
    return plan(grid(), NeedleCourse(AXIS, SIDE, length, offset), np.array(target, float),
                axes=axes, reach=reach, hole=hole)


def test_a_straight_needle_takes_the_nearest_hole_and_the_pads_do_the_rest():
    found = planned((0.0, 0.004, -0.011), straight)
    assert (found.column, found.row) == (3, 0)
    assert found.goal == pytest.approx([0.0, 0.005, -0.011])     # z is not the pads'
    assert found.left == pytest.approx(0.001) and found.depth == pytest.approx(0.1)


def test_the_tip_is_level_with_the_target_on_the_arc_of_its_side():
    found = planned((0.0, 0.0, 0.0))
    assert found.tip == pytest.approx(found.hole + arc(found.roll, found.depth))
    assert found.tip[0] == pytest.approx(0.0, abs=1e-6)
    assert found.depth > 0.1        # the arc is longer than its chord


def test_the_side_of_the_bevel_takes_what_pads_cannot():
    """Deflection 12.7 mm at 100 mm; a hole misses z by up to 2.5 mm, one of 24 sides does not."""
    found = planned((0.0, 0.0, 0.0023))
    assert found.left < 0.9e-3
    assert (found.goal - [0.0, 0.0, 0.0023])[2] == 0.0


def test_the_goal_moves_across_the_needle_only_and_within_reach():
    for y in np.linspace(-0.01, 0.01, 9):
        found = planned((0.003, y, 0.004))
        moved = found.goal - [0.003, y, 0.004]
        assert abs(moved @ AXIS) < 1e-12 and np.linalg.norm(moved) <= 0.008


@pytest.mark.parametrize(('given', 'outcome', 'said'), [
    ({'length': 0.05}, Outcome.NO_PLAN, 'needle 50 mm long'),
    ({'hole': (5, 0)}, Outcome.NO_PLAN, 'hole 5, 0; the template has columns 0 to 4'),
    ({'hole': (0, 0), 'reach': 1e-4, 'offset': straight}, Outcome.INFEASIBLE, 'allowed 0.1 mm'),
])
def test_what_cannot_be_is_named(given, outcome, said):
    with pytest.raises(NoPlan, match=said) as why:
        planned((0.0, 0.0, 0.0), **given)
    assert why.value.outcome is outcome


def test_a_target_behind_the_template_is_named():
    with pytest.raises(NoPlan, match='20 mm behind the template'):
        planned((-0.12, 0.0, 0.0), straight)
