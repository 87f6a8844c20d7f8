"""The published force curve, and the law that is fitted to it."""

import numpy as np
import pytest

from arm_brachy.experiments import needle_force


def test_a_curve_of_the_law_is_recovered():
    true = needle_force.law([0.01, 20.0, 1e4, 0.2, 15.0])
    depth = np.linspace(0.0, 0.027, 80)
    found = needle_force.fit(depth, true.force(depth))
    assert np.allclose(found.force(depth), true.force(depth), atol=5e-3)
    assert found.skin == pytest.approx(true.skin, abs=2e-4)


def test_the_published_curve_is_met_on_points_that_were_held_out(tmp_path):
    result = needle_force.reproduce(tmp_path)
    assert result.targets[0].met and result.targets[0].value <= needle_force.GOAL
    assert (tmp_path / 'needle-force.png').exists() and (tmp_path / 'needle-force.json').exists()
    parts = {row['part']: row for row in result.rows}
    assert parts['parameters']['puncture_N'] == pytest.approx(1.41, abs=0.15)
    assert parts['fitted points']['rmse_N'] < 0.15


def test_the_curve_is_ordered_and_breaks_where_it_is_said_to():
    depth, force = needle_force.published()
    assert np.all(np.diff(depth) >= 0.0) and depth.max() < 0.05
    first = depth < 0.025
    assert depth[first][force[first].argmax()] == pytest.approx(needle_force.RUPTURE)
