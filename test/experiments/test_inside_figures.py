"""Figures 4.5 to 4.7 on made-up scores: what is counted and what is claimed."""

import numpy as np
import pytest

from arm_brachy.experiments import figure_4_5, figure_4_6, figure_4_7, inside_plants
from arm_brachy.experiments.inside_iterations import EXPERIMENTS, Trace, rows
from arm_brachy.experiments.inside_study import Scores


def decaying(method, end, rate):
    """Error that falls to `end` [m] as exp(-rate k), from 5 mm above it, on two plants."""
    k = np.arange(1, 401)
    return Trace(method, {e: end + 5e-3 * np.exp(-rate * k) * np.ones((2, 1))
                          for e in EXPERIMENTS})


@pytest.fixture
def traces():
    made = (decaying('admm', 2e-3, 0.02), decaying('kf_admm_19', 1e-3, 0.05),
            decaying('kf_admm_10', 1.5e-3, 0.05))
    return {one.method: one for one in made}


def test_converged_is_where_a_decay_comes_within_a_tenth_of_a_millimetre(traces):
    """5 mm exp(-rate k) < 0.1 mm from k = ln(50) / rate on."""
    assert traces['admm'].converged(4) == pytest.approx(np.log(50.0) / 0.02, abs=2)
    assert traces['kf_admm_19'].converged(4) == pytest.approx(np.log(50.0) / 0.05, abs=2)
    flat = Trace('admm', {4: np.full((1, 20), 1e-3)})
    assert flat.converged(4) == 1


def test_figures_of_iterations_set_ours_beside_the_thesis(traces):
    table = rows(traces)
    assert len(table) == len(EXPERIMENTS) * len(traces)
    assert [r['thesis_converged_after_iterations'] for r in table[:3]] == [500, 200, None]
    assert [goal.met for goal in figure_4_5.targets(traces)] == [True, False, True]
    assert figure_4_5.targets(traces)[1].value == pytest.approx(0.4, abs=0.01)
    assert [goal.met for goal in figure_4_6.targets(traces)] == [True, True]
    assert len(figure_4_5.draw(traces).axes) == len(EXPERIMENTS)


def test_figure_of_experiments_compares_sets_and_depths():
    depth = np.tile(inside_plants.DEPTHS, len(inside_plants.GROUPS))
    size = {('open_loop', 19): depth / 10, ('kf_admm', 19): np.sqrt(depth * 5e-3) / 20,
            ('open_loop', 10): depth / 10, ('kf_admm', 10): np.sqrt(depth * 5e-3) / 15}
    done = {(*case, 'inclusion'): Scores(depth, np.tile(mm[:, None, None], (1, 2, 5)),
                                         np.full((16, 2, 5), np.nan), np.ones(3))
            for case, mm in size.items()}
    few, deep = figure_4_7.targets(done)
    assert few.value == pytest.approx(20 / 15) and few.met
    assert deep.value == pytest.approx(75.0) and deep.met    # 1 - (10 / 20) * sqrt(5 / 20)
    assert figure_4_7.draw(done).axes[0].get_ylabel() == 'mean target error [mm]'
