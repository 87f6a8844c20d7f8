"""The published table: complete, and consistent with the unit it is read in."""

import math

import pytest

from arm_brachy.evaluation.thesis import TABLE_3_1, published_task


def test_fifteen_rows_of_five_targets_and_three_tasks():
    keys = [(row.target, row.task) for row in TABLE_3_1]
    assert keys == [(target, task) for target in range(1, 6) for task in range(1, 4)]


def test_closed_loop_is_published_as_better_everywhere():
    assert all(row.closed_loop_itae_mm_s2 < row.open_loop_itae_mm_s2 for row in TABLE_3_1)
    assert all(math.isnan(row.closed_loop_steady_state_error_mm) for row in TABLE_3_1)


def test_extremes_are_those_the_text_allows():
    opened = [row.open_loop_itae_mm_s2 for row in TABLE_3_1]
    assert (min(opened), max(opened)) == (342.52, 1360.5)


def test_in_mm_s2_every_row_means_a_task_of_half_a_minute_to_a_minute():
    for row in TABLE_3_1:
        seconds = math.sqrt(2 * row.open_loop_itae_mm_s2 / row.open_loop_steady_state_error_mm)
        assert 30.0 < seconds < 60.0


def test_lookup():
    assert published_task(3, 1).open_loop_steady_state_error_mm == 2.42
    with pytest.raises(KeyError):
        published_task(6, 1)
