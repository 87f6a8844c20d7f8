"""EM offset: a constant vector on the named tools, in position alone."""

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.term import Stage
from arm_brachy.devices.em_tracker import EmTracker, EmTrackerParams, ToolStatus
from arm_brachy.devices.terms.em_offset import EmOffset

TOOLS = ('target_1', 'target_2', 'needle')
NO_PADS = np.zeros((0, 3))
TURNS = np.tile(np.eye(3), (3, 1, 1))
START = np.array([[0.0, 0.0, 0.02], [0.015, 0.007, 0.027], [0.0, 0.05, 0.06]])
END = START + [[0.005, 0.0, 0.0], [0.0, -0.003, 0.002], [0.02, 0.0, -0.01]]
OFFSET = (8e-4, -3e-4, 5e-4)


def _samples(*terms, shift=0.0):
    """A second of three tools in motion, all moved to the side by `shift` [m]."""
    tracker = EmTracker(EmTrackerParams(), TOOLS, terms, np.random.default_rng(5))
    aside = np.array([shift, 0.0, 0.0])
    return tracker.advance(0.0, START + aside, TURNS, 1.0, END + aside, TURNS, NO_PADS, NO_PADS)


def test_named_tools_are_seen_aside_by_the_vector():
    """Twin runs with one seed: the difference is the vector, in two tools of three."""
    seen = _samples(EmOffset(offset=OFFSET, tools=('target_1', 'needle')))
    for a, b in zip(seen, _samples(), strict=True):
        assert (a.t, a.tool, a.quality) == (b.t, b.tool, b.quality)
        np.testing.assert_array_equal(a.quaternion, b.quaternion)
        expected = np.zeros(3) if a.tool == 'target_2' else OFFSET
        np.testing.assert_allclose(a.position - b.position, expected, atol=1e-15)


def test_displacements_and_distances_do_not_show_it():
    """Why it cannot be seen from motion: it drops out of every difference."""
    def shape(samples):
        xx = np.array([s.position for s in samples]).reshape(-1, 3, 3)
        return np.concatenate([xx - xx[0], xx - xx[:, :1]])
    np.testing.assert_allclose(shape(_samples(EmOffset(offset=OFFSET))), shape(_samples()),
                               atol=1e-15)


def test_the_measurement_volume_goes_by_where_the_tool_is():
    """Just inside the half width of 250 mm; the apparent place, outside, is reported."""
    samples = _samples(EmOffset(offset=(0.05, 0.0, 0.0)), shift=0.22)
    assert {s.status for s in samples} == {ToolStatus.OK}
    assert max(s.position[0] for s in samples) > 0.25


def test_unknown_tool_is_refused():
    with pytest.raises(ConfigError, match='em_offset: tools = .*probe must be among target_1, '):
        _samples(EmOffset(tools=('probe',)))


def test_acts_on_the_em_stream():
    assert EmOffset().stage is Stage.EM
