"""Yielding actuators against tissue: the force is one tick late, the balance is not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from arm_brachy import cell as cells
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.devices.actuator import ActuatorParams, SimulatedBank
from arm_brachy.devices.terms.actuator_compliance import ActuatorCompliance
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

SCENES = config_dir() / 'scenes'
EXACT = replace(ActuatorParams(), encoder_resolution=0.0, effort_noise=0.0)
TICK = 0.05


def make_body(terms=(), **changes):
    """The coarse breast with linear elements; `changes` of its pads."""
    scene = with_mesh(load_scene(SCENES / 'breast.yaml'), str(SCENES / 'breast/breast_600.msh'))
    pads = tuple(replace(pad, **changes) for pad in scene.pads)
    scene = replace(scene, element='linear', pads=pads)
    return cells.Body(scene, terms), cells.pad_directions(scene)


def push(terms, body_and_directions, moves, ticks=60):
    """Drive bank and body as the cell does; `moves` maps a tick to targets (4,) [m].

    Returns motors, pads [m] and forces pushing back [N], each (ticks, 4).
    """
    body, directions = body_and_directions
    bank = SimulatedBank(body.pad_names, [0.03] * 4, EXACT, terms, homed=True)
    bank.connect()
    effort, log = None, []
    for k in range(1, ticks + 1):
        if k in moves:
            bank.move(moves[k])
        state = bank.read(k * TICK, effort)
        reading = body.step(k * TICK, state.pad)
        assert reading.outcome is Outcome.OK
        effort = cells.push_back(reading.pad_force, directions)
        log.append((state.q, state.pad, effort))
    return tuple(np.array(values) for values in zip(*log, strict=True))


ONE = {1: [0.01, 0.0, 0.0, 0.0]}
IN_TURN = {1: [0.01, 0.0, 0.0, 0.0], 20: [0.01, 0.01, 0.0, 0.0], 40: [0.004, 0.01, 0.008, 0.0]}


def test_one_yielding_pad_stops_where_a_root_finder_puts_it():
    """Equilibrium found without bank or ticks: settle the tissue at trial positions."""
    compliance = 1e-3
    term = ActuatorCompliance(compliance=compliance, actuators=(0,))
    _, pads, _ = push((term,), make_body(), ONE)

    def imbalance(y):
        body, directions = make_body()
        reading = body.step(TICK, [y, 0.0, 0.0, 0.0])   # the first step settles
        return y - 0.01 + compliance * cells.push_back(reading.pad_force, directions)[0]
    assert pads[-1, 0] == pytest.approx(brentq(imbalance, 0.003, 0.009, xtol=1e-8), abs=1e-7)


@pytest.mark.parametrize('compliance', [
    1.25e-4, pytest.param(1e-3, marks=pytest.mark.validate), 1e-2])
@pytest.mark.parametrize('contact', ['bonded', 'touching'])
def test_motors_pads_and_forces_balance_at_rest(compliance, contact):
    """Up to eighty times the usual compliance: ten times as soft as the tissue under a pad."""
    term = ActuatorCompliance(compliance=compliance)
    motors, pads, forces = push((term,), make_body(contact=contact), IN_TURN, ticks=70)
    np.testing.assert_allclose(motors[-1] - pads[-1], compliance * forces[-1], atol=1e-7)
    assert forces[-1].max() > 0.5


def test_the_tissue_is_stiff_enough_for_the_plain_feedback_to_run_away():
    """What the term has to cope with: compliance times stiffness passes one at 1 mm/N."""
    motors, _, forces = push((), make_body(), ONE)
    stiffness = np.diff(forces[:15, 0]) / np.diff(motors[:15, 0])
    assert 700.0 < stiffness.min() and stiffness.max() > 1000.0


def test_while_moving_it_is_off_by_less_than_the_motors_lag():
    """Worst imbalance on the way, in travel, against speed times servo time constant (0.2 mm)."""
    compliance = 1.25e-4
    motors, pads, forces = push((ActuatorCompliance(compliance=compliance),), make_body(), IN_TURN)
    off = np.abs(motors - pads - compliance * forces).max()
    assert off < 0.25 * EXACT.max_speed * EXACT.servo_time_constant


def test_relaxing_tissue_lets_the_pads_out():
    """Nearly 4 s of hold: forces fall, pads follow, one tick late.

    An imbalance r turns into c dF + r c k / (1 + c k) in a tick in which the force changes by dF:
    c dF (1 + c k) in the long run, with k below 2 N/mm.
    """
    compliance = 1e-3
    motors, pads, forces = push((ActuatorCompliance(compliance=compliance),),
                                make_body((Viscoelasticity(),)), ONE, ticks=100)
    hold = slice(25, None)
    assert np.ptp(motors[hold], axis=0).max() < 1e-9
    assert forces[-1, 0] < forces[25, 0] - 0.05
    assert (np.diff(pads[hold, 0]) > 0.0).all()
    off = np.abs(motors - pads - compliance * forces)[hold, 0]
    late = compliance * np.abs(np.diff(forces[24:, 0])) * (1.0 + compliance * 2000.0)
    assert (off < late + 1e-8).all()
