"""Gain and offset through the bank: the pad along a straight line, the encoder as it was."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.devices.actuator import ActuatorParams, SimulatedBank
from arm_brachy.devices.terms.actuator_gain import ActuatorGain
from arm_brachy.devices.terms.backlash import Backlash

NAMES = ('pad_1', 'pad_2', 'pad_3')
EXACT = replace(ActuatorParams(), encoder_resolution=0.0, effort_noise=0.0)
TARGETS = ([0.02, 0.01, 0.015], [0.005, 0.012, 0.0])


def _travel(*terms):
    """States of a bank that is sent to both targets, read every 50 ms."""
    bank = SimulatedBank(NAMES, [0.03] * 3, EXACT, terms, homed=True)
    bank.connect()
    states = []
    for k in range(1, 101):
        if k in (1, 51):
            bank.move(TARGETS[k // 51])
        states.append(bank.read(0.05 * k))
    return states


def test_slope_and_intercept_of_pad_over_encoder():
    """Least squares over a whole trip: what a bench with a dial gauge would find."""
    states = _travel(ActuatorGain(gain=-0.04, offset=3e-4))
    for i in range(3):
        slope, intercept = np.polyfit([s.q[i] for s in states], [s.pad[i] for s in states], 1)
        assert slope == pytest.approx(0.96, abs=1e-12)
        assert intercept == pytest.approx(3e-4, abs=1e-14)


def test_the_encoder_and_the_other_actuators_know_nothing_of_it():
    with_term, without = _travel(ActuatorGain(actuators=(1,), offset=1e-3)), _travel()
    for a, b in zip(with_term, without, strict=True):
        np.testing.assert_array_equal(a.q, b.q)
        np.testing.assert_array_equal(a.pad[[0, 2]], b.pad[[0, 2]])
        assert a.pad[1] == pytest.approx(1.06 * b.pad[1] + 1e-3, abs=1e-16)


def test_play_behind_the_gain_keeps_its_width():
    """Gain is of the motor's side: play on the pad's side stays as wide as it is."""
    width, gain = 5e-4, 0.1
    end = _travel(ActuatorGain(gain=gain), Backlash(width=width))[49]
    np.testing.assert_allclose((1.0 + gain) * end.q - end.pad, width, atol=1e-12)


def test_unknown_actuator_is_refused_when_the_bank_is_made():
    with pytest.raises(ConfigError, match=r'actuator_gain: actuators = \[3\]; must be .* 0 to 2'):
        _travel(ActuatorGain(actuators=(3,)))
