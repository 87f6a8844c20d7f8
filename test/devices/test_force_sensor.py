"""The force sensor: sign untouched, noise, counts, saturation."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.devices.force_sensor import ForceSensor, ForceSensorParams, digitise
from arm_brachy.scenario import Limits

CONTINUOUS = replace(ForceSensorParams(), resolution=0.0, moment_resolution=0.0)
EXACT = replace(CONTINUOUS, noise=0.0, moment_noise=0.0)


def _watch(params, force, moment, seconds=0.1, seed=4):
    force, moment = np.atleast_2d(force), np.atleast_2d(moment)
    names = [f'pad_{i}' for i in range(len(force))]
    sensor = ForceSensor(params, names, (), np.random.default_rng(seed))
    at_rest = np.zeros((len(force), 3))
    return sensor.advance(0.0, force, moment, seconds, force, moment, at_rest, at_rest)


def test_reports_the_wrench_it_is_given():
    force, moment = [[1.0, -2.0, 0.5], [0.0, 0.1, 0.0]], [[0.01, 0.0, -0.02], [0.0, 0.0, 0.003]]
    for i, sample in enumerate(_watch(EXACT, force, moment, 0.01)):
        np.testing.assert_array_equal(sample.force, force[i])
        np.testing.assert_array_equal(sample.moment, moment[i])
        assert not sample.saturated


def test_noise_is_as_stated():
    """Chi-square on 3 x 5000 values each, four standard errors."""
    samples = _watch(CONTINUOUS, [1.0, 2.0, 3.0], [0.0, 0.0, 0.1], 50.0)
    force = np.array([s.force for s in samples]) - [1.0, 2.0, 3.0]
    moment = np.array([s.moment for s in samples]) - [0.0, 0.0, 0.1]
    for error, sigma in ((force, CONTINUOUS.noise), (moment, CONTINUOUS.moment_noise)):
        assert abs(np.mean(error**2) / sigma**2 - 1.0) < 4.0 * np.sqrt(2.0 / error.size)


def test_saturates_at_the_range_and_says_so():
    top, top_m = EXACT.range, EXACT.moment_range
    sample = _watch(EXACT, [top + 5.0, -top - 1.0, 1.0], [0.0, 0.0, 0.0], 0.01)[0]
    np.testing.assert_array_equal(sample.force, [top, -top, 1.0])
    assert sample.saturated
    sample = _watch(EXACT, [1.0, 0.0, 0.0], [0.0, 1.2 * top_m, 0.0], 0.01)[0]
    assert sample.moment[1] == top_m
    assert sample.saturated


def test_the_supervisor_can_see_its_limit():
    """A push along one axis clips at the range; clipped below the limit, it would never stop."""
    assert ForceSensorParams().range > Limits().pad_force


@pytest.mark.parametrize('resolution', [0.00625, 0.1])
def test_counts(resolution):
    values = np.linspace(-20.0, 20.0, 1001)
    out, over = digitise(values, 25.0, resolution)
    assert not over.any()
    np.testing.assert_allclose(out / resolution, np.round(out / resolution), atol=1e-9)
    assert np.abs(out - values).max() <= 0.5 * resolution * (1 + 1e-9)
