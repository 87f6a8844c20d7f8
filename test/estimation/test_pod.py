"""POD: its update, its ellipses on draws from its own prior, its ensemble, its refusals."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2

from arm_brachy.core.outcome import Outcome
from arm_brachy.estimation import pod
from arm_brachy.estimation.estimate import Surface
from arm_brachy.estimation.unknowns import PriorParams

PRIOR = PriorParams(modulus_modes=8, force_modes=4)
PARAMS = pod.PodParams(modes=10, pushes=4, reach=0.004, prior=PRIOR)
Q = np.array([0.003, 0.001])


@pytest.fixture(scope='module')
def built(block):
    return pod.build(block.scene, (), block.targets, block.markers, PARAMS)


def draw(estimator, rng, count, params=PARAMS):
    """Surfaces and true targets drawn from the estimator's own prior."""
    x = estimator._model_at(Q)
    points, depth = estimator._forward.points(x), np.abs(Q).max()
    left = np.sqrt(params.floor**2 + (params.local * depth)**2)
    m = len(estimator._forward.model.markers)
    for k in range(count):
        a = rng.normal(size=len(estimator.variance)) * np.sqrt(estimator.variance)
        true = points + depth * (estimator._watch @ a).reshape(-1, 3)
        true = true + left * rng.normal(size=true.shape)
        yield (Surface(float(k), Q, true[:m] + params.noise * rng.normal(size=(m, 3))), true[m:])


def test_ellipses_hold_draws_from_the_prior_as_often_as_they_say(built):
    inside = total = 0
    for surface, truth in draw(built, np.random.default_rng(5), 300):
        found = built.step(surface)
        error = found.points[0] - truth[0]
        inside += error @ np.linalg.solve(found.covariance[0], error) < chi2.ppf(0.95, 3)
        total += 1
    low, high = binom.ppf([5e-4, 0.9995], total, 0.95)
    assert low <= inside <= high


def test_markers_that_the_model_expects_leave_the_model(built):
    x = built._model_at(Q)
    points = built._forward.points(x)
    m = built._forward.n_markers
    found = built.step(Surface(0.0, Q, points[:m]))
    np.testing.assert_allclose(found.points, points[m:], atol=1e-12)
    np.testing.assert_allclose(found.x, x, atol=1e-12)


def test_the_ensemble_tends_to_the_closed_form(built, block):
    ensemble = pod.build(block.scene, (), block.targets, block.markers, replace(
        PARAMS, update='es_mda', members=6000, assimilations=2))
    surface, _ = next(draw(built, np.random.default_rng(6), 1))
    exact, found = built.step(surface), ensemble.step(surface)
    sd = np.sqrt(np.einsum('kii->ki', exact.covariance))
    assert np.abs((found.points - exact.points) / sd).max() < 0.2
    np.testing.assert_allclose(np.sqrt(np.einsum('kii->ki', found.covariance)), sd, rtol=0.1)


def test_same_input_same_bits(built, block):
    other = pod.build(block.scene, (), block.targets, block.markers, PARAMS)
    surface, _ = next(draw(built, np.random.default_rng(7), 1))
    built.step(replace(surface, q=2.0 * Q))
    built.reset()
    a, b = built.step(surface), other.step(surface)
    assert a.points.tobytes() == b.points.tobytes()
    assert a.covariance.tobytes() == b.covariance.tobytes()


def test_hidden_markers_widen_the_ellipse_and_none_is_named(built):
    surface, _ = next(draw(built, np.random.default_rng(8), 1))
    whole = built.step(surface)
    few = surface.markers.copy()
    few[1:] = np.nan
    assert np.trace(built.step(replace(surface, markers=few)).covariance[0]) > np.trace(
        whole.covariance[0])
    none = built.step(replace(surface, markers=np.full_like(few, np.nan)))
    assert none.outcome is Outcome.REJECTED
    assert 'no marker' in none.message
    assert np.isnan(none.points).all()


def test_a_travel_beyond_the_model_is_named(built):
    surface, _ = next(draw(built, np.random.default_rng(9), 1))
    crushed = built.step(replace(surface, q=np.array([0.5, 0.5])))
    assert not crushed.outcome.ok
    assert crushed.message
    assert np.isnan(crushed.covariance).all()
    assert built.step(surface).outcome.ok


def test_registration_error_widens_the_ellipse(built):
    surface, _ = next(draw(built, np.random.default_rng(10), 1))
    unsure = replace(surface, frame_covariance=1e-6 * np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 1.0]))
    assert np.trace(built.step(unsure).covariance[0]) > np.trace(built.step(surface).covariance[0])
