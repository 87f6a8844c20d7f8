"""What a careful laboratory leaves of the axes of a force sensor is a turn: it makes no gain."""

import numpy as np
import pytest

from arm_brachy.diagnosis.likelihood.tolerances import tolerances
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.linearised import Baseline


def test_axes_of_a_force_sensor_turn_what_it_shows_and_stretch_nothing(linear, encoder):
    baseline = Baseline(ForwardModel(linear), encoder, np.array([2.5, 4.5]))
    found = tolerances(baseline)
    turn = found.values['force'][..., found.names.index(f'axes_{linear.pads[0]}_z')]
    force = baseline.shown['force']
    assert np.abs(np.sum(force * turn, axis=2)).max() < 1e-15
    assert not turn[:, 1:].any()
    assert np.linalg.norm(turn[:, 0], axis=1) == pytest.approx(
        np.radians(0.5) * np.linalg.norm(force[:, 0, :2], axis=1), rel=1e-9)
    assert not found.values['optical'][..., found.names.index(f'axes_{linear.pads[0]}_z')].any()
