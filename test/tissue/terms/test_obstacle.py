"""A wall beside the tissue: a bar that meets it, a bulge against a rigid plane, nothing before."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.body import NO_SUPPORTS, Pad, PadFace, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.contact import ContactPair
from arm_brachy.tissue.contact_poses import placed
from arm_brachy.tissue.contact_shapes import Plane
from arm_brachy.tissue.contact_solver import ContactSolver
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import boundary_faces, quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.supports import positions, reactions
from arm_brachy.tissue.terms.obstacle import Obstacle

GAP = 2e-4
both_elements = pytest.mark.parametrize('quadratic', [False, True], ids=['linear', 'quadratic'])


def soft(mesh, fixed, pads, E=6e3, nu=0.45, **extra):
    m, (mu, kappa) = len(mesh.tets), moduli(E, nu)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3), fixed, pads, **extra)


def bulge(quadratic=False):
    """Block of 50 x 40 x 40 mm whose far side, x = 50 mm, is a cap of 80 mm radius; fixed below.

    A pad on its near side pushes along x.
    """
    mesh = box_mesh((0.05, 0.04, 0.04), (5, 6, 6))
    nodes = mesh.nodes.copy()
    across = np.sum((nodes[:, 1:] - 0.02) ** 2, axis=1)
    nodes[:, 0] -= nodes[:, 0] / 0.05 * (0.08 - np.sqrt(0.08**2 - across))
    mesh = dataclasses.replace(mesh, nodes=nodes)
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    near = mesh.node_sets['x0']
    disc = near[np.linalg.norm(mesh.nodes[near, 1:] - 0.02, axis=1) < 0.0121]
    pad = Pad('pad', disc, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.02, 0.02]), 0.02)
    return soft(mesh, mesh.node_sets['z0'], (pad,))


def wall(gap=GAP, radius=0.015):
    """The term at the top of the bulge."""
    return Obstacle(gap, (0.05, 0.02, 0.02), radius)


def pushed(body, depth):
    """StaticSolution with the pad pushed along x."""
    found = StaticSolver(body).solve(body.mesh.nodes, [[depth, 0.0, 0.0]])
    assert found.outcome.ok
    return found


def wall_force(body, x):
    """Gap (s,) [m] and force (s,) [N] of the wall, and the force (3,) [N] on the tissue."""
    gap, force = reactions(body.supports, x - body.mesh.nodes, np.zeros(3))
    return gap, force, force @ body.supports.normal


@both_elements
def test_a_bar_meets_the_wall_after_the_gap(quadratic):
    """Moved by d at one end, free else: no force up to d = gap, then E A (d - gap) / L."""
    E, length, side = 6e3, 0.06, 0.02
    mesh = box_mesh((length, side, side), (6, 2, 2))
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    pad = Pad('pad', mesh.node_sets['x0'], np.array([1.0, 0, 0]), np.array([0, 0.01, 0.01]), 0.02)
    bar = soft(mesh, np.zeros(0, dtype=np.int64), (pad,), E, nu=0.0)
    body = Obstacle(GAP, (length, side / 2, side / 2), 0.2).prepare(bar)
    free = pushed(body, 0.99 * GAP)
    assert not free.pad_force.any() or np.abs(free.pad_force).max() < 1e-12
    np.testing.assert_allclose(free.x - mesh.nodes, np.broadcast_to(
        [0.99 * GAP, 0, 0], mesh.nodes.shape), atol=1e-12)
    for d in (3.0 * GAP, 6.0 * GAP):
        found = pushed(body, d)
        expected = E * side**2 * (d - GAP) / length
        # the wall gives by onset and penalty, 8 um; a bar of the law is linear to the strain, 2 %
        assert -found.pad_force[0, 0] == pytest.approx(expected, rel=0.04)
        assert wall_force(body, found.x)[2][0] == pytest.approx(found.pad_force[0, 0], rel=1e-5)


@both_elements
def test_nothing_at_all_happens_before_the_first_contact(quadratic):
    plain = bulge(quadratic)
    given = wall(gap=1e-3).prepare(plain)
    a, b = (pushed(body, 1e-3) for body in (plain, given))  # the far side moves by less
    np.testing.assert_array_equal(a.x, b.x)
    np.testing.assert_array_equal(a.pad_force, b.pad_force)
    c, d = (pushed(body, 1e-3) for body in (plain, wall(np.inf).prepare(plain)))
    np.testing.assert_array_equal(c.x, d.x)


def test_the_gap_is_the_clearance_at_rest():
    body = wall().prepare(bulge())
    gap, force, _ = wall_force(body, body.mesh.nodes)
    assert gap.min() == pytest.approx(GAP, rel=1e-12) and not force.any()
    points = positions(body.supports, body.mesh.nodes)
    assert np.linalg.norm(points - [0.05, 0.02, 0.02], axis=1).max() < 0.015
    np.testing.assert_allclose(body.supports.normal[0], [-1.0, 0.0, 0.0], atol=0.03)
    sag = points[:, 0].max() - points[:, 0]
    assert sag.max() > 1e-3
    np.testing.assert_allclose(gap, GAP + sag, rtol=0.0, atol=5e-4)  # n is off x by up to 0.03


@both_elements
def test_complementarity_and_balance(quadratic):
    body = wall().prepare(bulge(quadratic))
    found = pushed(body, 4e-3)
    gap, force, total = wall_force(body, found.x)
    depth = force / body.supports.stiffness + body.supports.onset  # >= p / k + onset / 2
    assert (force >= 0.0).all() and (gap >= -depth).all() and force.max() > 0.0
    assert not force[gap >= 0.0].any()
    held = StaticSolver(body).assembler.forces(found.x)[body.fixed].sum(axis=0)
    np.testing.assert_allclose(total + held - found.pad_force[0], 0.0, rtol=0.0,
                               atol=len(found.x) * found.residual)
    assert len(found.x) * found.residual < 1e-3 * np.linalg.norm(total)


@both_elements
def test_the_contact_solver_finds_the_same_on_a_rigid_plane(quadratic):
    """The general contact with an unbounded plane, beyond whose reach of the tissue R lies.

    Off the middle of the patch the wall is softer, by 1 / b: some um of a few hundred of contact.
    """
    plain = bulge(quadratic)
    body = wall(radius=0.018).prepare(plain)
    here = pushed(body, 3e-3)
    _, force, total = wall_force(body, here.x)
    inward = body.supports.normal[0]
    points = positions(body.supports, plain.mesh.nodes)
    assert np.linalg.norm(points[force > 0.0] - [0.05, 0.02, 0.02], axis=1).max() < 0.014
    far = plain.mesh.node_sets['x1']
    faces = boundary_faces(plain.mesh)
    pair = ContactPair('wall', Plane(), faces=faces[np.isin(faces, far).all(axis=1)])
    solver = ContactSolver(plain, [pair])
    X_WB = placed((points @ inward - body.supports.gap)[0] * inward, inward)[None]
    there = solver.step(solver.initial(X_WB), X_WB,
                        solver.statics.held_positions([[3e-3, 0.0, 0.0]]))
    assert there.outcome.ok and there.force[0, 0] > 0.05
    np.testing.assert_allclose(here.x, there.x, rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(total, -there.force[0], rtol=0.01, atol=1e-3)


def test_force_follows_the_place_smoothly_and_starts_late_with_a_wider_gap():
    plain = bulge()
    forces = [wall_force(body, pushed(body, 4e-3).x)[2][0] for body in (
        Obstacle(GAP, (0.05, 0.02 + s, 0.02), 0.012).prepare(plain)
        for s in np.arange(0.0, 4.1e-3, 5e-4))]
    steps = np.abs(np.diff(forces))
    assert steps.max() < 0.25 * np.abs(forces).max()
    wider = [np.abs(wall_force(body, pushed(body, 4e-3).x)[2][0]) for body in (
        wall(gap).prepare(plain) for gap in (0.0, 1e-4, 3e-4, 6e-4))]
    assert (np.diff(wider) < 0.0).all()


def test_the_wall_is_met_in_the_plant_and_left_again_with_any_pad():
    simulator = TissueSimulator(bulge(), (wall(),))
    given = bulge()
    faced = dataclasses.replace(given.pads[0], face=PadFace(0.0121, 0.002, 0.0))
    touching = TissueSimulator(dataclasses.replace(given, pads=(faced,)), (wall(),))
    for plant in (simulator, touching):
        plant.settle()
        met = plant.step(0.1, [[5e-3, 0.0, 0.0]])
        assert met.outcome.ok and wall_force(plant.body, met.x)[2][0] < -0.01
        left = plant.step(0.2, [[0.0, 0.0, 0.0]])
        assert left.outcome.ok
        np.testing.assert_allclose(left.x, plant.body.mesh.nodes, rtol=0.0, atol=1e-8)
        failed = plant.step(0.3, [[0.2, 0.0, 0.0]])
        assert not failed.outcome.ok
        np.testing.assert_array_equal(failed.x, left.x)


def test_dynamics_ends_in_the_static_state():
    damped = dataclasses.replace(bulge(), damping=(60.0, 0.0))
    plant = TissueSimulator(damped, (wall(),), dynamics='implicit')
    plant.settle()
    for k in range(1, 9):
        state = plant.step(0.05 * k, [[min(k, 4) * 1e-3, 0.0, 0.0]])
        assert state.outcome.ok
    static = pushed(plant.body, 4e-3)
    np.testing.assert_allclose(state.x, static.x, rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(wall_force(plant.body, state.x)[2],
                               wall_force(plant.body, static.x)[2], rtol=0.02, atol=1e-3)


def test_a_place_off_the_surface_is_refused():
    assert wall().prepare(bulge()).supports is not NO_SUPPORTS
    with pytest.raises(MeshError, match='mm from centre at the nearest; must be within radius'):
        Obstacle(GAP, (0.1, 0.02, 0.02), 0.015).prepare(bulge())
    faces = boundary_faces(bulge().mesh)
    held = dataclasses.replace(bulge(), fixed=np.unique(faces))
    with pytest.raises(MeshError, match='obstacle'):
        wall().prepare(held)
