"""The plant: equilibrium, memory, failure and repetition, whatever the terms."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.body import Pad, PadFace, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicOptions
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

TERMS = (StiffnessScale(1.2), Inclusion(centre=(0.02, 0.02, 0.02), radius=0.008, ratio=3.0),
         Viscoelasticity())


def body(gravity=9.81):
    """Block of 40 mm, 6 kPa, held below, a pad over the middle of its top."""
    mesh = box_mesh((0.04, 0.04, 0.04), (4, 4, 4))
    mu, kappa = moduli(6e3, 0.45)
    top, m = mesh.node_sets['z1'], len(mesh.tets)
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - 0.02, axis=1) < 0.012]
    pad = Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([0.02, 0.02, 0.04]), 0.02)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,), gravity=np.array([0.0, 0.0, -gravity]),
                    damping=(5.0, 1e-3))


def push(depth):
    """Command (1, 3) [m]."""
    return np.array([[0.0, 0.0, -depth]])


def drive(simulator):
    """Settle, push in ten steps, hold for five; returns every state."""
    states = [simulator.settle()]
    for k in range(1, 16):
        states.append(simulator.step(0.02 * k, push(4e-4 * min(k, 10))))
    return states


@pytest.mark.parametrize('dynamics', ['quasi_static', 'implicit'])
def test_same_commands_same_bits_and_reset_forgets(dynamics):
    simulator = TissueSimulator(body(), TERMS, dynamics=dynamics)
    first = drive(simulator)
    assert all(state.outcome.ok for state in first)
    simulator.reset()
    for again in (drive(simulator), drive(TissueSimulator(body(), TERMS, dynamics=dynamics))):
        for a, b in zip(first, again, strict=True):
            np.testing.assert_array_equal(a.x, b.x)
            np.testing.assert_array_equal(a.pad_force, b.pad_force)


def test_settling_is_the_static_equilibrium():
    plain = body()
    settled = TissueSimulator(plain).settle()
    static = StaticSolver(plain).solve(plain.mesh.nodes, push(0.0))
    np.testing.assert_allclose(settled.x, static.x, atol=1e-9)
    weight = 9.81 * 1e3 * 0.04**3
    assert 0.0 > settled.pad_force[0, 2] > -weight  # it sags away from the pad, which holds it
    implicit = TissueSimulator(plain, dynamics='implicit').settle()
    np.testing.assert_allclose(implicit.x, static.x, atol=1e-9)
    assert not implicit.v.any()


def test_settled_dynamic_body_stays_at_rest():
    simulator = TissueSimulator(body(), TERMS, dynamics='implicit')
    settled = simulator.settle()
    later = simulator.step(0.05, push(0.0))
    np.testing.assert_allclose(later.x, settled.x, rtol=0.0, atol=1e-8)


def test_every_quasi_static_state_is_the_equilibrium_of_its_command():
    plain = body()
    simulator = TissueSimulator(plain, TERMS[:2])
    for state, k in zip(drive(simulator)[1:], range(1, 16), strict=True):
        static = StaticSolver(simulator.body).solve(plain.mesh.nodes, push(4e-4 * min(k, 10)))
        np.testing.assert_allclose(state.x, static.x, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(state.pad_moment, static.pad_moment, rtol=1e-5, atol=1e-9)


def test_resting_pads_cost_no_solve(monkeypatch):
    simulator = TissueSimulator(body(), TERMS[:2])
    last = drive(simulator)[-1]

    def refuse(*args, **kwargs):
        raise AssertionError('solved although nothing moved')

    monkeypatch.setattr(StaticSolver, 'solve_held', refuse)
    state = simulator.step(1.0, push(4e-3))
    assert state.iterations == 0 and state.t == 1.0 and not state.v.any()
    np.testing.assert_array_equal(state.x, last.x)
    np.testing.assert_array_equal(state.pad_force, last.pad_force)


def test_extrapolation_saves_iterations():
    states = drive(TissueSimulator(body()))
    assert np.mean([s.iterations for s in states[3:11]]) < states[1].iterations


@pytest.mark.parametrize('dynamics', ['quasi_static', 'implicit'])
def test_failure_holds_the_last_good_state_and_recovers(dynamics):
    """A pad driven through the base fails; the next sane command goes on as if it had not been."""
    simulator = TissueSimulator(body(), TERMS, dynamics=dynamics)
    good = drive(simulator)[-1]
    failed = simulator.step(0.32, push(0.1))
    assert failed.outcome in (Outcome.INVERTED_ELEMENT, Outcome.NOT_CONVERGED)
    np.testing.assert_array_equal(failed.x, good.x)
    assert failed.t == 0.32 and simulator.state is good
    recovered = simulator.step(0.34, push(4e-3))

    spared = TissueSimulator(body(), TERMS, dynamics=dynamics)
    drive(spared)
    expected = spared.step(0.34, push(4e-3))
    assert recovered.outcome.ok
    # The quasi-static solver keeps its last factor, which the failure has changed: equal states,
    # but to the solver's tolerance of 1e-10 m and not to the bit.
    np.testing.assert_allclose(recovered.x, expected.x, rtol=0.0, atol=1e-9)


def test_a_command_that_is_not_finite_is_rejected():
    simulator = TissueSimulator(body())
    good = simulator.settle()
    state = simulator.step(0.02, push(np.nan))
    assert state.outcome is Outcome.REJECTED
    np.testing.assert_array_equal(state.x, good.x)
    assert simulator.step(0.04, push(1e-4)).outcome.ok


def test_bad_arguments_are_named():
    simulator = TissueSimulator(body())
    simulator.step(0.02, push(1e-4))
    with pytest.raises(InputError, match='must be later than 0.02'):
        simulator.step(0.02, push(1e-4))
    with pytest.raises(InputError, match=r'must be \(1, 3\)'):
        simulator.step(0.04, np.zeros((2, 3)))
    with pytest.raises(ConfigError, match='quasi_static, implicit'):
        TissueSimulator(body(), dynamics='explicit')


def test_the_given_body_is_untouched():
    given = body()
    before = given.mu.copy()
    drive(TissueSimulator(given, TERMS))
    np.testing.assert_array_equal(given.mu, before)


def test_slow_pushing_makes_dynamics_quasi_static():
    """At 1 mm/s inertia is nothing: both modes agree within a thousandth of the push."""
    massive = dataclasses.replace(body(), damping=(20.0, 0.0))
    static = TissueSimulator(massive)
    dynamic = TissueSimulator(massive, dynamics='implicit',
                              options=DynamicOptions(max_step=0.02))
    static.settle(), dynamic.settle()
    for k in range(1, 21):
        a, b = (s.step(0.1 * k, push(1e-4 * k)) for s in (static, dynamic))
    np.testing.assert_allclose(b.x, a.x, rtol=0.0, atol=2e-6)
    np.testing.assert_allclose(b.pad_force, a.pad_force, rtol=5e-3, atol=1e-3)


# --- touching pads -------------------------------------------------------------------------

def touched(gravity=0.0, friction=0.3, bonded_side=False):
    """The block with a disc of 12 mm that only touches its top, if asked a bonded pad besides."""
    given = body(gravity)
    pad = dataclasses.replace(given.pads[0], face=PadFace(0.012, 0.002, friction))
    nodes = given.mesh.nodes
    side = np.flatnonzero((nodes[:, 0] == 0.0) & (np.abs(nodes[:, 1:] - 0.02) < 0.011).all(axis=1))
    other = Pad('side', side, np.array([1.0, 0, 0]), np.array([0.0, 0.02, 0.02]), 0.02)
    return dataclasses.replace(given, pads=(other, pad) if bonded_side else (pad,))


def test_touching_pads_repeat_their_bits_and_reset_forgets():
    simulator = TissueSimulator(touched(9.81), TERMS)
    first = drive(simulator)
    assert all(state.outcome.ok for state in first)
    for again in (drive(TissueSimulator(touched(9.81), TERMS)),):
        for a, b in zip(first, again, strict=True):
            np.testing.assert_array_equal(a.x, b.x)
    simulator.reset()  # the factor it keeps is another: equal to the solver's tolerance
    for a, b in zip(first, drive(simulator), strict=True):
        np.testing.assert_allclose(a.x, b.x, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(a.pad_force, b.pad_force, rtol=1e-4, atol=1e-6)


def test_a_touching_pad_pushes_lifts_off_and_never_pulls():
    simulator = TissueSimulator(touched(friction=0.0))  # or the second push knows of the way
    at_zero = simulator.settle()
    assert not at_zero.pad_force.any()
    pushed = simulator.step(1.0, push(2e-3))
    assert pushed.outcome.ok and pushed.pad_force[0, 2] > 0.05
    held = simulator.step(2.0, push(2e-3))
    assert held.iterations == 0 and not held.v.any()
    away = simulator.step(3.0, push(-1e-3))
    assert away.outcome.ok and not away.pad_force.any() and not away.pad_moment.any()
    np.testing.assert_allclose(away.x, simulator.body.mesh.nodes, rtol=0.0, atol=1e-8)
    again = simulator.step(4.0, push(2e-3))
    np.testing.assert_allclose(again.pad_force, pushed.pad_force, rtol=0.0, atol=1e-5)


def test_more_friction_gives_more_force():
    """The tissue under the disc cannot spread where it sticks."""
    forces = [TissueSimulator(touched(friction=mu)).step(1.0, push(2e-3)).pad_force[0, 2]
              for mu in (0.0, 0.1, 0.3)]
    assert 0.0 < forces[0] < forces[1] < forces[2]


def test_memory_relaxes_the_force_on_a_touching_pad():
    """Long after a push the force is the settled one; at once it is that of the whole chain."""
    simulator = TissueSimulator(touched(), (Viscoelasticity(),))
    simulator.settle()
    quick = simulator.step(1e-3, push(2e-3)).pad_force[0, 2]
    for k in range(1, 31):
        late = simulator.step(k, push(2e-3))
    settled = simulator.settle(push(2e-3))
    assert late.outcome.ok and settled.outcome.ok
    assert quick > 1.05 * settled.pad_force[0, 2]
    np.testing.assert_allclose(late.pad_force, settled.pad_force, rtol=1e-2, atol=1e-3)


def test_a_failed_push_of_a_touching_pad_is_held_with_advice():
    simulator = TissueSimulator(touched(), TERMS[:2])
    good = simulator.step(1.0, push(2e-3))
    failed = simulator.step(2.0, push(0.1))
    assert failed.outcome in (Outcome.INVERTED_ELEMENT, Outcome.NOT_CONVERGED)
    assert failed.outcome.advice and failed.t == 2.0 and simulator.state is good
    np.testing.assert_array_equal(failed.x, good.x)
    np.testing.assert_array_equal(failed.pad_force, good.pad_force)
    assert simulator.step(3.0, push(2.2e-3)).outcome.ok


def test_bonded_and_touching_pads_go_together():
    simulator = TissueSimulator(touched(bonded_side=True))
    simulator.settle()
    state = simulator.step(1.0, np.array([[1e-3, 0.0, 0.0], [0.0, 0.0, -2e-3]]))
    assert state.outcome.ok
    assert state.pad_force[0, 0] < 0.0 < state.pad_force[1, 2]
    moved = (state.x - simulator.body.mesh.nodes)[simulator.body.pads[0].nodes]
    np.testing.assert_allclose(moved, np.broadcast_to([1e-3, 0.0, 0.0], moved.shape), atol=1e-15)


def test_touching_pads_are_refused_in_dynamics():
    with pytest.raises(ConfigError, match="'implicit' with touching pads"):
        TissueSimulator(touched(), dynamics='implicit')


def test_a_model_bonds_the_pads_that_touch():
    """The documented approximation: StaticSolver takes no notice of a face."""
    faced, plain = touched(), body(0.0)
    found = [StaticSolver(b).solve(b.mesh.nodes, push(2e-3)).x for b in (faced, plain)]
    np.testing.assert_array_equal(*found)
