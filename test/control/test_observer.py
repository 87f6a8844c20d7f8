"""The disturbance observer against the Riccati equation and against what it is for."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from arm_brachy.control.observer import DisturbanceObserver, ObserverParams

PERIOD = 0.025


def feed(observer, rng, seconds, *, noise, disturbance=(0.0, 0.0, 0.0), start=0.0, velocity=0.0):
    """Samples of a target the model moves along x at `velocity`; returns the last time."""
    for k in range(round(seconds / PERIOD)):
        t = start + (k + 1) * PERIOD
        model = np.array([velocity * (t - start), 0.0, 0.0])
        observer.update(t, model + np.array(disturbance) + noise * rng.normal(size=3), model)
    return t


def test_variance_at_rest_solves_the_riccati_equation():
    params = ObserverParams()
    observer = DisturbanceObserver(params)
    feed(observer, np.random.default_rng(0), 60.0, noise=params.noise)
    process, noise = params.drift**2 * PERIOD / 60.0, params.noise**2
    one = np.eye(1)
    prior = solve_discrete_are(one, one, process * one, noise * one)[0, 0]
    assert observer.variance == pytest.approx(prior * noise / (prior + noise), rel=1e-6)


def test_the_estimate_is_as_good_as_it_says():
    params = ObserverParams()
    errors, claimed = [], []
    for seed in range(40):
        observer = DisturbanceObserver(params)
        feed(observer, np.random.default_rng(seed), 5.0, noise=params.noise,
             disturbance=np.array([1e-3, -2e-3, 0.5e-3]))
        errors.append(observer.disturbance - [1e-3, -2e-3, 0.5e-3])
        claimed.append(observer.sd)
    # 120 draws; a constant disturbance is easier than the random walk it is prepared for
    assert 0.5 < np.std(errors) / np.mean(claimed) < 1.1


def test_a_first_sample_is_believed_almost_entirely():
    observer = DisturbanceObserver(ObserverParams())
    observer.update(0.0, np.array([3e-3, 0, 0]), np.zeros(3))
    assert observer.disturbance[0] == pytest.approx(3e-3, rel=0.01)
    assert observer.sd == pytest.approx(observer.params.noise, rel=0.01)


def test_travel_makes_it_doubt_the_model_and_rest_makes_it_sure_again():
    params = ObserverParams()
    observer, rng = DisturbanceObserver(params), np.random.default_rng(1)
    t = feed(observer, rng, 20.0, noise=params.noise)
    calm = observer.sd
    t = feed(observer, rng, 2.0, noise=params.noise, start=t, velocity=2e-3)
    moving = observer.sd
    feed(observer, rng, 20.0, noise=params.noise, start=t)
    assert moving > 2.5 * calm
    assert observer.sd == pytest.approx(calm, rel=0.1)


def test_uncertainty_after_travel_without_samples_is_the_stated_model_error():
    params = ObserverParams(drift=1e-7)
    observer = DisturbanceObserver(params)
    for k in range(4000):
        observer.update(k * PERIOD, np.zeros(3), np.zeros(3))
    before = observer.variance
    observer.update(4000 * PERIOD, np.array([5e-3, 0, 0]), np.array([5e-3, 0, 0]))
    prior = before + (0.3 * 5e-3)**2     # 30 % of 5 mm, drift aside
    assert observer.variance == pytest.approx(prior * params.noise**2
                                              / (prior + params.noise**2), rel=1e-3)


def test_reset_forgets():
    observer = DisturbanceObserver(ObserverParams())
    feed(observer, np.random.default_rng(2), 1.0, noise=1e-4, disturbance=np.ones(3))
    observer.reset()
    assert observer.last_time is None and np.all(observer.disturbance == 0.0)
    assert observer.sd == observer.params.initial
