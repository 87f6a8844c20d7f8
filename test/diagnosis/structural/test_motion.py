"""The encoders' path as straight pieces."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.diagnosis.signals.motion import FINENESS, Motion, corners_of, motion_of
from arm_brachy.diagnosis.signals.stream import ENCODER


def path(t):
    """Out at 4 mm/s, stand, on at 2 mm/s, stand, home at 8 mm/s [m]."""
    return np.interp(t, [1.0, 2.0, 3.0, 4.0, 5.0, 5.75], [0.0, 4e-3, 4e-3, 6e-3, 6e-3, 0.0])


def test_corners_are_found_where_they_are():
    t = np.arange(0.0, 7.0, 0.01)
    q = path(t)[:, None] + 5e-6 * stream(1, 'corners').standard_normal((len(t), 1))
    corners = corners_of(t, q, 4e-5)
    for corner in (1, 2, 3, 4, 5, 5.75):
        assert np.abs(t[corners] - corner).min() <= 0.03
    assert len(corners) <= 10


def counted(count, noise):
    """Motion by an encoder of such counts [m] with that much noise in them."""
    t = np.arange(0.0, 7.0, 0.01)
    q = path(t) + noise * count * stream(2, 'counts').standard_normal(len(t))
    readings = (count * np.round(q / count))[:, None, None]
    return motion_of({ENCODER: SimpleNamespace(t=t, values=readings,
                                               valid=np.ones((len(t), 1), dtype=bool))})


def test_counts_that_follow_the_motion_alone_cost_no_fineness():
    assert counted(1.22e-5, 0.0).tolerance == pytest.approx(FINENESS * 6e-3, rel=0.01)


@pytest.mark.parametrize('count', [1e-5, 5e-5])
def test_counts_that_flicker_are_no_motion(count):
    """Noise of a third of a count moves most readings by none and some by two."""
    motion = counted(count, 1.0 / 3.0)
    spans = [(start, end) for start, end, _ in motion.stills()]
    assert len(spans) == 4
    assert np.abs(np.array(spans) - [(0, 1), (2, 3), (4, 5), (5.75, 7)]).max() < 0.25


def test_the_path_departs_by_less_than_the_tolerance():
    t = np.arange(0.0, 7.0, 0.01)
    q = np.stack([3e-3 * np.sin(t), 2e-3 * np.cos(2.0 * t)], axis=1)
    corners = corners_of(t, q, 2e-5)
    line = np.stack([np.interp(t, t[corners], c[corners]) for c in q.T], axis=1)
    assert np.abs(line - q).max() <= 2e-5
    assert len(corners) < 200


def test_the_number_of_corners_is_bounded():
    t = np.arange(0.0, 7.0, 0.001)
    q = 1e-3 * stream(1, 'rough').standard_normal((len(t), 2))
    assert len(corners_of(t, q, 0.0, most=50)) <= 52


def test_stands_and_ramps():
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.75, 7.0])
    motion = Motion(t, path(t)[:, None], 1e-5, 1e-4)
    assert motion.still.tolist() == [True, False, True, False, True, False, True]
    assert motion.stills() == ((0.0, 1.0, False), (2.0, 3.0, True), (4.0, 5.0, True),
                               (5.75, 7.0, False))
    assert motion.velocity[[1, 3, 5], 0] == pytest.approx([4e-3, 2e-3, -8e-3])


def test_a_ramp_goes_on_through_its_acceleration_and_ends_at_a_reversal():
    t = np.array([0.0, 1.0, 1.1, 2.0, 2.1, 3.0, 4.0])
    q = 1e-3 * np.array([0.0, 0.0, 0.2, 3.8, 4.0, 0.0, 0.0])
    phases = Motion(t, q[:, None], 1e-5, 1e-4).phases()
    assert phases == ((0, 1), (1, 4), (4, 5), (5, 6))
