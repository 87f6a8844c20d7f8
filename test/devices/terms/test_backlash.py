"""Play: loop width, loop area, independence of rate, memory of reversals only."""

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.devices.terms.backlash import Backlash

WIDTH = 5e-4
TERM = Backlash(width=WIDTH)
NO_LOAD = np.zeros(1)


def _follow(term, u, dt=0.02):
    memory = term.memory(u[:1])
    out = [float(memory[0])]
    for k, value in enumerate(u[1:]):
        y, memory = term.step(memory, np.array([value]), NO_LOAD, (k + 1) * dt, dt)
        out.append(float(y[0]))
    return np.array(out)


def _there_and_back(amplitude, n):
    up = np.linspace(0.0, amplitude, n)
    return np.concatenate([up, up[-2::-1], up[1:], up[-2::-1]])


def test_pushing_lags_by_the_width_and_retracting_does_not():
    u = _there_and_back(0.01, 101)
    y = _follow(TERM, u)
    np.testing.assert_allclose(y[100], 0.01 - WIDTH, atol=1e-15)
    np.testing.assert_allclose(y[200], 0.0, atol=1e-15)
    assert ((y >= u - WIDTH - 1e-15) & (y <= u + 1e-15)).all()


def test_loop_area_is_width_times_inner_travel():
    """Closed loop of the play operator: area w (A - w), the parallelogram of height A - w."""
    amplitude, n = 0.01, 2001
    u = _there_and_back(amplitude, n)
    y = _follow(TERM, u)
    loop = slice(2 * (n - 1), None)  # the second cycle is closed
    area = -np.trapezoid(y[loop], u[loop])
    assert area == pytest.approx(WIDTH * (amplitude - WIDTH), rel=1e-3)


def test_rate_and_sampling_do_not_matter():
    """Any monotone re-timing of the same path ends at the same place, to the bit."""
    turning = [0.0, 0.01, 0.004, 0.0062, 0.0061, 0.02, 0.0]
    ends = []
    for n in (2, 7, 50):
        u = np.concatenate([[0.0]] + [np.linspace(a, b, n)[1:] for a, b in
                                      zip(turning, turning[1:], strict=False)])
        y = _follow(TERM, u, dt=0.5 / n)
        ends.append(y[::n - 1])
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-16)
    np.testing.assert_allclose(ends[2], ends[0], atol=1e-16)


def test_motion_inside_the_play_moves_nothing():
    u = 0.01 - 0.9 * WIDTH * np.abs(np.sin(np.linspace(0.0, 20.0, 400)))
    y = _follow(TERM, np.concatenate([np.linspace(0.0, 0.01, 50), u]))
    assert np.ptp(y[50:]) < 1e-15


def test_acts_on_the_named_actuators_only():
    term = Backlash(width=WIDTH, actuators=(1,))
    y, _ = term.step(term.memory(np.zeros(3)), np.full(3, 0.01), np.zeros(3), 0.02, 0.02)
    np.testing.assert_allclose(y, [0.01, 0.01 - WIDTH, 0.01])
    with pytest.raises(ConfigError, match='actuators'):
        term.memory(np.zeros(1))


def test_memory_is_not_shared():
    memory = TERM.memory(np.zeros(1))
    y, after = TERM.step(memory, np.array([0.01]), NO_LOAD, 0.02, 0.02)
    y[:] = 1.0
    assert after[0] == pytest.approx(0.01 - WIDTH)
    assert memory[0] == 0.0


@pytest.mark.parametrize('start', [0.0, 0.3, 1.0])
def test_a_bank_that_begins_inside_its_gap_goes_past_its_place_on_the_way_back(start):
    y = _follow(Backlash(width=WIDTH, start=start), _there_and_back(0.01, 101))
    np.testing.assert_allclose(y[[0, 100, 200]],
                               [0.0, 0.01 - (1.0 - start) * WIDTH, start * WIDTH], atol=1e-15)
