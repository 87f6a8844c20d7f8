"""Scale: every distance times 1 + s, one point kept, the optical stream alone."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from arm_brachy.core.term import Stage
from arm_brachy.devices.optical_tracker import OpticalParams, OpticalTracker
from arm_brachy.devices.terms.optical_scale import OpticalScale

NAMES = tuple(f'm{i}' for i in range(6))
NO_PADS = np.zeros((0, 3))
EXACT = replace(OpticalParams(), noise=0.0, calibration_error=0.0, occlusion_probability=0.0,
                dropout_probability=0.0)
POINTS = np.random.default_rng(8).uniform(-0.06, 0.06, (6, 3))


def _frame(term, points=POINTS):
    """What the tracker delivers of points at rest."""
    tracker = OpticalTracker(replace(EXACT, latency=0.0), NAMES, (term,), np.random.default_rng(1))
    frame, = tracker.advance(0.0, points, 0.01, points, NO_PADS, NO_PADS)
    return frame.points


@pytest.mark.parametrize('scale', [0.008, -0.05])
def test_all_distances_grow_by_the_scale(scale):
    seen = _frame(OpticalScale(scale=scale, centre=(0.01, -0.02, 0.005)))
    ratio = [np.linalg.norm(seen[i] - seen[j]) / np.linalg.norm(POINTS[i] - POINTS[j])
             for i, j in combinations(range(6), 2)]
    np.testing.assert_allclose(ratio, 1.0 + scale, rtol=1e-12)


def test_the_centre_is_the_only_point_that_stays():
    centre = POINTS[2]
    away = np.linalg.norm(_frame(OpticalScale(scale=0.01, centre=tuple(centre))) - POINTS, axis=1)
    np.testing.assert_allclose(away, 0.01 * np.linalg.norm(POINTS - centre, axis=1), atol=1e-16)
    assert np.flatnonzero(away < 1e-12).tolist() == [2]


def test_another_centre_is_a_shift_of_everything():
    """Why the centre need not be known where frames are registered anyway."""
    a, b = np.array([0.03, 0.0, 0.0]), np.array([0.0, -0.05, 0.02])
    shift = _frame(OpticalScale(scale=0.02, centre=tuple(b))) - _frame(
        OpticalScale(scale=0.02, centre=tuple(a)))
    np.testing.assert_allclose(shift, np.tile(0.02 * (a - b), (6, 1)), atol=1e-15)


def test_a_body_of_another_size_looks_the_same():
    """Same shape, (1 + s) times as large, moved (1 + s) times as far: nothing to tell them by."""
    moved = POINTS + np.random.default_rng(9).normal(0.0, 2e-3, (6, 3))
    term = OpticalScale(scale=0.008)
    for points in (POINTS, moved):
        np.testing.assert_allclose(_frame(term, points),
                                   _frame(OpticalScale(scale=0.0), 1.008 * points), atol=1e-16)


def test_acts_on_the_optical_stream():
    assert OpticalScale().stage is Stage.OPTICAL
