"""`StaticSolver.follow` reuses old factors: the answer of a fresh solve, and it knows when not."""

import numpy as np
import pytest

from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver


@pytest.fixture
def body():
    """A cube of 40 mm on its base, with a pad on part of its top."""
    mesh = box_mesh((0.04, 0.04, 0.04), (5, 5, 5), perturbation=0.1,
                    rng=np.random.default_rng(1))
    mu, kappa = moduli(6e3, 0.45)
    m = len(mesh.tets)
    top = np.flatnonzero((mesh.nodes[:, 2] > 0.0399) & (mesh.nodes[:, 0] < 0.018))
    pad = Pad('pad', top, np.array([0.0, 0.0, -1.0]), mesh.nodes[top].mean(axis=0), 0.02)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    np.flatnonzero(mesh.nodes[:, 2] < 1e-9), (pad,))


def at(solver, push):
    return solver.held_positions(np.array([[0.0, 0.0, -push]]))


def test_small_steps_end_where_a_fresh_solver_ends_without_new_factors(body):
    walker, x, factors = StaticSolver(body), body.mesh.nodes, 0
    for push in np.arange(1, 21) * 0.1e-3:
        found = walker.follow(x, at(walker, push))
        x, factors = found.x, factors + found.factorisations
        assert found.outcome is Outcome.OK
    fresh = StaticSolver(body).solve_held(body.mesh.nodes, at(walker, 2e-3))
    assert np.abs(x - fresh.x).max() < 1e-9
    assert np.allclose(found.pad_force, fresh.pad_force, rtol=1e-6)
    assert factors < 10  # of 20 steps


def test_a_large_step_falls_back_to_the_full_solver(body):
    walker = StaticSolver(body)
    first = walker.follow(body.mesh.nodes, at(walker, 0.1e-3))
    far = walker.follow(first.x, at(walker, 12e-3))
    assert far.outcome is Outcome.OK
    assert far.factorisations > 0
    fresh = StaticSolver(body).solve_held(body.mesh.nodes, at(walker, 12e-3))
    assert np.abs(far.x - fresh.x).max() < 1e-9


def test_a_step_that_does_not_converge_is_reported_and_moves_nothing(body):
    walker = StaticSolver(body, options=NewtonOptions(max_iterations=2, max_bisections=1))
    first = walker.follow(body.mesh.nodes, at(walker, 1e-6))
    assert first.outcome is Outcome.OK
    far = walker.follow(first.x, at(walker, 15e-3))
    assert not far.outcome.ok
    assert np.array_equal(far.x, first.x)


def test_the_walk_is_repeatable_bit_for_bit(body):
    ends = []
    for _ in range(2):
        walker, x = StaticSolver(body), body.mesh.nodes
        for push in np.arange(1, 9) * 0.3e-3:
            x = walker.follow(x, at(walker, push)).x
        ends.append(x)
    assert np.array_equal(*ends)


def test_what_is_left_is_within_the_bound_it_states(body):
    """Against a solver a thousand times tighter, with a tolerance that leaves something to see."""
    options = NewtonOptions(tolerance=1e-6)
    walker, x = StaticSolver(body, options=options), body.mesh.nodes
    tight = StaticSolver(body, options=NewtonOptions(tolerance=1e-9))
    chords = 0
    for push in np.arange(1, 9) * 0.1e-3:
        found = walker.follow(x, at(walker, push))
        x = found.x
        if found.factorisations == 0:
            chords += 1
            exact = tight.solve_held(x, at(walker, push)).x
            assert np.abs(x - exact).max() <= 2.0 * options.tolerance
    assert chords >= 4


def test_a_factor_of_another_state_cannot_make_an_error_look_small(body):
    """A factor a thousand times too stiff makes any correction tiny: no proof of convergence."""
    walker = StaticSolver(body, options=NewtonOptions(tolerance=1e-6))
    first = walker.follow(body.mesh.nodes, at(walker, 0.1e-3))
    walker._factor.factor(1e3 * walker.free.upper(walker.assembler.tangent(first.x)))
    off = first.x.copy()
    off[walker.free.free] += 1e-4 * np.sin(1e3 * off[walker.free.free])
    found = walker.follow(off, at(walker, 0.1e-3))
    assert np.abs(found.x - first.x).max() < 2e-6


def test_a_body_at_rest_costs_nothing_and_stays_to_the_bit(body):
    walker = StaticSolver(body)
    first = walker.follow(body.mesh.nodes, at(walker, 1e-3))
    again = walker.follow(first.x, at(walker, 1e-3))
    assert (again.iterations, again.factorisations) == (0, 0)
    assert np.array_equal(again.x, first.x)
