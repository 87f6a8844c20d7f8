"""Every span of states of every recording: what a force does there, beside all nuisances."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.diagnosis.selection import transient_force as module
from arm_brachy.diagnosis.selection.transient_force import passing
from arm_brachy.diagnosis.statistics.linear_gaussian import log_density

STATES, EACH, NUISANCES = 12, 20, 5     # rows of a state are independent of those of others
T = np.arange(float(STATES))
LEAN = (4, 8)       # states in which somebody leans on the second of two recordings


@pytest.fixture
def made(monkeypatch):
    """Function (strength of the lean in prior standard deviations) -> assembly."""
    rng = np.random.default_rng(11)
    rows = STATES * EACH
    force = rng.standard_normal((2, rows, 3))   # at one place of either recording
    U, noise = rng.standard_normal((2 * rows, NUISANCES)), rng.standard_normal(2 * rows)
    state = np.repeat(np.arange(STATES), EACH)

    def apart(m):
        own = (state[:, None] == np.arange(STATES))[:, :, None]
        yield (own * force[m.number][:, None, :]).reshape(rows, -1)
    monkeypatch.setattr(module, '_columns', apart)

    def assembly(strength):
        leant = np.isin(state, np.arange(*LEAN))
        r = noise + U @ np.full(NUISANCES, 0.5)
        r[rows:] += strength * leant * force[1].sum(axis=1)
        matched = [SimpleNamespace(number=k, r=r[k * rows:(k + 1) * rows], recorded=(
            SimpleNamespace(states=SimpleNamespace(t=T)))) for k in (0, 1)]
        return SimpleNamespace(matched=matched, sound=0, force=force, leant=leant,
                               problem=SimpleNamespace(U=U, r=r))
    return assembly


def test_the_span_in_which_somebody_leans_is_found(made):
    found = passing(made(2.0), best=3.0)
    assert (found.number, found.start, found.end) == (1, 3.5, 7.5)
    assert found.occasions.windows == ((3.5, 7.5),)
    assert found.occasions.owners == {('onset', 3.5): (1,)}


def test_its_evidence_is_that_of_the_whole_problem_less_what_the_search_costs(made):
    """Log marginal likelihoods with and without the force, dense, and all spans of 2 at least."""
    one = made(2.0)
    rows = len(one.leant)
    columns = np.zeros((2 * rows, 3))
    columns[rows:] = one.leant[:, None] * one.force[1]
    U, r = one.problem.U, one.problem.r
    gain = log_density(np.hstack([U, columns]), r) - log_density(U, r)
    spans = 2 * (STATES - 1) * STATES // 2
    assert passing(one, best=3.0).evidence == pytest.approx(gain - np.log(spans), rel=1e-9)


def test_nothing_passes_in_noise_nor_where_another_cause_does_nearly_as_well(made):
    assert passing(made(0.0), best=0.0) is None
    strong = passing(made(2.0), best=0.0)
    assert passing(made(2.0), best=strong.evidence - 9.0) is None
    assert passing(made(2.0), best=strong.evidence - 11.0) is not None


def test_a_single_state_has_no_span():
    m = SimpleNamespace(recorded=SimpleNamespace(states=SimpleNamespace(t=np.zeros(1))))
    assert list(module._columns(m)) == []


def test_recordings_in_which_nothing_is_wrong_are_not_searched(made):
    assembly = made(2.0)
    assembly.sound = 1
    assert passing(assembly, best=0.0) is None
