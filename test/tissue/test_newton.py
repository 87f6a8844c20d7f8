"""The static solver: what it converges to, what it reports when it cannot."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.body import Pad, SoftBody, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver

DOWN = np.array([0.0, 0.0, -1.0])


def make_body(divisions=(4, 4, 3), nu=0.45):
    mesh = box_mesh((0.04, 0.04, 0.03), divisions, perturbation=0.15,
                    rng=np.random.default_rng(0))
    x, y, z = mesh.nodes.T
    top = np.flatnonzero(np.isclose(z, 0.03) & (np.hypot(x - 0.02, y - 0.02) < 0.0145))
    side = np.flatnonzero(np.isclose(x, 0.0) & (np.hypot(y - 0.02, z - 0.015) < 0.011))
    pads = (Pad('top', top, DOWN, np.array([0.02, 0.02, 0.03]), 0.02),
            Pad('side', side, np.array([1.0, 0, 0]), np.array([0.0, 0.02, 0.015]), 0.02))
    mu, kappa = moduli(6000.0, nu)
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                    mesh.node_sets['z0'], pads)


@pytest.fixture(scope='module')
def body():
    return make_body()


@pytest.fixture(scope='module')
def solver(body):
    return StaticSolver(body)


PUSH = np.array([[0.001, 0.0, -0.004], [0.003, 0.0, 0.0]])


def test_free_nodes_balance_and_held_nodes_are_where_told(body, solver):
    solution = solver.solve(body.mesh.nodes, PUSH)
    assert solution.outcome is Outcome.OK
    forces = solver.assembler.forces(solution.x)
    assert np.abs(forces[solver.free.free]).max() < 1e-8 * np.abs(forces).max()
    u = solution.x - body.mesh.nodes
    for pad, d in zip(body.pads, PUSH, strict=True):
        np.testing.assert_allclose(u[pad.nodes], np.broadcast_to(d, (len(pad.nodes), 3)),
                                   atol=1e-16)
    assert not u[body.fixed].any()


def test_within_a_nanometre_of_the_limit_of_iteration(body, solver):
    tight = StaticSolver(body, options=dataclasses.replace(NewtonOptions(), tolerance=1e-15))
    x = solver.solve(body.mesh.nodes, PUSH).x
    for _ in range(2):  # Newton polishing beyond any tolerance
        K, factor = tight.linearise(x)
        step = np.zeros_like(x)
        step[tight.free.free] = factor.solve(
            tight.assembler.forces(x)[tight.free.free].ravel()).reshape(-1, 3)
        x = x - step
    np.testing.assert_allclose(solver.solve(body.mesh.nodes, PUSH).x, x, atol=1e-9)


def test_path_does_not_matter_and_one_call_repeats_its_bits(body, solver):
    direct = solver.solve(body.mesh.nodes, PUSH)
    x = body.mesh.nodes
    for fraction in np.linspace(0.1, 1.0, 10):
        x = solver.solve(x, fraction * PUSH).x
    np.testing.assert_allclose(x, direct.x, atol=2e-10)
    again = StaticSolver(body).solve(body.mesh.nodes, PUSH)
    assert np.array_equal(again.x, direct.x)
    assert np.array_equal(again.pad_force, direct.pad_force)


def test_small_warm_step_needs_one_factorisation(body, solver):
    x = solver.solve(body.mesh.nodes, PUSH).x
    step = solver.solve(x, PUSH + [[0, 0, -1e-4], [0, 0, 0]])
    assert step.outcome.ok
    assert step.factorisations == 1
    assert step.iterations <= 4
    still = solver.solve(x, PUSH)
    assert still.iterations <= 1
    np.testing.assert_allclose(still.x, x, atol=1e-10)


def test_tissue_pushes_back_and_the_moment_is_about_the_disc(body, solver):
    solution = solver.solve(body.mesh.nodes, PUSH)
    assert solution.pad_force[0] @ DOWN < 0.0
    forces = solver.assembler.forces(solution.x)
    for i, pad in enumerate(body.pads):
        arm = solution.x[pad.nodes] - (pad.centre + PUSH[i])
        np.testing.assert_allclose(solution.pad_force[i], -forces[pad.nodes].sum(0), rtol=1e-12)
        np.testing.assert_allclose(solution.pad_moment[i],
                                   -np.cross(arm, forces[pad.nodes]).sum(0), atol=1e-15)


def test_large_push_takes_load_steps_and_arrives(body, solver):
    solution = solver.solve(body.mesh.nodes, [[0, 0, -0.012], [0.008, 0, 0]])
    assert solution.outcome is Outcome.OK
    assert solver.assembler.evaluate(solution.x).min_J > 0.0


def test_impossible_push_is_reported_and_nothing_moves(body, solver):
    start = solver.solve(body.mesh.nodes, PUSH).x
    solution = solver.solve(start, [[0, 0, -0.05], [0, 0, 0]])
    assert not solution.outcome.ok
    assert np.array_equal(solution.x, start)
    assert solver.solve(start, PUSH).outcome.ok  # and the solver is as good as new


def test_too_few_iterations_are_reported(body):
    options = NewtonOptions(max_iterations=1, max_bisections=1)
    solution = StaticSolver(body, options=options).solve(body.mesh.nodes, 2 * PUSH)
    assert solution.outcome is Outcome.NOT_CONVERGED
    assert np.array_equal(solution.x, body.mesh.nodes)


def test_inverted_start_is_reported(body, solver):
    x = body.mesh.nodes * [1.0, 1.0, -1.0]
    solution = solver.solve(x, np.zeros((2, 3)))
    assert solution.outcome is Outcome.INVERTED_ELEMENT
    assert np.isnan(solution.pad_force).all()


def test_recovers_from_a_disturbed_start(body, solver):
    direct = solver.solve(body.mesh.nodes, PUSH).x
    noise = np.random.default_rng(5).uniform(-1e-3, 1e-3, direct.shape)
    solution = solver.solve(body.mesh.nodes + noise, PUSH)
    assert solution.outcome.ok
    np.testing.assert_allclose(solution.x, direct, atol=2e-10)


@pytest.mark.parametrize('bad', [np.zeros((1, 3)), np.full((2, 3), np.nan)])
def test_refuses_bad_commands(body, solver, bad):
    with pytest.raises(InputError, match='pad_displacement'):
        solver.solve(body.mesh.nodes, bad)
    with pytest.raises(InputError, match='x0'):
        solver.solve(np.full_like(body.mesh.nodes, np.nan), np.zeros((2, 3)))


def test_fields_scale_the_force_but_not_the_shape(body, solver):
    """All moduli doubled: same displacement-driven shape, twice the force."""
    soft = solver.solve(body.mesh.nodes, PUSH)
    fields = StepFields.of(body)
    fields.mu *= 2.0
    fields.kappa *= 2.0
    stiff = solver.solve(body.mesh.nodes, PUSH, fields)
    np.testing.assert_allclose(stiff.x, soft.x, atol=2e-10)
    np.testing.assert_allclose(stiff.pad_force, 2.0 * soft.pad_force, rtol=1e-5)


def test_compressive_stress_past_buckling_does_not_pass_for_equilibrium(body, solver):
    """A held compressive stress above the shear modulus leaves rest without stability."""
    fields = StepFields.of(body)
    fields.stress[:] = -50.0 * body.mu[0] * np.eye(3)
    solution = solver.solve(body.mesh.nodes, np.zeros((2, 3)), fields)
    assert not solution.outcome.ok
