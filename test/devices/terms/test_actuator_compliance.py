"""Compliance against springs in closed form, with the force one step late as in the cell."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from arm_brachy.core.errors import ConfigError
from arm_brachy.devices.actuator import ActuatorParams, SimulatedBank
from arm_brachy.devices.terms.actuator_compliance import ActuatorCompliance
from arm_brachy.devices.terms.actuator_gain import ActuatorGain

EXACT = replace(ActuatorParams(), encoder_resolution=0.0, effort_noise=0.0)
TICK = 0.05


def _push(term, targets, force, seconds=3.0):
    """Send a bank to `targets` against force(t, pads); returns encoders and pads (k, n)."""
    n = len(targets)
    bank = SimulatedBank([f'pad_{i}' for i in range(n)], [0.03] * n, EXACT, (term,), homed=True)
    bank.connect()
    bank.move(targets)
    effort, states = np.zeros(n), []
    for k in range(1, round(seconds / TICK) + 1):
        states.append(bank.read(k * TICK, effort))
        effort = force(k * TICK, states[-1].pad)
    return np.array([s.q for s in states]), np.array([s.pad for s in states])


def _coupled_springs(n, largest, seed):
    """Stiffness (n, n) [N/m], symmetric, eigenvalues from a tenth of `largest` on."""
    Q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((n, n)))
    return Q @ np.diag(np.geomspace(0.1 * largest, largest, n)) @ Q.T


@pytest.mark.parametrize('ratio', [0.1, 1.0, 3.0, 30.0])
def test_pads_come_to_rest_where_springs_in_series_balance(ratio):
    """(I + c K) y = u for pads coupled through the tissue, far beyond c K = 1."""
    compliance = 5e-4
    for seed in range(5):
        K = _coupled_springs(4, ratio / compliance, seed)
        u = np.array([0.01, 0.004, 0.007, 0.0])
        _, pads = _push(ActuatorCompliance(compliance=compliance), u, lambda t, y, K=K: K @ y)
        balance = np.linalg.solve(np.eye(4) + compliance * K, u)
        np.testing.assert_allclose(pads[-1], balance, atol=1e-7)


@pytest.mark.parametrize('ratio', [0.05, 0.9, 5.0])
def test_on_one_linear_spring_there_is_no_lag(ratio):
    """From the third step on, moving or not; two steps are needed to learn the stiffness."""
    k = 800.0
    q, pads = _push(ActuatorCompliance(compliance=ratio / k), [0.02], lambda t, y: k * y)
    np.testing.assert_allclose(pads[2:], q[2:] / (1.0 + ratio), atol=1e-14)


@pytest.mark.parametrize('compliance', [1e-4, 1e-3, 1e-2])
def test_tissue_that_stiffens(compliance):
    def force(t, y):
        return 500.0 * y + 4e6 * y**3
    _, pads = _push(ActuatorCompliance(compliance=compliance), [0.02], force)
    root = brentq(lambda y: y - 0.02 + compliance * force(0.0, y), 0.0, 0.02, xtol=1e-15)
    assert pads[-1, 0] == pytest.approx(root, abs=1e-12)


def test_a_pad_that_finds_its_tissue_late():
    """Nothing pushes back before a gap is crossed: no yield until then, balance after."""
    compliance, k, gap = 2e-3, 1000.0, 0.006

    def force(t, y):
        return k * np.maximum(y - gap, 0.0)
    q, pads = _push(ActuatorCompliance(compliance=compliance), [0.015], force)
    before = q[:, 0] < gap
    np.testing.assert_array_equal(pads[before], q[before])
    assert pads[-1, 0] == pytest.approx((0.015 + compliance * k * gap) / (1 + compliance * k),
                                        abs=1e-10)


def test_while_tissue_relaxes_the_pad_is_one_step_late():
    """F = k y - r t at rest: balance y = (u + c r t) / (1 + c k), met at the time before."""
    compliance, k, relaxing = 1e-3, 1500.0, 0.3
    q, pads = _push(ActuatorCompliance(compliance=compliance), [0.01],
                    lambda t, y: k * y - relaxing * max(t - 1.5, 0.0), seconds=4.0)
    t = TICK * np.arange(1, len(q) + 1)
    late = t > 1.5 + TICK
    balance = (q[:, 0] + compliance * relaxing * (t - TICK - 1.5)) / (1.0 + compliance * k)
    np.testing.assert_allclose(pads[late, 0], balance[late], atol=1e-12)


def test_one_pad_on_a_linear_spring_is_a_gain():
    """What makes the two indistinguishable: 1 + g = 1 / (1 + c k)."""
    k, compliance = 900.0, 1.25e-4
    _, yielding = _push(ActuatorCompliance(compliance=compliance), [0.02], lambda t, y: k * y)
    gain = 1.0 / (1.0 + compliance * k) - 1.0
    _, scaled = _push(ActuatorGain(gain=gain), [0.02], lambda t, y: k * y)
    np.testing.assert_allclose(yielding[2:], scaled[2:], atol=1e-14)


def test_a_pull_draws_the_pad_out():
    """Linear both ways: bonded tissue that pulls makes the pad go further."""
    _, pads = _push(ActuatorCompliance(compliance=1e-4), [0.01], lambda t, y: np.array([-3.0]))
    assert pads[-1, 0] == pytest.approx(0.01 + 3e-4, abs=1e-12)


def test_a_soft_pad_is_pushed_out_by_its_neighbour_without_shooting_past():
    """Ten times as soft as the tissue, while only the other, rigid pad moves."""
    K, compliance = np.array([[1000.0, 250.0], [250.0, 1000.0]]), 1e-2
    _, pads = _push(ActuatorCompliance(compliance=compliance, actuators=(1,)), [0.01, 0.0],
                    lambda t, y: K @ y)
    rest = -compliance * K[1, 0] * 0.01 / (1.0 + compliance * K[1, 1])
    assert pads[-1, 1] == pytest.approx(rest, rel=1e-9)
    assert pads[:, 1].min() > 1.02 * rest


def test_only_the_named_actuators_yield():
    K = _coupled_springs(3, 1500.0, seed=2)
    u = np.array([0.01, 0.004, 0.007])
    q, pads = _push(ActuatorCompliance(compliance=2e-3, actuators=(1,)), u, lambda t, y: K @ y)
    np.testing.assert_array_equal(pads[:, [0, 2]], q[:, [0, 2]])
    yielding = (u[1] - 2e-3 * (K[1, 0] * u[0] + K[1, 2] * u[2])) / (1.0 + 2e-3 * K[1, 1])
    assert pads[-1, 1] == pytest.approx(yielding, abs=1e-9)
    with pytest.raises(ConfigError, match=r'actuator_compliance: actuators = \[3\]'):
        _push(ActuatorCompliance(actuators=(3,)), u, lambda t, y: K @ y)
