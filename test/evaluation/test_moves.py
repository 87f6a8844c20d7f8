"""Windows of moves from what was said of them, and their numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.evaluation.moves import move_metrics, move_rows, move_windows
from arm_brachy.evaluation.timeseries import MoveWindow, Regime, RunData, Series

IDLE, HOMING, ACTIVE, DONE, REFUSED, FINISHED = range(6)


def events(*said):
    return [SimpleNamespace(t=t, status=status, name=name, message=message)
            for t, status, name, message in said]


def test_a_window_is_cut_into_the_phases_that_were_said():
    found = move_windows(events(
        (0.1, IDLE, '', 'rest'), (2.0, ACTIVE, 'a', 'load'), (3.0, ACTIVE, 'a', 'hold'),
        (4.0, DONE, 'a', ''), (4.0, ACTIVE, 'b', 'unload'), (5.0, ACTIVE, 'b', 'rest'),
        (6.0, REFUSED, 'b', 'blocked'), (6.0, HOMING, '', ''), (7.0, IDLE, '', 'rest'),
        (8.0, FINISHED, '', '1 of 2')))
    assert found == (
        MoveWindow('a', 2.0, 4.0, (Regime('load', 2.0, 3.0), Regime('hold', 3.0, 4.0)), True),
        MoveWindow('b', 4.0, 6.0, (Regime('unload', 4.0, 5.0), Regime('rest', 5.0, 6.0)), False,
                   'blocked'))


def test_an_interruption_is_part_of_its_move():
    window, = move_windows(events(
        (2.0, ACTIVE, 'a', 'load'), (2.5, IDLE, 'a', 'held'), (9.0, ACTIVE, 'a', 'load'),
        (9.5, ACTIVE, 'a', 'hold'), (10.0, DONE, 'a', '')))
    assert [(r.name, r.t_end - r.t_start) for r in window.regimes] == [
        ('load', 0.5), ('held', 6.5), ('load', 0.5), ('hold', 0.5)]


def test_a_move_that_is_not_over_has_no_window():
    assert move_windows(events((2.0, ACTIVE, 'a', 'load'), (3.0, ACTIVE, 'a', 'hold'))) == ()
    assert move_windows([]) == ()


@pytest.fixture
def bare():
    return RunData('x', '', 0, '', '')


def test_numbers_of_a_triangle(bare):
    """Pad 1 to 6 mm and back, pad 2 stands at 2 mm; force 500 N/m."""
    t = np.linspace(0.0, 4.0, 81)
    q = np.stack([6e-3 * (1 - np.abs(t - 2) / 2), np.full_like(t, 2e-3)], axis=1)
    force = np.zeros((*q.shape, 3))
    force[:, :, 1] = 500.0 * q
    run = RunData('x', '', 0, '', '', encoder=Series(t, q), force=Series(t, force))
    numbers = move_metrics(run, MoveWindow('a', 1.0, 4.0, (), True))
    row, = move_rows([numbers])
    assert row == {'move': 'a', 'duration_s': 3.0, 'deepest_mm': pytest.approx(6.0),
                   'pad_travel_mm': pytest.approx(9.0), 'peak_force_N': pytest.approx(3.0),
                   'made': True}


def test_what_was_not_recorded_is_not_guessed(bare):
    row, = move_rows([move_metrics(bare, MoveWindow('a', 1.0, 4.0, (), False))])
    assert all(np.isnan(row[key]) for key in ('deepest_mm', 'pad_travel_mm', 'peak_force_N'))
    assert row['made'] is False
