"""Cells zeroed under the weight of a body are told from cells that show it."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.diagnosis.likelihood.force_tare import loosened, note, tared
from arm_brachy.diagnosis.likelihood.observation import Measured
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.stream import FORCE, OPTICAL

PADS = ('a', 'b', 'c')
HEAVY, LIGHT = (SimpleNamespace(pads=PADS, scene=SimpleNamespace(gravity=(0.0, 0.0, g)))
                for g in (-9.81, 0.0))
WEIGHT = np.array([[0.0, 0.1, -0.9], [0.2, 0.0, -0.8], [0.0, 0.0, 0.7]])    # N
ZERO = 0.03 * np.array([[1.0, -1.0, 0.5], [-0.5, 1.0, 0.2], [0.3, 0.1, -1.0]])


def forces(read, names=PADS, along=None):
    """Measured of two states, the second at rest, where cells read (c, d) [N]."""
    values = np.stack([np.full_like(read, 5.0), read])
    return Measured(FORCE, names, values, np.ones(values.shape[:2], bool),
                    np.full(values.shape, 0.01), np.eye(2), along=along)


@pytest.mark.parametrize(('read', 'under'), [
    (ZERO, True), (WEIGHT + ZERO, False), (0.8 * WEIGHT, False), (-WEIGHT, False)])
def test_what_is_read_at_rest_says_whether_cells_were_zeroed_under_the_weight(read, under):
    found = tared([forces(read)], WEIGHT, 1, HEAVY, None)
    assert (found is not None) == under


def test_a_weight_that_a_zero_may_hide_is_left_to_the_zero():
    assert tared([forces(0.0 * ZERO)], 0.05 * WEIGHT, 1, HEAVY, None) is None
    assert tared([forces(ZERO)], WEIGHT, 1, HEAVY, Calibration(force_zero=0.5)) is None


def test_what_presses_without_gravity_is_no_weight():
    assert tared([forces(ZERO)], WEIGHT, 1, LIGHT, None) is None


def test_cells_of_one_axis_and_of_some_pads_are_asked_for_what_they_see():
    along = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    some = forces(ZERO[1:, 2:], ('b', 'c'), along)
    assert tared([some], WEIGHT, 1, HEAVY, None) is WEIGHT
    aside = forces(ZERO[1:, 2:], ('b', 'c'), np.array([[0.0, 1.0, 0.0]] * 2))
    assert tared([aside], WEIGHT, 1, HEAVY, None) is None
    assert tared([Measured(OPTICAL, ('m',), *[np.zeros((1, 1, 3))] * 3, np.eye(1))], WEIGHT, 0,
                 HEAVY, None) is None


def test_their_zero_is_known_no_better_than_the_weight():
    assert loosened(Calibration(gain=0.5), WEIGHT) == Calibration(gain=0.5, force_zero=0.9)
    assert 'monday' in note('monday', WEIGHT) and '0.91 N' in note('monday', WEIGHT)
