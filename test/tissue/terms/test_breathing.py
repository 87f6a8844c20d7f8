"""Breathing is a moving frame: rigid with nothing to hold on to, else pads that move back."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.tissue.body import Pad, PadFace, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicOptions
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.base_compliance import BaseCompliance
from arm_brachy.tissue.terms.base_debond import BaseDebond
from arm_brachy.tissue.terms.breathing import Breathing
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

BREATH = Breathing(amplitude=2e-3, frequency=0.5, phase=0.7, direction=(0.3, -0.2, 1.0))
NO_PADS = np.zeros((0, 3))


def block(pad=False, E=6e3, gravity=9.81, **extra):
    """Block of 40 x 40 x 30 mm, held below, if asked a disc on its top."""
    mesh = box_mesh((0.04, 0.04, 0.03), (4, 4, 3))
    m, (mu, kappa) = len(mesh.tets), moduli(E, 0.45)
    top = mesh.node_sets['z1']
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - 0.02, axis=1) < 0.0101]
    pads = (Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([0.02, 0.02, 0.03]), 0.02),)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], pads if pad else (),
                    gravity=np.array([0.0, 0.0, -gravity]), **extra)


def base_at(t, breath=BREATH):
    """Displacement (3,) [m] of the base."""
    e = np.array(breath.direction) / np.linalg.norm(breath.direction)
    return breath.amplitude * np.sin(2.0 * np.pi * breath.frequency * t + breath.phase) * e


@pytest.mark.parametrize('supports', [
    (), (BaseCompliance(),), (BaseDebond(0.012, (0.02, 0.02, 0.0)),)],
    ids=['fixed', 'compliant', 'debonded'])
def test_without_pads_everything_moves_rigidly(supports):
    still = TissueSimulator(block(), supports).settle().x
    plant = TissueSimulator(block(), (*supports, BREATH))
    states = [plant.settle(), *(plant.step(t, NO_PADS) for t in (0.1, 0.37, 1.0, 1.9))]
    for state in states:
        assert state.outcome.ok
        np.testing.assert_allclose(state.base, base_at(state.t), rtol=1e-12)
        np.testing.assert_allclose(state.x - state.base, still, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize('face', [None, PadFace(0.0101, 0.002, 0.3)], ids=['bonded', 'touching'])
def test_a_pad_in_the_world_is_a_pad_that_moves_back(face):
    """In the frame of the base: same tissue, same forces, pads displaced by minus the base."""
    given = block(pad=True)
    given = dataclasses.replace(given, pads=(dataclasses.replace(given.pads[0], face=face),))
    breathing, still = TissueSimulator(given, (BREATH,)), TissueSimulator(given)
    push = np.array([[0.0, 0.0, -3e-3]])
    breathing.settle(push), still.settle(push - base_at(0.0))
    for t in (0.1, 0.3, 0.8):
        seen = breathing.step(t, push)
        same = still.step(t, push - base_at(t))
        assert seen.outcome.ok and same.outcome.ok
        np.testing.assert_allclose(seen.x - base_at(t), same.x, rtol=0.0, atol=2e-8)
        np.testing.assert_allclose(seen.pad_force, same.pad_force, rtol=1e-4, atol=1e-6)


def test_the_pad_force_breathes_with_memory_too():
    """Superposed on a relaxing force: same bits again, and the base where it should be."""
    terms = (Viscoelasticity(), BREATH)
    plants = [TissueSimulator(block(pad=True), terms) for _ in range(2)]
    for plant in plants:
        plant.settle()
    for k in range(1, 6):
        a, b = (plant.step(0.2 * k, [[0.0, 0.0, -2e-3]]) for plant in plants)
        assert a.outcome.ok
        np.testing.assert_array_equal(a.x, b.x)
        np.testing.assert_allclose((a.x - plants[0].body.mesh.nodes)[plants[0].body.fixed],
                                   np.broadcast_to(base_at(0.2 * k), (25, 3)), atol=1e-15)


def test_slow_breathing_is_rigid_in_dynamics():
    slow = dataclasses.replace(BREATH, frequency=0.1, phase=0.0)
    plant = TissueSimulator(block(damping=(5.0, 1e-3)), (slow,), dynamics='implicit',
                            options=DynamicOptions(max_step=0.02))
    rest = plant.settle().x
    for k in range(1, 21):
        state = plant.step(0.1 * k, NO_PADS)
    assert np.linalg.norm(state.base) > 1.5e-3
    # accelerations of A w^2 = 1e-3 m/s^2 against g: 1e-4 of the sag
    np.testing.assert_allclose(state.x - state.base, rest, rtol=0.0, atol=2e-6)


def test_a_stiff_block_on_a_shaken_foundation_is_an_oscillator():
    """m z'' + k (z - A sin w t) = 0 from rest: z = A (sin w t - r sin(w t / r)) / (1 - r^2).

    r = w / sqrt(k / m); the block is so stiff that it moves as one.
    """
    k_area, thick, density, amplitude = 2e6, 0.03, 1e3, 1e-3
    natural = np.sqrt(k_area / (density * thick))
    r = 0.5
    shake = Breathing(amplitude=amplitude, frequency=r * natural / (2.0 * np.pi),
                      direction=(0.0, 0.0, 1.0))
    plant = TissueSimulator(block(E=1e8, gravity=0.0), (BaseCompliance(k_area, k_area), shake),
                            dynamics='implicit', options=DynamicOptions(max_step=2.5e-4,
                                                                        rho_inf=1.0))
    plant.settle()
    for k in range(1, 81):
        t = 1e-3 * k
        z = (plant.step(t, NO_PADS).x - plant.body.mesh.nodes)[:, 2].mean()
        w = r * natural
        exact = amplitude * (np.sin(w * t) - r * np.sin(w * t / r)) / (1.0 - r * r)
        assert z == pytest.approx(exact, abs=0.01 * amplitude)


def test_a_failed_step_holds_the_base_too():
    plant = TissueSimulator(block(pad=True), (BREATH,))
    plant.settle()
    good = plant.step(0.2, [[0.0, 0.0, -1e-3]])
    failed = plant.step(0.4, [[0.0, 0.0, -0.1]])
    assert not failed.outcome.ok
    np.testing.assert_array_equal(failed.x, good.x)
    np.testing.assert_array_equal(failed.base, good.base)
    late = plant.step(0.6, [[0.0, 0.0, -1e-3]])
    assert late.outcome.ok
    np.testing.assert_allclose(late.base, base_at(0.6), rtol=1e-12)


def test_a_direction_without_length_is_refused():
    with pytest.raises(ConfigError, match='direction = 0 0 0; must have a length'):
        Breathing(direction=(0.0, 0.0, 0.0))
