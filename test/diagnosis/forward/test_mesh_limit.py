"""The limit of finer elements is taken where recordings bear it out, and only there."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.diagnosis.likelihood.discretisation import EnsembleOptions, ensemble_of
from arm_brachy.diagnosis.likelihood.match import Matched
from arm_brachy.diagnosis.likelihood.nuisances import nuisances
from arm_brachy.diagnosis.likelihood.observation import Measured, Observables, channels_of
from arm_brachy.diagnosis.likelihood.tolerances import joined
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.selection.mesh_convergence import at_limit, said

T = np.arange(1.0, 13.0, 0.6)
SD = {'optical': 3e-5, 'em': 5e-5, 'force': 3e-3}
OPTIONS = EnsembleOptions(members=4)


@pytest.fixture(scope='module')
def baseline(quadratic, encoder):
    return Baseline(ForwardModel(quadratic), encoder, T)


@pytest.fixture(scope='module')
def ensemble(baseline):
    return ensemble_of(baseline.model, np.random.default_rng(3), OPTIONS)


def matched(baseline, ensemble, shown, seed=0):
    """Matched of a recording that shows what is given, and noise."""
    rng, channels = np.random.default_rng(seed), channels_of(baseline.model.specimen)
    every = []
    for kind, values in shown.items():
        sd = np.full(values.shape, SD[kind])
        every.append(Measured(kind, channels[kind], values + sd * rng.standard_normal(sd.shape),
                              np.ones(values.shape[:2], dtype=bool), sd, np.eye(len(T))))
    recorded = SimpleNamespace(states=SimpleNamespace(t=T))
    return Matched(recorded, baseline, Observables(every, channels),
                   joined(nuisances(baseline), ensemble.along(baseline)))


def halved(baseline, ensemble, times):
    """What the baseline shows with `times` what halving its elements changes."""
    added = ensemble.limit.along(baseline)
    return {kind: values + times / OPTIONS.limit * added[kind]
            for kind, values in baseline.shown.items()}


def test_the_limit_is_a_multiple_of_what_halving_the_elements_changes(baseline, ensemble):
    """Against the column of the ensemble that all pads share, which is twice the change."""
    both = ensemble.names.index('elements')
    for ours, columns in ((ensemble.limit.tangents, ensemble.tangents),
                          (ensemble.limit.curvatures, ensemble.curvatures)):
        assert np.allclose(ours / OPTIONS.limit, columns[..., both] / OPTIONS.inflation,
                           rtol=1e-12, atol=0.0)
    added = ensemble.limit.along(baseline)
    assert np.abs(added['force']).max() > 0.02 * np.abs(baseline.shown['force']).max()


@pytest.mark.parametrize('name, least', [('elements', 5.0), ('member', 2.0)])
def test_less_is_left_beside_the_limit(baseline, ensemble, name, least):
    """Of forces, root mean square over the columns of a name; of positions members stay."""
    chosen = np.flatnonzero(np.array(ensemble.along(baseline).names) == name)
    before, after = (one.along(baseline).values for one in (ensemble, ensemble.limit.left))
    assert np.linalg.norm(before['force'][..., chosen]) > 0.999 * least * np.linalg.norm(
        after['force'][..., chosen])
    same = np.allclose(before['optical'][..., chosen], after['optical'][..., chosen], rtol=1e-12)
    assert same == (name == 'member')


def test_linear_elements_have_no_limit_by_halving(linear):
    found = ensemble_of(ForwardModel(linear), np.random.default_rng(3), EnsembleOptions(members=1))
    assert found.limit is None


@pytest.mark.parametrize('times', [1.75, 2.0])
def test_a_recording_of_finer_elements_is_met_at_the_limit(baseline, ensemble, times):
    one = matched(baseline, ensemble, halved(baseline, ensemble, times))
    finer, = at_limit([one], ensemble.limit)
    assert np.mean(finer.r**2) < 0.5 * np.mean(one.r**2)
    assert 'Finer elements would move points by' in said([finer])
    again = finer.observables.residual(
        {kind: values + finer.finer[kind] for kind, values in baseline.shown.items()})
    assert np.allclose(finer.r, again, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize('times', [0.0, -1.0])
def test_a_recording_of_as_coarse_a_mesh_is_not(baseline, ensemble, times):
    one = matched(baseline, ensemble, halved(baseline, ensemble, times))
    assert at_limit([one], ensemble.limit) is None


def test_without_a_limit_nothing_is_taken_to_it(baseline, ensemble):
    assert at_limit([matched(baseline, ensemble, baseline.shown)], None) is None
