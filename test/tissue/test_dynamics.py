"""Dynamic stepping as a component: options, division of calls, purity, failure."""

import copy

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicOptions, DynamicSolver, mass_matrix, weights
from arm_brachy.tissue.material import moduli


def body():
    """Block of 40 mm, 6 kPa, held below, a pad over its whole top."""
    mesh = box_mesh((0.04, 0.04, 0.04), (3, 3, 3))
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.45)
    pad = Pad('pad', mesh.node_sets['z1'], np.array([0.0, 0.0, -1.0]),
              np.array([0.02, 0.02, 0.04]), 0.02)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,), damping=(2.0, 1e-3))


def push(depth):
    """Command (1, 3) [m]."""
    return np.array([[0.0, 0.0, -depth]])


@pytest.mark.parametrize('rho_inf', [0.0, 0.3, 0.8, 1.0])
def test_weights_satisfy_the_conditions_of_second_order_and_stability(rho_inf):
    """gamma = 1/2 - alpha_m + alpha_f; alpha_m <= alpha_f <= 1/2; beta >= 1/4 + (af - am) / 2."""
    w = weights(rho_inf)
    assert w.gamma == pytest.approx(0.5 - w.alpha_m + w.alpha_f)
    assert w.alpha_m <= w.alpha_f <= 0.5
    assert w.beta >= 0.25 + 0.5 * (w.alpha_f - w.alpha_m) - 1e-15


@pytest.mark.parametrize(('bad', 'message'), [
    ({'rho_inf': 1.2}, 'rho_inf = 1.2; must be from 0 to 1'),
    ({'max_step': 0.0}, 'max_step = 0.0 s; must be > 0'),
    ({'mass': 'diagonal'}, "mass = 'diagonal'; must be 'lumped' or 'consistent'"),
])
def test_bad_options_are_named(bad, message):
    with pytest.raises(ConfigError, match=message):
        DynamicOptions(**bad)


@pytest.mark.parametrize(('dt', 'count'), [(1e-4, 1), (2.5e-3, 1), (0.01, 4), (0.011, 5)])
def test_a_call_is_divided_into_allowed_steps(dt, count):
    assert DynamicSolver(body()).substeps(dt) == count


def test_one_long_call_is_many_short_ones():
    solver = DynamicSolver(body())
    whole = solver.step(solver.initial(), push(2e-3), 0.01)
    parts = solver.initial()
    for k in range(1, 5):
        parts = solver.step(parts, push(5e-4 * k), 2.5e-3)
    np.testing.assert_allclose(parts.x, whole.x, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(parts.v, whole.v, rtol=0.0, atol=1e-6)


def test_a_step_is_pure():
    """Equal arguments give equal bits whatever the solver did before, and stay as they were."""
    solver = DynamicSolver(body())
    state, fields = solver.initial(), StepFields.of(body())
    kept = copy.deepcopy(state)
    first = solver.step(state, push(1e-3), 0.01, fields)
    solver.step(first, push(5e-3), 0.02)
    again = solver.step(state, push(1e-3), 0.01, fields)
    np.testing.assert_array_equal(first.x, again.x)
    np.testing.assert_array_equal(first.pad_force, again.pad_force)
    np.testing.assert_array_equal(state.x, kept.x)
    np.testing.assert_array_equal(state.a, kept.a)


def test_failure_returns_the_state_it_was_given():
    solver = DynamicSolver(body())
    good = solver.step(solver.initial(), push(1e-3), 0.01)
    bad = solver.step(good, push(0.06), 0.01)
    assert bad.outcome in (Outcome.INVERTED_ELEMENT, Outcome.NOT_CONVERGED)
    np.testing.assert_array_equal(bad.x, good.x)
    assert bad.t == good.t
    assert solver.step(good, push(1.2e-3), 0.01).outcome.ok


def test_halving_gets_through_where_one_step_cannot():
    deep = push(8e-3)
    stubborn = DynamicSolver(body(), DynamicOptions(max_step=0.02, max_iterations=4, halvings=0))
    patient = DynamicSolver(body(), DynamicOptions(max_step=0.02, max_iterations=4, halvings=6))
    assert not stubborn.step(stubborn.initial(), deep, 0.02).outcome.ok
    assert patient.step(patient.initial(), deep, 0.02).outcome.ok


def test_initial_acceleration_balances_forces():
    """M a + C v + g = 0 at the free nodes, for either mass matrix."""
    given = body()
    rng = np.random.default_rng(5)
    free = np.setdiff1d(np.arange(len(given.mesh.nodes)),
                        np.concatenate([given.fixed, given.pads[0].nodes]))
    x = given.mesh.nodes.copy()
    x[free] += rng.normal(0.0, 2e-4, (len(free), 3))
    v = np.zeros_like(x)
    v[free] = rng.normal(0.0, 0.01, (len(free), 3))
    for kind in ('lumped', 'consistent'):
        solver = DynamicSolver(given, DynamicOptions(mass=kind))
        state = solver.initial(x, v)
        assembler = Assembler(given)
        M = mass_matrix(assembler, kind)
        C = 2.0 * M + 1e-3 * assembler.tangent(given.mesh.nodes)
        balance = (M @ state.a.ravel() + C @ v.ravel()).reshape(-1, 3) + assembler.forces(x)
        np.testing.assert_allclose(balance[free], 0.0, atol=1e-10)


def test_carried_mass_is_on_the_diagonal():
    mesh = body().mesh
    carried = np.zeros(len(mesh.nodes))
    carried[7] = 0.5
    given = SoftBody(mesh, body().mu, body().kappa, body().density, body().fixed,
                     nodal_mass=carried)
    for kind in ('lumped', 'consistent'):
        bare, loaded = (mass_matrix(Assembler(b), kind) for b in (body(), given))
        difference = (loaded - bare).toarray()
        expected = np.zeros_like(difference)
        expected[21:24, 21:24] = 0.5 * np.eye(3)
        np.testing.assert_allclose(difference, expected, atol=1e-15)
