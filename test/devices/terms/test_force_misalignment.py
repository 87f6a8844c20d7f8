"""Turned axes of a force sensor: what is kept, what cross-talk it is, and what it is not."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.term import Stage
from arm_brachy.devices.force_sensor import ForceSensor, ForceSensorParams
from arm_brachy.devices.terms.force_misalignment import ForceMisalignment
from arm_brachy.registry import parse_terms

PADS = ('pad_1', 'pad_2')
EXACT = replace(ForceSensorParams(), noise=0.0, moment_noise=0.0, resolution=0.0,
                moment_resolution=0.0)
FORCES = np.array([[1.0, -2.0, 0.5], [0.0, 4.0, -3.0]])
MOMENTS = np.array([[0.01, 0.0, -0.02], [0.0, 0.003, 0.0]])
REST = np.zeros((2, 3))
TURN = (0.02, -0.05, 0.03)


def shown(*terms, forces=FORCES):
    """Forces (2, 3) and moments (2, 3) of one sample under a constant load."""
    sensor = ForceSensor(EXACT, PADS, terms, np.random.default_rng(2))
    samples = sensor.advance(0.0, forces, MOMENTS, 0.01, forces, MOMENTS, REST, REST)
    return np.array([s.force for s in samples]), np.array([s.moment for s in samples])


def test_a_quarter_turn_about_z_shows_x_as_y():
    term, = parse_terms([{'name': 'force_misalignment', 'turn_deg': [0.0, 0.0, 45.0]}], 'test')
    forces, _ = shown(term, term)
    np.testing.assert_allclose(forces, FORCES[:, [1, 0, 2]] * [-1.0, 1.0, 1.0], atol=1e-12)


def test_the_named_pad_alone_is_turned_in_length_and_angles_as_it_was():
    forces, moments = shown(ForceMisalignment(turn=TURN, pads=('pad_2',)))
    np.testing.assert_array_equal(forces[0], FORCES[0])
    np.testing.assert_array_equal(moments, MOMENTS)
    assert np.linalg.norm(forces[1]) == pytest.approx(5.0, rel=1e-12)
    assert forces[1] @ TURN == pytest.approx(FORCES[1] @ TURN, abs=1e-12)
    across = np.cross(TURN, FORCES[1])
    np.testing.assert_allclose(forces[1] - FORCES[1], across, atol=5.0 * np.dot(TURN, TURN))
    assert np.linalg.norm(across) > 0.1


def test_the_opposite_turn_undoes_it():
    back = ForceMisalignment(turn=tuple(-np.array(TURN)))
    np.testing.assert_allclose(shown(ForceMisalignment(turn=TURN), back)[0], FORCES, atol=1e-14)


def test_under_a_load_of_one_direction_it_is_cross_talk_and_across_it_is_not():
    """C n is shown whatever C is; the answer to a force across has C's other half."""
    crosstalk = np.array([[0.0, 0.05, 0.0], [0.0, 0.0, 0.0], [0.0, 0.08, 0.0]])  # from y
    n = np.array([0.0, 1.0, 0.0])
    turn = np.cross(n, crosstalk @ n)
    loads = np.array([3.0 * n, [0.2, 0.0, 0.0]])
    told = shown(ForceMisalignment(turn=tuple(turn)), forces=loads)[0] - loads
    second = np.linalg.norm(turn)**2
    np.testing.assert_allclose(told[0], crosstalk @ loads[0], atol=3.0 * second)
    np.testing.assert_allclose(told[1], np.cross(turn, loads[1]), atol=0.2 * second)
    assert not np.allclose(told[1], crosstalk @ loads[1], atol=0.2 * second)


def test_unknown_pad_is_refused():
    with pytest.raises(ConfigError,
                       match='force_misalignment: pads = .*pad_9 must be among pad_1, pad_2'):
        shown(ForceMisalignment(pads=('pad_9',)))


def test_acts_on_the_force_stream():
    assert ForceMisalignment().stage is Stage.FORCE
