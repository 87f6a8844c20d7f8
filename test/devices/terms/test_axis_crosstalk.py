"""Cross-talk between the axes of a force sensor: the matrix, what a turn is of it, and a gain."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.term import Stage
from arm_brachy.devices.force_sensor import ForceSensor, ForceSensorParams
from arm_brachy.devices.terms.axis_crosstalk import AxisCrosstalk
from arm_brachy.devices.terms.force_gain import ForceGain
from arm_brachy.registry import parse_terms

PADS = ('pad_1', 'pad_2')
EXACT = replace(ForceSensorParams(), noise=0.0, moment_noise=0.0, resolution=0.0,
                moment_resolution=0.0)
FORCES = np.array([[1.0, -2.0, 0.5], [0.0, 4.0, -3.0]])
MOMENTS = np.array([[0.01, 0.0, -0.02], [0.0, 0.003, 0.0]])
REST = np.zeros((2, 3))


def shown(*terms, forces=FORCES):
    """Forces (2, 3) and moments (2, 3) of one sample under a constant load."""
    sensor = ForceSensor(EXACT, PADS, terms, np.random.default_rng(2))
    samples = sensor.advance(0.0, forces, MOMENTS, 0.01, forces, MOMENTS, REST, REST)
    return np.array([s.force for s in samples]), np.array([s.moment for s in samples])


def test_shares_of_each_axis_show_in_the_next_and_the_one_before():
    term, = parse_terms([{'name': 'axis_crosstalk', 'onward': [0.1, 0.2, 0.3],
                          'backward': [0.4, 0.5, 0.6], 'pads': ['pad_2']}], 'test')
    x, y, z = FORCES[1]
    forces, moments = shown(term)
    np.testing.assert_allclose(forces[1], [x + 0.3 * z + 0.5 * y, y + 0.1 * x + 0.6 * z,
                                           z + 0.2 * y + 0.4 * x], atol=1e-14)
    np.testing.assert_array_equal(forces[0], FORCES[0])
    np.testing.assert_array_equal(moments, MOMENTS)


def test_a_small_turn_is_one():
    w = np.array([0.02, -0.05, 0.03])
    term = AxisCrosstalk(onward=w[[2, 0, 1]], backward=-w[[1, 2, 0]])
    turned = Rotation.from_rotvec(w).apply(FORCES)
    np.testing.assert_allclose(shown(term)[0], turned, atol=0.6 * 5.0 * (w @ w))
    assert np.abs(turned - FORCES).max() > 0.05


def test_under_a_load_along_a_diagonal_some_of_it_is_a_gain():
    n = np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0)
    loads = np.array([3.0 * n, np.zeros(3)])
    term = AxisCrosstalk(onward=(0.0, 0.0, 0.08), backward=(0.08, 0.0, 0.0))
    np.testing.assert_allclose(shown(term, forces=loads)[0],
                               shown(ForceGain(gain=-0.08), forces=loads)[0], atol=1e-14)


def test_unknown_pad_is_refused():
    with pytest.raises(ConfigError,
                       match='axis_crosstalk: pads = .*pad_9 must be among pad_1, pad_2'):
        shown(AxisCrosstalk(pads=('pad_9',)))


def test_acts_on_the_force_stream():
    assert AxisCrosstalk().stage is Stage.FORCE
