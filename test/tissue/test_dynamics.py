"""Dynamic stepping as a component: options, division of calls, purity, failure."""

import copy
import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicOptions, DynamicSolver, weights
from arm_brachy.tissue.element import element_geometry
from arm_brachy.tissue.linear_solver import Pardiso
from arm_brachy.tissue.mass import mass_matrix
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.viscosity import viscous_stress
from arm_brachy.tissue.warping import polar


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


@pytest.mark.parametrize(('moved', 'damping'), [(2e-4, (2.0, 0.0)), (0.0, (2.0, 1e-3))])
@pytest.mark.parametrize('kind', ['lumped', 'consistent'])
def test_initial_acceleration_balances_forces(kind, moved, damping):
    """M a + C v + g = 0 at the free nodes; at rest, C is Rayleigh's alpha M + beta K."""
    given = dataclasses.replace(body(), damping=damping)
    rng = np.random.default_rng(5)
    free = np.setdiff1d(np.arange(len(given.mesh.nodes)),
                        np.concatenate([given.fixed, given.pads[0].nodes]))
    x, v = given.mesh.nodes.copy(), np.zeros_like(given.mesh.nodes)
    x[free] += moved * rng.normal(size=(len(free), 3))
    v[free] = rng.normal(0.0, 0.01, (len(free), 3))
    state = DynamicSolver(given, DynamicOptions(mass=kind)).initial(x, v)
    assembler = Assembler(given)
    M = mass_matrix(assembler, kind)
    C = damping[0] * M + damping[1] * assembler.tangent(given.mesh.nodes)
    balance = (M @ state.a.ravel() + C @ v.ravel()).reshape(-1, 3) + assembler.forces(x)
    np.testing.assert_allclose(balance[free], 0.0, atol=1e-10)


def turned(angle):
    """Rotation by an angle [rad] about an axis that is none of the mesh's."""
    return Rotation.from_rotvec(angle * np.array([2.0, -1.0, 2.0]) / 3.0).as_matrix()


def viscous(mesh, x, v):
    """`viscous_stress` (m, q, 3, 3) with shear viscosity 2 Pa s, bulk viscosity 1000 Pa s."""
    m = len(mesh.tets)
    g = element_geometry(mesh, np.ones(m), np.ones(m))
    zero = np.zeros((*g.weights.shape, 3, 3))
    stress, each = np.empty_like(zero), np.ones(g.weights.shape)
    viscous_stress(x, v, g.connectivity, g.gradients, 2.0 * each, 1e3 * each, zero, stress)
    return stress


def test_viscous_stress_leaves_rotation_alone():
    """Spinning, stretched and far from rest: no strain rate, no stress."""
    mesh = quadratic_mesh(box_mesh((0.02, 0.01, 0.01), (1, 1, 1)))
    x = mesh.nodes @ np.diag([1.3, 0.9, 0.8]) @ turned(2.0).T
    v = np.cross([3.0, -7.0, 5.0], x)
    np.testing.assert_allclose(viscous(mesh, x, v), 0.0, atol=1e-9)    # of 1e4 Pa: rounding
    assert np.abs(viscous(mesh, x, 1.0 * x)).max() > 1e3    # but swelling at 1 / s meets bulk


def test_isochoric_strain_meets_no_bulk_viscosity():
    """Stretched by 1.4 at constant volume and stretching on: stress of the order of shear."""
    mesh = box_mesh((0.02, 0.01, 0.01), (1, 1, 1))
    stretch = np.diag([1.4, 1.4**-0.5, 1.4**-0.5])
    x = mesh.nodes @ stretch
    v = x @ np.diag([1.0, -0.5, -0.5])
    F_rate = stretch @ np.diag([1.0, -0.5, -0.5])
    rate = stretch @ F_rate
    exact = 2.0 * 2.0 * (rate - np.trace(rate) / 3.0 * np.eye(3))
    np.testing.assert_allclose(viscous(mesh, x, v),
                               np.broadcast_to(exact, (len(mesh.tets), 1, 3, 3)), atol=1e-10)


def test_polar_factor_is_the_rotation():
    rng = np.random.default_rng(2)
    stretch = np.eye(3) + 0.1 * rng.normal(size=(5, 3, 3))
    stretch = stretch @ np.swapaxes(stretch, 1, 2)
    exact = np.stack([turned(angle) for angle in (0.0, 0.3, 1.5, 3.0, -2.0)])
    np.testing.assert_allclose(polar(exact @ stretch), exact, atol=1e-12)


def test_factor_is_kept_while_the_body_turns(monkeypatch):
    """Thrown, spinning once around, nearly incompressible: one factor, exact rotation."""
    mesh = box_mesh((0.04, 0.02, 0.02), (2, 1, 1))
    m, (mu, kappa) = len(mesh.tets), moduli(264e3, 0.499)
    solver = DynamicSolver(SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                                    np.zeros(0, dtype=np.int64)))
    made, factor, centre = [], Pardiso.factor, [0.02, 0.01, 0.01]
    state = solver.initial(v=np.cross([0.0, 0.0, 2.0 * np.pi], mesh.nodes - centre))
    monkeypatch.setattr(Pardiso, 'factor', lambda self, data: made.append(factor(self, data)))
    state = solver.step(state, np.zeros((0, 3)), 1.0)
    assert state.outcome.ok and len(made) == 1
    np.testing.assert_allclose(state.x, mesh.nodes, atol=2e-4)   # 0.2 ms after 400 steps


def test_another_solver_continues_with_the_same_bits():
    """What the next step depends on travels with the state, the kept factor included."""
    solver = DynamicSolver(body())
    state = solver.step(solver.initial(), push(1e-3), 0.01)
    expected = solver.step(state, push(2e-3), 0.01)
    other = DynamicSolver(body())
    other.step(other.initial(), push(4e-3), 0.03)
    found = other.step(copy.deepcopy(state), push(2e-3), 0.01)
    np.testing.assert_array_equal(found.x, expected.x)
    np.testing.assert_array_equal(found.pad_force, expected.pad_force)


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
