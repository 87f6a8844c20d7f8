"""Slip: one marker, from the onset on, by the given vector, in the optical stream alone."""

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.term import Stage
from arm_brachy.devices.optical_tracker import OpticalParams, OpticalTracker
from arm_brachy.devices.terms.marker_slip import MarkerSlip

NAMES = ('m00', 'm01', 'm02')
TERM = MarkerSlip(marker='m01', onset=0.5, offset=(1e-3, 0.0, -2e-3))
NO_PADS = np.zeros((0, 3))


def test_confined_to_one_marker_from_the_onset():
    """Twin runs with one seed differ by the vector, in one row, from the onset on; to rounding."""
    points = np.arange(9.0).reshape(3, 3)
    with_term, without = (
        OpticalTracker(OpticalParams(), NAMES, terms, np.random.default_rng(3)).advance(
            0.0, points, 1.0, points, NO_PADS, NO_PADS) for terms in ((TERM,), ()))
    for a, b in zip(with_term, without, strict=True):
        np.testing.assert_array_equal(a.visible, b.visible)
        expected = np.zeros((3, 3))
        if a.t >= 0.5:
            expected[1] = TERM.offset
        expected[~a.visible] = np.nan
        np.testing.assert_allclose(a.points - b.points, expected, atol=1e-14)
    assert [a.t for a in with_term][49] == 0.5


def test_by_index_or_by_name():
    by_index = MarkerSlip(marker=1, onset=0.5, offset=TERM.offset)
    values = np.zeros((3, 3))
    np.testing.assert_array_equal(by_index.distort(1.0, NAMES, values, NO_PADS),
                                  TERM.distort(1.0, NAMES, values, NO_PADS))
    np.testing.assert_array_equal(values, 0.0)


@pytest.mark.parametrize('marker', ['m09', 3, -1])
def test_unknown_marker_is_refused(marker):
    with pytest.raises(ConfigError, match='must be one of m00, m01, m02 or an index 0 to 2'):
        MarkerSlip(marker=marker).distort(0.0, NAMES, np.zeros((3, 3)), NO_PADS)


def test_acts_on_the_optical_stream():
    assert MarkerSlip.spec.stage is Stage.OPTICAL
