"""Lost steps: one pad, from the onset on, by the given length, for good."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.devices.actuator import ActuatorParams, SimulatedBank
from arm_brachy.devices.terms.lost_steps import LostSteps

NAMES = ('pad_1', 'pad_2', 'pad_3')
EXACT = replace(ActuatorParams(), encoder_resolution=0.0, effort_noise=0.0)


def _push_then_home(*terms):
    """States of a bank that pushes for 2 s, homes for 5 s and pushes again."""
    bank = SimulatedBank(NAMES, [0.03] * 3, EXACT, terms, homed=True)
    bank.connect()
    states = []
    for k in range(1, 201):
        if k == 41:
            bank.home()
        elif k in (1, 141):
            bank.move([0.02, 0.01, 0.015])
        states.append(bank.read(0.05 * k))
    return states


def test_one_pad_stands_short_from_the_onset_on():
    lost = _push_then_home(LostSteps(onset=1.0, shortfall=8e-4, actuators=(1,)))
    for a, b in zip(lost, _push_then_home(), strict=True):
        expected = [0.0, 8e-4 if a.t >= 1.0 else 0.0, 0.0]
        np.testing.assert_allclose(b.pad - a.pad, expected, atol=1e-16)
        np.testing.assert_array_equal(a.q, b.q)


def test_homing_does_not_mend_it():
    states = _push_then_home(LostSteps(onset=1.0, shortfall=8e-4))
    assert states[139].homed.all() and states[139].t > 5.0
    np.testing.assert_allclose(states[139].pad, -8e-4, atol=1e-9)
    np.testing.assert_allclose(states[-1].pad, np.array([0.02, 0.01, 0.015]) - 8e-4, atol=1e-9)


def test_two_slips_add_up():
    first, second = LostSteps(onset=0.5, shortfall=3e-4), LostSteps(onset=1.5, shortfall=-1e-4)
    with_both, without = _push_then_home(first, second), _push_then_home()
    short = [b.pad[0] - a.pad[0] for a, b in zip(with_both, without, strict=True)]
    np.testing.assert_allclose(short, 3e-4 * (np.arange(1, 201) >= 10)
                               - 1e-4 * (np.arange(1, 201) >= 30), atol=1e-16)


def test_unknown_actuator_is_refused_when_the_bank_is_made():
    with pytest.raises(ConfigError, match=r'lost_steps: actuators = \[-1\]; must be .* 0 to 2'):
        _push_then_home(LostSteps(actuators=(-1,)))
