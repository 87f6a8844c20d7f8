"""Bricks: forces and tangent are derivatives, a block without friction is compressed evenly."""

import numpy as np
import pytest
from scipy.optimize import brentq

from arm_brachy.experiments.gel_block.elements import GROUND, Block
from arm_brachy.experiments.gel_block.equilibrium import Solver
from arm_brachy.experiments.gel_block.law import Law

E, NU = 12e3, 0.485
SIDE = 0.03
# two by two by two bricks of unequal sizes
LINES = [SIDE * np.array(some) for some in ((0, 0.3, 1), (0, 0.6, 1), (0, 0.5, 1))]


def pushed(block, seed=0, size=2e-4):
    """Random displacements; the lower face goes both up and down."""
    return size * np.random.default_rng(seed).normal(size=block.size)


@pytest.fixture(scope='module', params=[0.0, 1.5], ids=['neo-Hookean', 'stiffening'])
def block(request):
    """Half of its base is loose, the upper half is three times as stiff."""
    return Block(LINES, Law.of(E, NU, request.param),
                 stiffness=lambda x: np.where(x[:, 2] > SIDE / 2, 3.0, 1.0),
                 loose=lambda x: x[:, 0] > 0.3 * SIDE)


def test_forces_are_the_derivative_of_energy(block):
    u, d = pushed(block), pushed(block, 1)
    h = 1e-3        # of a step of 0.2 mm: rounding of the energy, 1e-16 / h, is below 1e-12
    slope = (block.energy(u + h * d) - block.energy(u - h * d)) / (2 * h)
    assert block.forces(u) @ d == pytest.approx(slope, rel=1e-6)


def test_tangent_is_the_derivative_of_forces(block):
    u, d = pushed(block), pushed(block, 1)
    each, ground = block.tangents(u)
    change = block.gathered(np.matmul(each, d[block.dofs][..., None])[..., 0]) + ground * d
    h = 1e-5        # no node of the ground changes between up and down in so short a step
    differences = (block.forces(u + h * d) - block.forces(u - h * d)) / (2 * h)
    np.testing.assert_allclose(change, differences, rtol=0, atol=1e-7 * np.abs(change).max())
    np.testing.assert_allclose(each, np.swapaxes(each, 1, 2), atol=1e-9 * np.abs(each).max())


def test_a_turn_as_a_whole_costs_nothing(block):
    turn = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    u = (block.nodes @ turn.T - block.nodes).ravel()
    assert abs(block.energy(u)) < 1e-12 * E * SIDE ** 3
    assert np.abs(block.forces(u)).max() < 1e-9 * E * SIDE ** 2


def test_loose_ground_bears_pressure_and_no_pull():
    """Sunk evenly by s: force GROUND s times the loose area; lifted: none."""
    block = Block(LINES, Law.of(E, NU), loose=lambda x: x[:, 0] > 0.3 * SIDE)
    for step, pressure in ((-1e-5, GROUND * 1e-5), (1e-5, 0.0)):
        u = np.tile([0.0, 0.0, step], len(block.nodes))
        total = block.forces(u).reshape(-1, 3).sum(axis=0)
        # nodes at the end of the glue are held: a sixth of the loose bricks is theirs
        area = SIDE ** 2 * 0.7 * (1.0 - 1.0 / 6.0)
        assert total == pytest.approx([0.0, 0.0, -pressure * area], abs=1e-9)
    assert np.all(block.nodes[block.glued, 0] <= 0.3 * SIDE + 1e-9)


def neo_hookean_bar(k, law):
    """Force over cross section [Pa] of a bar at stretch k whose sides are free.

    W(k, t): principal stretches k, t, t; t from dW/dt = 0, by one dimension's root.
    """
    def state(t):
        J, squares = k * t * t, k * k + 2 * t * t
        pressure = law.bulk / 2 * (J * J - 1)
        h = law.shear * J ** (-2 / 3)
        return (h * (k - squares / (3 * k)) + pressure / k,
                h * (t - squares / (3 * t)) + pressure / t)
    t = brentq(lambda t: state(t)[1], 0.5 / np.sqrt(k), 2.0 / np.sqrt(k), xtol=1e-15)
    return state(t)[0], t


def test_compressed_without_friction_it_is_a_bar():
    """The state is uniform, which the shape functions hold exactly: only the iteration is left."""
    law, k = Law.of(E, NU), 0.8
    block = Block(LINES, law)
    x = block.nodes
    sides = [3 * np.flatnonzero(x[:, axis] < 1e-9) + axis for axis in range(3)]
    top = 3 * np.flatnonzero(x[:, 2] > SIDE - 1e-9) + 2
    held = np.concatenate([*sides, top])
    to = np.concatenate([np.zeros(sum(map(len, sides))), np.full(len(top), (k - 1) * SIDE)])
    u = Solver(block, held).along(np.zeros(len(held)), to, np.zeros(block.size))
    stress, t = neo_hookean_bar(k, law)
    np.testing.assert_allclose(u.reshape(-1, 3), x * [t - 1, t - 1, k - 1], atol=1e-9)
    assert block.forces(u)[top].sum() == pytest.approx(stress * SIDE ** 2, rel=1e-6)


def test_a_pad_is_pushed_back_by_what_its_travel_costs():
    """Glued below, carried above: force = d energy / d travel along equilibria.

    The difference is of second order: 1 % of the travel leaves 1e-4 at most.
    """
    block = Block(LINES, Law.of(E, NU))
    top = np.flatnonzero(block.nodes[:, 2] > SIDE - 1e-9)
    held = np.unique((3 * np.concatenate([block.glued, top])[:, None] + np.arange(3)).ravel())

    def settled(depth, u):
        target = np.zeros((len(block.nodes), 3))
        target[top, 2] = -depth
        return solver.solve(target.ravel()[held], u)

    solver, depth, h = Solver(block, held), 3e-3, 3e-5
    u = settled(depth, np.zeros(block.size))
    slope = (block.energy(settled(depth + h, u)) - block.energy(settled(depth - h, u))) / (2 * h)
    force = -block.forces(u).reshape(-1, 3)[top, 2].sum()      # on the pad: back up
    assert force == pytest.approx(slope, rel=1e-4)


def test_values_at_points_are_those_of_the_shape_functions():
    """A quadratic field is held exactly, on the surface and inside."""
    block = Block(LINES, Law.of(E, NU))

    def field(x):
        return 1.0 + x @ [2.0, -1.0, 3.0] + 40.0 * x[:, 0] * x[:, 2] - 30.0 * x[:, 1] ** 2

    points = SIDE * np.array([[0.0, 0.2, 0.4], [1.0, 1.0, 1.0], [0.3, 0.6, 0.5], [0.7, 0.1, 1.0]])
    np.testing.assert_allclose(block.probe(points) @ field(block.nodes), field(points), rtol=1e-7)
