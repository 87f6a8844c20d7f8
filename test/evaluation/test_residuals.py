"""Residuals with known offset, known noise and known gaps."""

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.evaluation import residuals
from arm_brachy.evaluation.timeseries import Regime, ResidualData


def test_offset_and_gap():
    measured = np.zeros((100, 2, 3))
    measured[:, 0] = [3e-3, 0, -4e-3]
    measured[:25, 1] = np.nan
    data = ResidualData('x', np.arange(100) * 0.01, ('a', 'b'), measured, np.zeros((100, 2, 3)),
                        np.zeros((2, 3)), regimes=(Regime('first', 0.0, 0.24),))
    rows = {(row.marker, row.regime): row for row in residuals.marker_residuals(data)}
    a = rows['a', 'all']
    assert (a.rms, a.largest, a.seen) == pytest.approx((5e-3, 5e-3, 1.0))
    assert a.bias == pytest.approx([3e-3, 0, -4e-3])
    assert rows['b', 'all'].seen == pytest.approx(0.75)
    assert rows['b', 'first'].seen == 0.0
    assert np.isnan(rows['b', 'first'].rms)


def test_rms_is_of_the_norm():
    t = np.linspace(0, 1, 1000, endpoint=False)
    r = np.zeros((1000, 1, 3))
    r[:, 0, 1] = 2e-3 * np.sin(2 * np.pi * 5 * t)
    row = residuals.marker_residual(r[:, 0], 'm')
    assert row.rms == pytest.approx(2e-3 / np.sqrt(2))
    assert residuals.pooled_rms(r) == pytest.approx(row.rms)


def test_noise_floor_sees_noise_through_motion_and_bursts():
    rng = stream(4, 'floor')
    t = np.arange(0, 200.0, 0.01)
    sd = np.array([0.05e-3, 0.05e-3, 0.2e-3])
    clean = 10e-3 * np.sin(2 * np.pi * 0.2 * t)[:, None, None] * np.ones(3)
    clean[5000:5200] += 5e-3 * rng.standard_normal((200, 1, 3))
    measured = clean + sd * rng.standard_normal((len(t), 1, 3))
    measured[300:400] = np.nan
    assert residuals.noise_floor(measured)[0] == pytest.approx(np.linalg.norm(sd), rel=0.04)


def test_perfect_model_leaves_the_noise_floor():
    rng = stream(5, 'perfect')
    predicted = np.cumsum(1e-6 * np.ones((20_000, 1, 3)), axis=0)
    measured = predicted + 1e-4 * rng.standard_normal(predicted.shape)
    left = residuals.pooled_rms(residuals.residual(measured, predicted))
    assert residuals.noise_floor(measured)[0] == pytest.approx(left, rel=0.03)


def test_marker_never_seen():
    measured = np.full((10, 1, 3), np.nan)
    assert np.isnan(residuals.noise_floor(measured)).all()
    assert np.isnan(residuals.pooled_rms(measured))
