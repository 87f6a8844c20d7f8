"""The optical tracker: noise, constant error, occlusion as a Markov process, cameras."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from arm_brachy.core.errors import ConfigError
from arm_brachy.devices.optical_tracker import (
    Camera,
    OpticalParams,
    OpticalTracker,
    hidden_next,
)

CLEAR = replace(OpticalParams(), occlusion_probability=0.0, dropout_probability=0.0, latency=0.0)
EXACT = replace(CLEAR, noise=0.0, calibration_error=0.0)
NO_PADS = np.zeros((0, 3))


def _watch(params, points, seconds, seed=5, **options):
    points = np.asarray(points, dtype=float)
    names = [f'm{i:02d}' for i in range(len(points))]
    tracker = OpticalTracker(params, names, (), np.random.default_rng(seed), **options)
    return tracker.advance(0.0, points, seconds, points, NO_PADS, NO_PADS)


def test_random_and_constant_errors_are_as_stated():
    """Chi-square, four standard errors: rms lengths of noise and of the markers' offsets."""
    k, seconds = 400, 1.0
    frames = _watch(CLEAR, np.zeros((k, 3)), seconds)
    x = np.array([f.points for f in frames])
    mean = x.mean(axis=0)
    noise = np.sum((x - mean)**2) / (k * (len(x) - 1)) / CLEAR.noise**2
    assert abs(noise - 1.0) < 4.0 * np.sqrt(2.0 / (3 * k * (len(x) - 1)))
    offset = np.sum(mean**2) / k / (CLEAR.calibration_error**2 + CLEAR.noise**2 / len(x))
    assert abs(offset - 1.0) < 4.0 * np.sqrt(2.0 / (3 * k))


@pytest.mark.parametrize('rate', [50.0, 200.0])
def test_occlusion_share_and_duration_do_not_depend_on_the_rate(rate):
    """Stationary share and mean stay of the Markov process, four standard errors."""
    share, stay, k, seconds = 0.2, 0.3, 200, 60.0
    params = replace(EXACT, rate=rate, occlusion_probability=share, occlusion_duration=stay)
    hidden = ~np.array([f.visible for f in _watch(params, np.zeros((k, 3)), seconds)])
    correlation = stay * (1.0 - share)  # time constant of the two-state process
    effective = k * seconds / (2.0 * correlation)
    assert abs(hidden.mean() - share) < 4.0 * np.sqrt(share * (1 - share) / effective)
    leaves = hidden[:-1] & ~hidden[1:]
    p_leave = leaves.sum() / hidden[:-1].sum()
    expected = (1.0 - share) * (1.0 - np.exp(-1.0 / (rate * correlation)))
    spread = np.sqrt(expected * (1 - expected) / hidden[:-1].sum())
    assert abs(p_leave - expected) < 4.0 * spread


def test_hidden_next_is_the_two_state_transition_matrix():
    params = replace(CLEAR, occlusion_probability=0.3, occlusion_duration=0.05)
    mu = 1.0 / 0.05
    lam = mu * 0.3 / 0.7
    step = expm(np.array([[-lam, lam], [mu, -mu]]) / params.rate)  # rows: visible, hidden
    found = hidden_next(np.array([False, True]), params)
    np.testing.assert_allclose(found, step[:, 1], rtol=1e-12)


def test_hidden_is_nan_and_visible_is_finite():
    params = replace(OpticalParams(), occlusion_probability=0.3, dropout_probability=0.1)
    for frame in _watch(params, np.ones((30, 3)), 1.0):
        np.testing.assert_array_equal(np.isfinite(frame.points).all(axis=1), frame.visible)
        np.testing.assert_array_equal(np.isnan(frame.points).all(axis=1), ~frame.visible)


def test_dropout_is_independent_from_frame_to_frame():
    p = 0.1
    visible = np.array([f.visible for f in
                        _watch(replace(CLEAR, dropout_probability=p), np.zeros((100, 3)), 5.0)])
    lost = ~visible
    assert abs(lost.mean() - p) < 4.0 * np.sqrt(p * (1 - p) / lost.size)
    twice = (lost[1:] & lost[:-1]).mean()
    assert abs(twice - p**2) < 4.0 * np.sqrt(p**2 / lost[1:].size)


def test_two_cameras_must_face_a_marker():
    """Cameras at 0, 40 and 180 deg in the xy plane; a marker on top of a ball turns in plane."""
    at = np.deg2rad([0.0, 40.0, 180.0])
    cameras = tuple(Camera((float(5 * np.cos(a)), float(5 * np.sin(a)), 0.0)) for a in at)
    params = replace(EXACT, cameras=cameras, facing_limit=np.deg2rad(60.0))
    angles = np.deg2rad(np.arange(0.0, 360.0, 15.0))
    normals = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    frame = _watch(params, np.zeros((len(angles), 3)), 0.01, normals=normals)[0]
    off = np.abs((np.rad2deg(angles[:, None] - at) + 180.0) % 360.0 - 180.0)
    np.testing.assert_array_equal(frame.visible, (off <= 60.0 + 1e-9).sum(axis=1) >= 2)
    assert 0 < frame.visible.sum() < len(angles)


def test_cameras_without_normals_are_refused():
    params = replace(EXACT, cameras=(Camera((1.0, 0.0, 0.0)),))
    with pytest.raises(ConfigError, match='normals'):
        OpticalTracker(params, ['m00'], (), np.random.default_rng(0))


def test_moving_marker_is_sampled_on_its_way():
    tracker = OpticalTracker(EXACT, ['m00'], (), np.random.default_rng(0))
    frames = tracker.advance(0.0, np.zeros((1, 3)), 0.1, np.full((1, 3), 0.1), NO_PADS, NO_PADS)
    for frame in frames:
        np.testing.assert_allclose(frame.points[0], frame.t, atol=1e-12)
