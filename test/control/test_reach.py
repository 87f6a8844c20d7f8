"""Closest reachable point and its reason, against geometry and a general solver."""

import numpy as np
import pytest
from scipy.optimize import minimize

from arm_brachy.control.reach import Limit, bounded_least_squares, closest_reachable

NAMES = ('left', 'right', 'top', 'bottom')
CROSS = 0.5 * np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0]])
STROKE = np.full(4, 30e-3)


def reach(J, goal, q=None, stroke=STROKE, names=NAMES, **options):
    q = np.zeros(J.shape[1]) if q is None else q
    return closest_reachable(J, np.asarray(goal), q, stroke[:J.shape[1]], names[:J.shape[1]],
                             **options)


def test_four_crossed_pads_reach_every_direction():
    for angle in np.linspace(0.0, 2 * np.pi, 25):
        goal = 5e-3 * np.array([np.cos(angle), np.sin(angle)])
        answer = reach(CROSS, goal)
        assert answer.feasible and answer.limit is Limit.NONE
        assert np.allclose(answer.displacement, goal, atol=1e-9)


def test_two_opposed_pads_cannot_go_sideways_and_say_so():
    answer = reach(CROSS[:, :2], [3e-3, 4e-3])
    assert answer.limit is Limit.CONE
    assert np.allclose(answer.displacement, [3e-3, 0.0], atol=1e-9)
    assert answer.shortfall == pytest.approx(4e-3)
    assert 'left, right' in answer.explanation
    assert '(+0.00, +1.00)' in answer.explanation
    assert '4.00 mm short' in answer.explanation
    assert '\n' not in answer.explanation


def test_a_spent_stroke_is_named_with_its_pad_and_what_is_missing():
    answer = reach(CROSS, [5e-3, 0.0], q=np.array([25e-3, 0.0, 0.0, 0.0]))
    assert answer.limit is Limit.STROKE
    assert answer.pads == ('left',)
    assert answer.displacement[0] == pytest.approx(2.5e-3)  # 5 mm of stroke at gain 0.5
    assert 'left' in answer.explanation


def test_a_pad_at_the_very_end_of_its_stroke_gives_nothing():
    answer = reach(CROSS, [5e-3, 0.0], q=np.array([30e-3, 0.0, 0.0, 0.0]))
    assert answer.limit is Limit.STROKE
    assert np.allclose(answer.displacement, 0.0)


def test_speed_limits_only_what_a_given_time_allows():
    inside = reach(CROSS, [5e-3, 0.0], max_speed=5e-3, time=2.1)
    short = reach(CROSS, [5e-3, 0.0], max_speed=5e-3, time=1.0)
    assert inside.feasible
    assert short.limit is Limit.SPEED and short.pads == ('left',)
    assert short.displacement[0] == pytest.approx(2.5e-3)


def test_retraction_opens_the_way_back_but_not_beyond_rest():
    J = CROSS[:, :1]
    back = reach(J, [-2e-3, 0.0], q=np.array([10e-3]), retraction=True)
    assert back.feasible and back.travel[0] == pytest.approx(-4e-3)
    past = reach(J, [-2e-3, 0.0], q=np.array([1e-3]), retraction=True)
    assert past.limit is Limit.STROKE
    assert past.displacement[0] == pytest.approx(-0.5e-3)
    assert reach(J, [-2e-3, 0.0], q=np.array([10e-3])).limit is Limit.CONE


def test_bounded_least_squares_agrees_with_a_general_optimiser():
    rng = np.random.default_rng(2)
    for _ in range(20):
        J, goal = rng.normal(size=(2, 4)), rng.normal(size=2)
        high = rng.uniform(0.0, 1.0, size=4) * (rng.random(4) > 0.25)
        q = bounded_least_squares(J, goal, np.zeros(4), high)
        other = minimize(lambda z, J=J, g=goal: np.sum((J @ z - g)**2), high / 2,
                         bounds=list(zip(np.zeros(4), high, strict=True)), tol=1e-14)
        assert np.all((q >= 0.0) & (q <= high))
        assert np.sum((J @ q - goal)**2) <= other.fun + 1e-9
