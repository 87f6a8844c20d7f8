"""Drift of the zero: a straight line in time, found again in what an idle sensor shows."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy import registry
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.term import Stage
from arm_brachy.devices.force_sensor import ForceSensor, ForceSensorParams
from arm_brachy.devices.terms.force_drift import ForceDrift

PADS = ('pad_1', 'pad_2')
RATE, BIAS = np.array([0.006, -0.002, 0.0]), np.array([0.1, 0.0, -0.2])
CONTINUOUS = replace(ForceSensorParams(), resolution=0.0, moment_resolution=0.0)


def _idle(term, seconds=60.0, load=(0.0, 0.0, 0.0), params=CONTINUOUS):
    """Times (k,) and forces (k, 2, 3) of pads under a constant load."""
    sensor = ForceSensor(params, PADS, (term,), np.random.default_rng(7))
    forces, rest, samples = np.tile(load, (2, 1)), np.zeros((2, 3)), []
    for a in np.arange(0.0, seconds):
        samples += sensor.advance(a, forces, rest, a + 1.0, forces, rest, rest, rest)
    t = np.array([s.t for s in samples[::2]])
    return t, np.array([s.force for s in samples]).reshape(-1, 2, 3)


def test_a_line_fitted_to_an_idle_sensor_finds_rate_and_bias():
    """Least squares over a minute; four standard errors of white noise."""
    t, forces = _idle(ForceDrift(rate=tuple(RATE), bias=tuple(BIAS), pads=('pad_2',)))
    A = np.vander(t, 2)
    line = np.linalg.lstsq(A, forces[:, 1], rcond=None)[0]
    error = 4.0 * CONTINUOUS.noise * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    assert np.abs(line[0] - RATE).max() < error[0] < 0.1 * RATE[0]
    assert np.abs(line[1] - BIAS).max() < error[1] < 0.1 * BIAS[0]


def test_the_other_pad_is_as_it_was():
    drifting = _idle(ForceDrift(rate=tuple(RATE), pads=('pad_2',)), 2.0)[1]
    still = _idle(ForceDrift(rate=(0.0, 0.0, 0.0)), 2.0)[1]
    np.testing.assert_array_equal(drifting[:, 0], still[:, 0])
    assert np.abs(drifting[:, 1] - still[:, 1]).max() == pytest.approx(2.0 * RATE[0], rel=1e-9)


def test_a_quarter_newton_in_the_file_is_a_quarter_newton_after_a_minute():
    term, = registry.parse_terms([{'name': 'force_drift', 'rate_N_min': [0.0, 0.0, 0.25]}], 'test')
    quiet = replace(CONTINUOUS, noise=0.0, moment_noise=0.0)
    t, forces = _idle(term, params=quiet, load=(0.0, 0.0, -1.0))
    assert t[-1] == 60.0
    np.testing.assert_allclose(forces[-1], [[0.0, 0.0, -0.75]] * 2, atol=1e-14)


def test_unknown_pad_is_refused():
    with pytest.raises(ConfigError, match='force_drift: pads = .*x must be among pad_1, pad_2'):
        _idle(ForceDrift(pads=('x',)), 1.0)


def test_acts_on_the_force_stream():
    assert ForceDrift().stage is Stage.FORCE
