"""Fresh plants are drawn, none of a table; the criterion and the search do what they say."""

import json
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.paths import share_dir
from arm_brachy.estimation.map import MapParams
from arm_brachy.estimation.unknowns import PriorParams
from arm_brachy.experiments import fit_cases, fit_map, fresh_plants, inside_plants

RESULT = share_dir() / 'results' / 'fit-estimators.json'


def test_fresh_plants_are_reproducible_and_none_is_of_the_table():
    some = [fresh_plants.drawn(i) for i in range(24)]
    assert some == [fresh_plants.drawn(i) for i in range(24)]
    assert some != [fresh_plants.drawn(i, seed=1) for i in range(24)]
    assert {one.kind for one in some} == set(fresh_plants.KINDS)
    assert inside_plants.PLANT_MESH not in fresh_plants.MESHES
    assert inside_plants.MODEL_MESH not in fresh_plants.MESHES
    assert not any(one.term in inside_plants.PLANTS.values() for one in some)
    assert len({str(one.term) for one in some}) == 1 + 20   # four of six have none


def test_every_drawn_term_is_one_that_the_registry_takes():
    for number in range(6):
        fresh = fresh_plants.drawn(number)
        terms = fresh_plants.terms(fresh)
        assert len(terms) == (fresh.kind != 'none')


def cases(rng, count, sd):
    return [SimpleNamespace(truth=sd * rng.standard_normal((5, 3)), deepest=i % 2 == 0)
            for i in range(count)]


def test_judgement_of_gaussian_draws_is_that_of_their_density():
    rng, sd = np.random.default_rng(0), 0.5e-3
    some = cases(rng, 2000, sd)
    said = [(np.zeros((5, 3)), np.tile(sd**2 * np.eye(3), (5, 1, 1)))] * len(some)
    found = fit_cases.judge(some, said)
    assert found.inflation == pytest.approx(1.0, rel=0.03)
    # entropy of a Gaussian in three dimensions, sd in mm
    assert found.nlpd == pytest.approx(1.5 * (1.0 + np.log(2.0 * np.pi)) + 3.0 * np.log(0.5),
                                       abs=0.02)
    assert found.covered_with(1.0) == pytest.approx(0.95, abs=0.01)
    tight = [(p, 0.25 * c) for p, c in said]
    other = fit_cases.judge(some, tight)
    assert other.inflation == pytest.approx(4.0 * found.inflation)
    assert other.nlpd == pytest.approx(found.nlpd)      # one factor makes up for it


class Valley:
    """A criterion with its least value at fibres 0.2 and trust 0.25."""

    def judged(self, params):
        worth = (np.log(params.prior.fibres / 0.2)**2 + (params.trust - 0.25)**2
                 + np.log(params.marker_local / MapParams().marker_local)**2)
        return fit_cases.Judgement(worth, 1.7, 0.0, 0.0, np.zeros(1))


def test_search_walks_to_the_least_value(monkeypatch):
    monkeypatch.setattr(fit_map, 'SEARCHED', ('fibres', 'trust'))
    found, best = fit_map.fit(Valley(), MapParams())
    assert found.prior.fibres == pytest.approx(0.2, rel=0.2)
    assert found.trust == 0.25 and found.inflation == 1.7
    assert best.nlpd < 0.05
    assert found.prior.base == PriorParams().base


@pytest.mark.parametrize('params', [MapParams, PriorParams])
def test_defaults_are_what_was_fitted(params):
    """Two digits of the committed result are what the dataclasses have."""
    fitted = {row['parameter']: row['value'] for row in json.loads(RESULT.read_text())['rows']
              if row['estimator'] == 'map' and 'parameter' in row}
    shared = [f for f in fields(params) if f.name in fitted and not (
        params is MapParams and f.name in fit_map.PRIORS)]
    assert shared
    for field in shared:
        info = field.metadata['quantity']
        assert getattr(params(), field.name) / info.scale == pytest.approx(
            fitted[field.name], rel=0.05), field.name
