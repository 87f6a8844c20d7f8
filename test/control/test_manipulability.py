"""Positive bases against known geometry, inverse kinematics against brute force."""

import itertools

import numpy as np
import pytest
from scipy.optimize import minimize

from arm_brachy.control import manipulability as man


def fan(*degrees):
    """Unit columns (2, p) at the given angles."""
    a = np.deg2rad(degrees)
    return np.array([np.cos(a), np.sin(a)])


@pytest.mark.parametrize(('angles', 'spans'), [
    ((0, 120, 240), True),
    ((0, 90, 180, 270), True),
    ((0, 90), False),
    ((0, 60, 120), False),
    ((0, 180), False),           # two opposed pads: a line, not the plane
    ((0, 90, 180), False),       # a closed half plane
    ((0, 90, 181), True),        # barely more than a half plane
    ((0, 90, 179), False),
    ((0, 100, 190), True),       # largest gap 170 deg
])
def test_pads_span_the_plane_exactly_if_every_gap_between_them_is_below_180_deg(angles, spans):
    gaps = np.diff([*sorted(angles), sorted(angles)[0] + 360])
    assert (gaps.max() < 180) == spans
    assert man.positive_span(fan(*angles)) == spans


def test_positive_span_does_not_depend_on_the_lengths_of_the_columns():
    J = fan(0, 120, 240) * [1.0, 1e-3, 50.0]
    assert man.positive_span(J)


def test_a_positive_basis_of_the_plane_has_three_or_four_members():
    assert man.is_positive_basis(fan(0, 120, 240))
    assert man.is_positive_basis(fan(0, 90, 180, 270))
    assert not man.is_positive_basis(fan(0, 72, 144, 216, 288))
    assert man.positive_span(fan(0, 72, 144, 216, 288))


def test_the_cone_of_two_pads_is_the_wedge_between_them():
    J = fan(0, 60)
    for angle in range(0, 360, 7):
        assert man.in_cone(J, fan(angle)[:, 0]) == (angle <= 60)


def test_two_opposed_pads_cannot_go_sideways():
    J = fan(0, 180)
    assert not man.in_cone(J, np.array([0.0, 1.0]))
    assert man.in_cone(J, np.array([-3.0, 0.0]))
    assert np.allclose(man.inverse_kinematics(J, np.array([0.0, 5e-3])), 0.0)


def test_three_dimensions_need_four_pads():
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]).T / np.sqrt(3)
    assert man.is_positive_basis(corners)
    assert not man.positive_span(corners[:, :3])


def brute_force(J, p):
    """Nearest point of the cone by trying every subset of at most m pads (Caratheodory)."""
    best = np.linalg.norm(p), 0.0
    for size in range(1, J.shape[0] + 1):
        for subset in itertools.combinations(range(J.shape[1]), size):
            q = np.linalg.lstsq(J[:, subset], p, rcond=None)[0]
            if np.all(q >= -1e-12):
                best = min(best, (np.linalg.norm(p - J[:, subset] @ q), q.sum()),
                           key=lambda c: (round(c[0], 12), c[1]))
    return best


def test_inverse_kinematics_is_the_nearest_point_with_the_least_travel_of_all_subsets():
    rng = np.random.default_rng(4)
    for _ in range(60):
        m, p = rng.integers(1, 3), rng.integers(2, 6)
        J, goal = rng.normal(size=(m, p)), rng.normal(size=m) * 5e-3
        q = man.inverse_kinematics(J, goal)
        distance, travel = brute_force(J, goal)
        assert np.all(q >= 0.0)
        assert np.linalg.norm(goal - J @ q) == pytest.approx(distance, abs=1e-9)
        assert q.sum() == pytest.approx(travel, rel=1e-6, abs=1e-9)


def test_inverse_kinematics_agrees_with_a_general_optimiser():
    J, goal = fan(10, 100, 200, 280) * 0.4, np.array([3e-3, -4e-3])
    q = man.inverse_kinematics(J, goal)
    free = minimize(lambda z: 1e6 * np.sum((goal - J @ z * 1e-3)**2) + 1e-6 * z.sum(),
                    np.ones(4), bounds=[(0, None)] * 4, tol=1e-14)
    assert np.allclose(q, free.x * 1e-3, atol=2e-5)


def test_index_is_the_gain_of_the_one_pad_that_points_along_the_task():
    J = fan(0, 90, 180, 270) * [0.5, 0.4, 0.3, 0.2]
    assert man.index(J, np.array([-5e-3, 0.0])) == pytest.approx(0.3)
    # along the diagonal both pads work: sqrt(2) d over d / 0.5 + d / 0.4
    assert man.index(J, np.array([5e-3, 5e-3])) == pytest.approx(np.sqrt(2) / (2 + 2.5))


def test_index_does_not_depend_on_how_far_and_is_zero_where_no_pad_helps():
    J = fan(0, 120, 240)
    far, near = (man.index(J, np.array([d, 2 * d])) for d in (5e-3, 5e-5))
    assert far == pytest.approx(near, rel=1e-9)
    assert man.index(fan(0, 180), np.array([0.0, 5e-3])) == 0.0


def test_relaxing_an_axis_never_costs_travel():
    rng = np.random.default_rng(9)
    J = rng.normal(size=(20, 3, 4))
    goal = np.array([-5e-3, 0.0, 0.0])
    relaxed, share = man.index_map(J, goal, (True, False, False))
    strict, share_strict = man.index_map(J, goal, (True, True, False))
    full = (share > 1 - 1e-9) & (share_strict > 1 - 1e-9)
    assert full.any()
    assert np.all(relaxed[full] >= strict[full] - 1e-9)
