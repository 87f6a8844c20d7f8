"""Numbers that stand for "not measured" are found, and measurements like them are left alone."""

import numpy as np
import pytest

from arm_brachy.recording.stand_ins import without_stand_ins

ROWS = 200


@pytest.fixture
def walk():
    """One point (n, 1, 3) [mm] that goes 30 mm about a place 50 mm from the origin, with noise."""
    t = np.linspace(0.0, 2.0 * np.pi, ROWS)
    rng = np.random.default_rng(1)
    path = np.stack([40.0 + 10.0 * np.sin(t), 20.0 + 0.0 * t, 30.0 + 5.0 * np.cos(t)], axis=1)
    return (path + rng.normal(0.0, 0.05, path.shape))[:, None]


def taken(found):
    return np.flatnonzero(np.isnan(found.values).any(axis=(1, 2)))


@pytest.mark.parametrize('number', [-3.697314e28, 1e38, 3.4028235e38, -9999.0, 999999.0, 0.0])
def test_a_point_of_one_number_is_a_gap(walk, number):
    walk[50:60] = walk[120] = number
    found = without_stand_ins(walk, points=True)
    np.testing.assert_array_equal(taken(found), [*range(50, 60), 120])
    assert sum(len(rows) for _, _, rows in found.found) == 11


@pytest.mark.parametrize('number', [-3.697314e28, -9999.0])
def test_one_axis_is_enough_where_no_measurement_can_be(walk, number):
    walk[7, 0, 1] = number
    np.testing.assert_array_equal(taken(without_stand_ins(walk, points=True)), [7])


def test_nothing_is_taken_of_what_was_measured(walk):
    walk[100, 0, 1] = 0.0       # one axis of three
    for values in (walk, walk - walk[:1], 1e4 + walk):
        assert not without_stand_ins(values, points=True).found


def test_a_code_within_the_range_of_a_channel_is_a_measurement():
    """999 counts of an encoder that goes from 0 to 2000, or a place 999 mm from the tracker."""
    ramp = np.arange(2000.0)[:, None, None]
    assert not without_stand_ins(ramp).found
    ramp[5] = -9999.0
    assert not without_stand_ins(ramp).found    # 5 spans away only: told by `codes`
    np.testing.assert_array_equal(taken(without_stand_ins(ramp, codes=(-9999.0,))), [5])


def test_a_point_that_walks_to_the_origin_is_there(walk):
    """Displacements begin at 0 0 0; a marker may be the origin of its tracker."""
    steps = np.cumsum(np.full((ROWS, 1, 3), 0.1), axis=0)
    steps[:30] = 0.0
    steps[30:] -= steps[30] - 0.1
    found = without_stand_ins(steps, points=True)
    assert not found.found and len(found.kept[0][1]) == 30
    walk[5] = 0.0
    assert not without_stand_ins(walk, points=True, zeros='place').found


def test_a_point_that_is_always_at_zero_was_never_seen(walk):
    found = without_stand_ins(0.0 * walk, points=True)
    assert len(taken(found)) == ROWS


def test_zero_is_a_travel_and_a_force():
    values = np.zeros((20, 2, 3))
    values[10:] = 5.0
    assert not without_stand_ins(values).found


def test_every_other_row_lost_leaves_the_rest(walk):
    walk[::2] = 0.0
    np.testing.assert_array_equal(taken(without_stand_ins(walk, points=True)),
                                  np.arange(0, ROWS, 2))
