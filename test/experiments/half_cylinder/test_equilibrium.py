"""Equilibria: a bar without friction, work and force, balance, and convergence with the mesh."""

import numpy as np
import pytest
from scipy.optimize import brentq

from arm_brachy.core.errors import NotConverged
from arm_brachy.experiments.half_cylinder.elements import Body
from arm_brachy.experiments.half_cylinder.equilibrium import LEFT, Solver
from arm_brachy.experiments.half_cylinder.law import Law

E, NU = 9e3, 0.48
SIDE = 0.03     # m, as in conftest
ONE = Law.of(E, NU)


def body(mesh, loose=None):
    alike = np.ones((len(mesh.tets), 1))
    return Body(mesh, Law(ONE.shear * alike, ONE.bulk * alike), loose=loose)


def on(nodes, axis, at):
    """Degrees of freedom along an axis of the nodes of a plane."""
    return 3 * np.flatnonzero(np.abs(nodes[:, axis] - at) < 1e-9) + axis


def bar(k):
    """Force over cross section [Pa] and sideways stretch of a bar at stretch k, its sides free.

    W(k, t) = mu / 2 (J^(-2/3) (k^2 + 2 t^2) - 3) + kappa / 2 (J - 1)^2, J = k t^2, dW/dt = 0.
    """
    def slopes(t):
        J, squares = k * t * t, k * k + 2 * t * t
        h, pressure = ONE.shear * J ** (-2 / 3), ONE.bulk * (J - 1) * J
        return (h * (k - squares / (3 * k)) + pressure / k,
                h * (t - squares / (3 * t)) + pressure / t)
    t = brentq(lambda t: slopes(t)[1], 0.5 / np.sqrt(k), 2.0 / np.sqrt(k), xtol=1e-15)
    return slopes(t)[0], t


def test_compressed_without_friction_it_is_a_bar(cube):
    """The state is even, which the shape functions hold exactly: only the iteration is left."""
    block, k = body(cube(2)), 0.8
    sides = [on(block.nodes, axis, 0.0) for axis in range(3)]
    top = on(block.nodes, 2, SIDE)
    held = np.concatenate([*sides, top])
    to = np.concatenate([np.zeros(sum(map(len, sides))), np.full(len(top), (k - 1) * SIDE)])
    u = Solver(block, held).solve(to, np.zeros(block.size))
    stress, t = bar(k)
    np.testing.assert_allclose(u.reshape(-1, 3), block.nodes * [t - 1, t - 1, k - 1], atol=1e-7)
    assert block.forces(u)[top].sum() == pytest.approx(stress * SIDE ** 2, rel=1e-5)


def pressed(mesh, depth, loose=None, aside=0.0):
    """Body glued below and carried above by `depth` down and `aside` along x: it, u and the
    nodes on top."""
    block = body(mesh, loose)
    top = np.flatnonzero(block.nodes[:, 2] > SIDE - 1e-9)
    moved = np.zeros((len(block.nodes), 3))
    moved[top] = aside, 0.0, -depth
    held = (3 * np.unique([*block.glued, *top])[:, None] + np.arange(3)).ravel()
    u = np.zeros(block.size)
    solver = Solver(block, held)
    for share in (0.5, 1.0):
        u = solver.solve(share * moved.ravel()[held], u)
    return block, u, top


def test_forces_balance(cube):
    """Above, below and on the ground together; no free node has any."""
    block, u, top = pressed(cube(2), 3e-3, lambda x: x[:, 0] > SIDE / 2, aside=2e-3)
    nodal = block.forces(u).reshape(-1, 3)
    ground = block.gathered(block.ground.dofs, block.ground.forces(u)).sum()
    assert ground < -0.1                    # it does bear: counted in nodal as what holds
    held = np.unique([*block.glued, *top])
    total = nodal[held].sum(axis=0)
    assert total == pytest.approx([0.0, 0.0, ground], abs=len(nodal) * LEFT)
    assert np.abs(np.delete(nodal, held, axis=0)).max() < LEFT


def test_a_push_costs_what_the_force_does(cube):
    """Force = d energy / d travel along equilibria; the difference is of second order."""
    def energy(depth):
        block, u, _ = pressed(cube(2), depth)
        F = block.gradient(u)
        J = np.linalg.det(F)
        W = (ONE.shear / 2 * (J ** (-2 / 3) * (F * F).sum((-1, -2)) - 3)
             + ONE.bulk / 2 * (J - 1) ** 2)
        return (W * block.weights).sum()

    depth, h = 3e-3, 3e-5
    block, u, top = pressed(cube(2), depth)
    force = -block.forces(u).reshape(-1, 3)[top, 2].sum()
    assert force == pytest.approx((energy(depth + h) - energy(depth - h)) / (2 * h), rel=1e-4)


def test_finer_meshes_come_closer(cube):
    """The force comes down, by less than half with every halving: stress is singular where the
    glue ends, so the rate is that of the edges' length and not of its square."""
    forces = []
    for cells in (1, 2, 4):
        block, u, top = pressed(cube(cells), 3e-3)
        forces.append(-block.forces(u).reshape(-1, 3)[top, 2].sum())
    steps = -np.diff(forces)
    assert np.all(steps > 0.0) and steps[1] < 0.5 * steps[0]
    assert steps[1] < 0.1 * forces[-1]


def test_a_way_too_far_is_said_so(cube):
    block = body(cube(1))
    top = np.flatnonzero(block.nodes[:, 2] > SIDE - 1e-9)
    held = (3 * np.unique([*block.glued, *top])[:, None] + np.arange(3)).ravel()
    moved = np.zeros((len(block.nodes), 3))
    moved[top, 2] = -1.1 * SIDE
    with pytest.raises(NotConverged, match='N are left|some volume'):
        Solver(block, held).solve(moved.ravel()[held], np.zeros(block.size))
