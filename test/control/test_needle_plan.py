"""Hole, bevel and goal: against geometry worked out by hand."""

import numpy as np
import pytest

from arm_brachy.control.needle_plan import NeedleCourse, NoPlan, plan, unlike
from arm_brachy.core.outcome import Outcome

AXIS, SIDE = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
RADIUS, PITCH = 0.4, 5e-3


def arc(roll, depth, turn=np.inf):
    """The unicycle model with one side of the bevel, and the other from a depth `turn` on."""
    n = np.cos(roll) * SIDE + np.sin(roll) * np.cross(AXIS, SIDE)
    way, at, a = np.zeros(3), AXIS, n
    for length, side in ((min(depth, turn), 1.0), (max(depth - turn, 0.0), -1.0)):
        angle, b = length / RADIUS, side * a
        way = way + RADIUS * (np.sin(angle) * at + (1.0 - np.cos(angle)) * b)
        at, a = (np.cos(angle) * at + np.sin(angle) * b,
                 side * (np.cos(angle) * b - np.sin(angle) * at))
    return way


def straight(roll, depth, turn=np.inf):
    return depth * AXIS


def grid(n=5):
    """Holes in the plane x = -0.1, columns along y, rows along z."""
    at = PITCH * (np.arange(n) - (n - 1) / 2)
    return np.array([[(-0.1, y, z) for z in at] for y in at])


def planned(target, offset=arc, length=0.2, axes=(True, True, False), reach=0.008, hole=(),
            unturned=None, miss=np.inf):
    return plan(grid(), NeedleCourse(AXIS, SIDE, length, offset), np.array(target, float),
                axes=axes, reach=reach, miss=miss, hole=hole, unturned=unturned)


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
    """Deflection 12.7 mm at 100 mm; a hole misses z by up to 2.5 mm, one of 72 sides does not."""
    found = planned((0.0, 0.0, 0.0023))
    assert found.left < 0.9e-3
    assert (found.goal - [0.0, 0.0, 0.0023])[2] == 0.0


def test_a_needle_that_is_turned_over_ends_on_the_axis_of_its_hole_however_it_bends():
    """At 0.29 of its way, sqrt(1/2) of it before the end: for every radius, by integration."""
    found = planned((0.0, 0.0, 0.0), unturned=0.02, hole=(2, 2))
    assert found.turn == pytest.approx((1.0 - np.sqrt(0.5)) * found.depth, abs=2e-3)
    assert found.left < 0.2e-3 and found.spread < 0.2e-3
    assert found.path[0] == pytest.approx(found.hole)
    assert found.path[-1] == pytest.approx(found.tip)
    for radius in (0.2, 0.65):
        side, slope, steps = 0.0, 0.0, 2000
        for s in (np.arange(steps) + 0.5) * found.depth / steps:
            slope += (1.0 if s < found.turn else -1.0) * found.depth / steps / radius
            side += np.sin(slope) * found.depth / steps
        assert abs(side) < 1e-3 < 0.5 * found.depth**2 / radius - 1e-3


def test_a_plan_weighs_what_bending_gains_against_how_unlike_needles_bend():
    """2.3 mm off its hole: less than the 12.7 mm that one arc gives, by how late it is turned."""
    found, bent = (planned((0.0, 0.0, 0.0023), unturned=u, hole=(2, 2)) for u in (0.02, None))
    assert found.left < 0.5e-3 and found.spread < 0.9e-3
    assert bent.turn == np.inf and bent.spread > 4e-3
    aside = abs((found.tip - found.hole)[2])
    assert found.spread == pytest.approx(0.85 * RADIUS * aside, rel=0.05)


def test_a_needle_that_goes_straight_to_the_skin_is_turned_over_the_later():
    """0.29 of its way in the tissue, and never before the skin: by integration again."""
    skin = 0.03

    def course(roll, depth, turn=np.inf):
        inside = arc(roll, max(depth - skin, 0.0), max(turn - skin, 0.0))
        return min(depth, skin) * AXIS + inside
    needle = NeedleCourse(AXIS, SIDE, 0.2, course, 1.0 / RADIUS, skin)
    found = plan(grid(), needle, np.zeros(3), axes=(True, True, False), reach=0.008, hole=(2, 2),
                 unturned=0.02)
    assert found.turn == pytest.approx(skin + (1.0 - np.sqrt(0.5)) * 0.07, abs=2e-3)
    assert found.spread < 0.1e-3 and found.left < 0.1e-3
    assert unlike(found.depth, 0.0, skin) == pytest.approx(-0.5 * 0.07**2, rel=0.01)


@pytest.mark.parametrize('axis', [(1.0, 0.0, -0.5), (1.0, 0.0, 1.0)])
def test_under_a_slanted_template_goal_and_tip_still_meet(axis):
    """Pads along x and y span the plane across the needle: nothing is left, level with the tip."""
    axis = np.array(axis) / np.linalg.norm(axis)
    side = np.cross(np.array([0.0, 1.0, 0.0]), axis)
    needle = NeedleCourse(axis, side, 0.2, lambda roll, depth, turn=np.inf: depth * axis)
    holes = np.array([[-0.1 * axis + y * np.array([0.0, 1.0, 0.0]) + z * side
                       for z in (-5e-3, 0.0, 5e-3)] for y in (-5e-3, 0.0, 5e-3)])
    found = plan(holes, needle, np.array([0.001, 0.002, -0.001]), axes=(True, True, False),
                 reach=0.02, hole=(2, 2))
    assert np.allclose(found.tip, found.goal, atol=1e-9) and found.left < 1e-9
    assert found.goal[2] == -0.001


def test_the_goal_moves_across_the_needle_only_and_within_reach():
    for y in np.linspace(-0.01, 0.01, 9):
        found = planned((0.003, y, 0.004))
        moved = found.goal - [0.003, y, 0.004]
        assert abs(moved @ AXIS) < 1e-12 and np.linalg.norm(moved) <= 0.008


def test_of_a_column_the_row_that_comes_nearest_is_taken():
    for row, place in enumerate(grid()[1]):
        found = planned(place - place * AXIS + [0.0, 0.0, 0.002], straight, hole=(1,))
        assert (found.column, found.row) == (1, row)


@pytest.mark.parametrize(('given', 'outcome', 'said'), [
    ({'length': 0.05}, Outcome.NO_PLAN, 'needle 50 mm long'),
    ({'hole': (5, 0)}, Outcome.NO_PLAN, 'hole 5, 0; the template has columns 0 to 4'),
    ({'hole': (0, 0), 'reach': 1e-4, 'offset': straight}, Outcome.INFEASIBLE, 'allowed 0.1 mm'),
    ({'hole': (2, 4), 'offset': straight, 'miss': 9e-3}, Outcome.INFEASIBLE,
     'would pass the target by 10.0 mm, .* allowed 9 mm: choose another hole'),
])
def test_what_cannot_be_is_named(given, outcome, said):
    with pytest.raises(NoPlan, match=said) as why:
        planned((0.0, 0.0, 0.0), **given)
    assert why.value.outcome is outcome


@pytest.mark.parametrize(('miss', 'column'), [(np.inf, 0), (2.2e-3, 0), (2.0e-3, 1)])
def test_a_path_that_passes_by_too_far_is_not_taken_though_the_pads_would_do_less(miss, column):
    """Straight: hole 0 passes by 2.1 mm, the pads at rest; hole 1 by 1 mm, after a push of 15."""
    holes = np.array([[(-0.1, 0.0, 2.1e-3)], [(-0.1, 15e-3, 1e-3)]])
    found = plan(holes, NeedleCourse(AXIS, SIDE, 0.2, straight), np.zeros(3),
                 axes=(True, True, False), reach=0.02, miss=miss)
    assert found.column == column and found.left <= miss


def test_a_target_behind_the_template_is_named():
    with pytest.raises(NoPlan, match='20 mm behind the template'):
        planned((-0.12, 0.0, 0.0), straight)


def test_a_needle_that_bends_too_much_to_get_there_is_named():
    def bent(roll, depth, turn=np.inf):
        return 0.05 * np.array([np.sin(depth / 0.05), 0.0, 1.0 - np.cos(depth / 0.05)])
    with pytest.raises(NoPlan, match='does not get 100 mm far along its hole'):
        plan(grid(), NeedleCourse(AXIS, SIDE, 0.5, bent, 20.0), np.zeros(3),
             axes=(True, True, False), reach=0.02)


def test_the_tip_is_level_with_the_target_also_where_the_needle_bends_much():
    course = NeedleCourse(AXIS, SIDE, 0.5, lambda r, s, u: 0.12 * np.array(
        [np.sin(s / 0.12), 0.0, 1.0 - np.cos(s / 0.12)]), 1.0 / 0.12)
    depth = course.depth_at(np.zeros(3), np.array([0.1, 0.0, 0.0]))
    assert depth == pytest.approx(0.12 * np.arcsin(0.1 / 0.12), abs=2e-6)
