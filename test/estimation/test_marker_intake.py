"""Markers keep their identity through occlusion and swapped labels; outliers go by name."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.estimation.marker_intake import IntakeParams, MarkerIntake

NAMES = ('a', 'b', 'c', 'd', 'e')
REST = np.array([[0, 0, 0], [25, 0, 0], [0, 25, 0], [25, 25, 0], [50, 0, 0]]) * 1e-3
NOISE = 0.03e-3


def moved(q):
    """The model: every marker follows the pad by half."""
    return REST + [0.5 * float(np.sum(q)), 0.0, 0.0]


@pytest.fixture
def intake():
    return MarkerIntake(IntakeParams(), SimpleNamespace(names=NAMES, at=moved))


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def true(q):
    """The plant: a fifth more motion than the model has, and a bit of y."""
    return REST + [0.6 * q, 0.05 * q, 0.0]


def push(intake, rng, steps=30, travel=20e-3, hidden=(), t=0.0):
    """Push in steps of 0.1 s; returns the last Intake."""
    for i in range(steps):
        q = travel * (i + 1) / steps
        points = true(q) + NOISE * rng.standard_normal(REST.shape)
        points[list(hidden)] = np.nan
        out = intake.take(t + 0.1 * i, [q], NAMES, points)
    return out


def test_a_clear_view_is_taken_as_it_is(intake, rng):
    points = REST + NOISE * rng.standard_normal(REST.shape)
    out = intake.take(0.0, [0.0], NAMES, points)
    assert np.array_equal(out.points, points)
    assert (out.rejected, out.swapped, out.labelled) == ((), (), 5)


def test_identity_is_kept_through_a_push_with_one_marker_hidden_all_along(intake, rng):
    intake.take(-0.1, [0.0], NAMES, REST)
    out = push(intake, rng, hidden=[1])
    assert np.isnan(out.points[1]).all() and not out.rejected
    back = intake.take(3.0, [20e-3], NAMES, true(20e-3))
    np.testing.assert_array_equal(back.points, true(20e-3))


def test_swapped_labels_are_put_right_and_named(intake, rng):
    push(intake, rng)
    out = intake.take(3.0, [20e-3], ('b', 'a', 'c', 'd', 'e'), true(20e-3))
    np.testing.assert_array_equal(out.points, true(20e-3))
    assert out.swapped == ('a', 'b') and not out.rejected


def test_a_swap_in_the_very_first_frame_is_seen_too(intake):
    out = intake.take(0.0, [0.0], ('a', 'd', 'c', 'b', 'e'), REST)
    assert out.swapped == ('b', 'd') and np.array_equal(out.points, REST)


def test_points_without_a_label_of_the_scene_find_their_marker(intake, rng):
    push(intake, rng)
    out = intake.take(3.0, [20e-3], ('u1', 'u2', 'c', 'd', 'e'), true(20e-3))
    np.testing.assert_array_equal(out.points, true(20e-3))
    assert not out.swapped and out.labelled == 3


@pytest.mark.parametrize('first', [True, False])
def test_an_outlier_of_20_mm_is_left_out_by_name_for_as_long_as_it_lasts(intake, rng, first):
    if not first:
        push(intake, rng)
    for i in range(100):
        points = true(20e-3 * (not first))
        points[2] += [0.0, 0.0, 20e-3]
        out = intake.take(10.0 + 0.1 * i, [20e-3 * (not first)], NAMES, points)
        assert out.rejected == ('c',) and np.isnan(out.points[2]).all()
        assert np.isfinite(np.delete(out.points, 2, axis=0)).all()
    out = intake.take(30.0, [20e-3 * (not first)], NAMES, true(20e-3 * (not first)))
    assert not out.rejected and np.isfinite(out.points).all()


def test_a_reflection_beside_a_marker_does_not_take_its_place(intake, rng):
    push(intake, rng)
    ghost = true(20e-3)[:1] + [0.0, 0.0, 2.0e-3]
    out = intake.take(3.0, [20e-3], ('ghost', *NAMES), np.vstack([ghost, true(20e-3)]))
    np.testing.assert_array_equal(out.points, true(20e-3))


def test_a_jump_within_the_scene_but_too_fast_is_gated(intake, rng):
    """6 mm in 0.1 s at rest, twice the gate, half of what the first frame may be off."""
    push(intake, rng)
    points = true(20e-3)
    points[4] += [0.0, -6e-3, 0.0]
    assert intake.take(3.0, [20e-3], NAMES, points).rejected == ('e',)


def test_reset_forgets_where_markers_were(intake, rng):
    push(intake, rng)
    intake.reset()
    assert intake.take(5.0, [0.0], NAMES, true(20e-3)).rejected == NAMES


def test_nothing_seen_is_nothing_found(intake):
    out = intake.take(0.0, [0.0], NAMES, np.full((5, 3), np.nan))
    assert np.isnan(out.points).all() and out.labelled == 0
