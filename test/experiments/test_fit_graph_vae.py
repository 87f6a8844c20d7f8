"""The search of the network's sizes takes what predicts best; its criterion is a log density."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from arm_brachy.core.outcome import Outcome
from arm_brachy.estimation.estimate import Estimate
from arm_brachy.estimation.graph_vae.params import GraphVaeParams
from arm_brachy.experiments import fit_cases, fit_graph_vae

BEST = {'spread': 0.6, 'local': 0.01, 'inflation': 1.1, 'localised': False}


def judgement(worth):
    return fit_cases.Judgement(worth, 1.0, 0.0, 0.0, np.full(4, 3.0))


class Valley:
    """A criterion that is least at BEST."""

    def __init__(self):
        self.tried = []

    def judgements(self, tried):
        self.tried += tried
        return [judgement(sum(abs(float(getattr(p, name)) - float(value))
                              for name, value in BEST.items())) for p in tried]


def test_search_takes_the_least_of_each_size_in_turn(capsys):
    valley = Valley()
    found = fit_graph_vae.search(valley, GraphVaeParams())
    assert {name: getattr(found, name) for name in BEST} == BEST
    assert len(capsys.readouterr().out.splitlines()) == len(valley.tried)


def test_density_is_that_of_the_covariances_as_predicted():
    rng, sd = np.random.default_rng(1), 0.4e-3
    some = [SimpleNamespace(truth=sd * rng.standard_normal((5, 3)), deepest=True)
            for _ in range(40)]
    C = np.diag([0.2e-3, 0.5e-3, 0.8e-3])**2
    found = fit_cases.judge(some, [(np.zeros((5, 3)), np.tile(C, (5, 1, 1)))] * len(some))
    direct = -np.mean([multivariate_normal(np.zeros(3), 1e6 * C).logpdf(1e3 * case.truth)
                       for case in some])
    assert found.inflation != pytest.approx(1.0, abs=0.1)
    assert fit_graph_vae.density(found) == pytest.approx(direct)


def test_each_set_of_markers_has_its_estimator_and_every_case_is_judged(monkeypatch):
    """The estimator's parts are counted, not run."""
    class Counting:
        def __init__(self, markers):
            self.markers, self.given = markers, []

        def with_params(self, params):
            return SimpleNamespace(step=lambda surface: self._step(params, surface))

        def _step(self, params, surface):
            self.given.append((params, surface))
            return Estimate(0.0, ('a',), np.zeros((1, 3)), 1e-6 * np.eye(3)[None],
                            outcome=Outcome.OK)

    built = {}

    def build(scene, terms, targets, markers, params):
        return built.setdefault(len(markers), Counting(markers))

    monkeypatch.setattr(fit_graph_vae.inside_estimators, 'entry',
                        lambda name: SimpleNamespace(build=build, params=None))
    some = [SimpleNamespace(count=count, last=k, truth=np.full((1, 3), 1e-3), deepest=True)
            for k, count in enumerate((19, 10, 10))]
    tried = [GraphVaeParams(), GraphVaeParams(spread=0.6)]
    found = fit_graph_vae.Fit(some).judgements(tried)
    assert [j.trials for j in found] == [3, 3]
    assert sorted(built) == [10, 19]
    assert [g[1] for g in built[10].given] == [1, 1, 2, 2] and len(built[19].given) == 2
