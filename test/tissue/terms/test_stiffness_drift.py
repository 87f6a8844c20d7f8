"""Stiffness drift: a factor on forces that grows in time, unseen by markers, memory included."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicOptions
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.stiffness_drift import StiffnessDrift
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

PER_MINUTE = 1.0 / 60.0


def block(gravity=0.0):
    """Block of 40 mm held below, a pad over the middle of its top."""
    mesh = box_mesh((0.04, 0.04, 0.04), (4, 4, 4))
    mu, kappa = moduli(6e3, 0.45)
    top, m = mesh.node_sets['z1'], len(mesh.tets)
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - 0.02, axis=1) < 0.012]
    pad = Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([0.02, 0.02, 0.04]), 0.01)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,), gravity=np.array([0.0, 0.0, -gravity]))


def course(body, *terms, times=(10.0, 30.0, 60.0, 120.0)):
    """States of a push held at 3 mm after 1 s."""
    simulator = TissueSimulator(body, terms)
    simulator.step(1.0, [[0.0, 0.0, -3e-3]])
    return [simulator.step(t, [[0.0, 0.0, -3e-3]]) for t in times]


@pytest.mark.parametrize(('rate', 'factors'), [
    (0.2, (1.0, 1.0, 1.1, 1.3)),                   # 1 + 0.2 per minute after 30 s
    (-0.2, (1.0, 1.0, 1.0 / 1.1, 1.0 / 1.3)),
])
def test_forces_drift_after_the_onset_and_positions_stay(rate, factors):
    drift = StiffnessDrift(rate=rate * PER_MINUTE, onset=30.0)
    for plain, now, factor in zip(course(block()), course(block(), drift), factors, strict=True):
        np.testing.assert_allclose(now.pad_force, factor * plain.pad_force, rtol=1e-5, atol=1e-7)
        np.testing.assert_allclose(now.x, plain.x, rtol=0.0, atol=1e-9)


def test_gravity_makes_it_visible():
    plain, now = (course(block(9.81), *terms)[-1]
                  for terms in ((), (StiffnessDrift(rate=0.2 * PER_MINUTE),)))
    assert np.abs(now.x - plain.x).max() > 5e-5


def test_what_the_tissue_remembers_drifts_along():
    """The force of the relaxing body times the factor at every time, and the same positions."""
    visco = Viscoelasticity(g1=0.3, tau1=20.0)
    relaxing = course(block(), visco)
    both = course(block(), visco, StiffnessDrift(rate=0.5 * PER_MINUTE))
    assert relaxing[0].pad_force[0, 2] > 1.1 * relaxing[-1].pad_force[0, 2]
    for plain, now in zip(relaxing, both, strict=True):
        factor = 1.0 + 0.5 * now.t / 60.0
        np.testing.assert_allclose(now.x, plain.x, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(now.pad_force, factor * plain.pad_force, rtol=1e-4, atol=1e-6)


def test_it_grows_from_substep_to_substep():
    """One long call in dynamics is many short ones."""
    body = dataclasses.replace(block(9.81), damping=(5.0, 1e-3))
    ends = []
    for calls in (1, 5):
        simulator = TissueSimulator(body, (StiffnessDrift(rate=2.0 * PER_MINUTE),),
                                    dynamics='implicit', options=DynamicOptions(max_step=0.01))
        simulator.settle()
        for k in range(1, calls + 1):
            state = simulator.step(0.2 * k / calls, [[0.0, 0.0, 0.0]])
        ends.append(state)
    np.testing.assert_allclose(ends[0].x, ends[1].x, rtol=0.0, atol=1e-9)


def test_the_modulus_stays_positive_however_long_the_run():
    state = course(block(), StiffnessDrift(rate=-2.0 * PER_MINUTE), times=(36000.0,))[0]
    assert state.outcome.ok and state.pad_force[0, 2] > 0.0


def test_reset_starts_anew_and_a_failed_step_holds():
    simulator = TissueSimulator(block(), (StiffnessDrift(rate=0.2 * PER_MINUTE),))
    first = simulator.step(30.0, [[0.0, 0.0, -3e-3]])
    failed = simulator.step(60.0, [[0.0, 0.0, -0.1]])
    assert not failed.outcome.ok
    np.testing.assert_array_equal(failed.pad_force, first.pad_force)
    simulator.reset()
    again = simulator.step(30.0, [[0.0, 0.0, -3e-3]])
    np.testing.assert_allclose(again.pad_force, first.pad_force, rtol=1e-6)
