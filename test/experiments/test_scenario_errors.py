"""Figures 5.11 and 5.12 on made-up scores: what is averaged and what is claimed."""

import numpy as np
import pytest

from arm_brachy.experiments import figure_5_11, figure_5_12, inside_plants, scenario_errors
from arm_brachy.experiments.inside_study import Scores

DEPTH = np.array([5e-3, 10e-3, 15e-3, 20e-3])


@pytest.fixture
def done():
    """Two plants; the error grows with the push, on the second plant three times as fast."""
    share = {'open_loop': 0.1, 'kf_admm': 0.05, 'graph_vae': 0.02, 'pod': 0.01}
    return {(name, 19, plant): Scores(DEPTH, np.tile((k * s * DEPTH)[:, None, None], (1, 2, 5)),
                                      np.full((4, 2, 5), np.nan), np.ones(3))
            for plant, k in (('a', 1.0), ('b', 3.0)) for name, s in share.items()}


@pytest.mark.parametrize('module', [figure_5_11, figure_5_12])
def test_rows_are_means_over_plants_at_each_push(module, done, tmp_path):
    result = module.reproduce(tmp_path, done=done)
    assert result.name == module.NAME and len(result.rows) == 4
    assert [row['push_mm'] for row in result.rows] == pytest.approx([5.0, 10.0, 15.0, 20.0])
    assert result.rows[3]['open_loop_mm'] == pytest.approx(4.0)     # 2 x 0.1 x 20 mm
    assert (tmp_path / f'{module.NAME}.png').stat().st_size > 10_000


def test_claims_are_the_shares_of_the_thesis_and_the_linear_baseline(done):
    loop, kf, pod = scenario_errors.targets(scenario_errors.errors_of(done)[1])
    assert loop.value == pytest.approx(80.0) and loop.met       # 72 asked
    assert kf.value == pytest.approx(60.0) and kf.met           # 45 asked
    assert pod.value == pytest.approx(-100.0) and not pod.met


def test_scenarios_are_pushes_of_table_4_1():
    assert {figure_5_11.PADS, figure_5_12.PADS} <= set(inside_plants.GROUPS)
