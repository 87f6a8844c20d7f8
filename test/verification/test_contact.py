"""Frictional contact against Hertz, Coulomb, closed forms, balances and bonded pads."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq

from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue import material
from arm_brachy.tissue.body import Pad, SoftBody, Springs, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.contact import ContactLaw, ContactPair
from arm_brachy.tissue.contact_poses import moved, placed
from arm_brachy.tissue.contact_shapes import Disc, Plane, Sphere
from arm_brachy.tissue.contact_solver import ContactSolver
from arm_brachy.tissue.contact_state import Touch
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver

E = 6000.0
DOWN = [0.0, 0.0, -1.0]
BLOCK = np.array([0.04, 0.04, 0.02])
TOP = np.array([0.02, 0.02, 0.02])


def soft_body(mesh, fixed, nu=0.45, **extra):
    mu, kappa = material.moduli(E, nu)
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0), fixed, **extra)


def block(cells=(5, 5, 3), **extra):
    mesh = box_mesh(BLOCK, cells)
    return soft_body(mesh, mesh.node_sets['z0'], **extra)


def rollers(mesh, names, stiffness=1e4):
    """Springs that stop the faces x0, y0, z0 named along their normals and nothing else."""
    blocks = np.zeros((len(mesh.nodes), 3, 3))
    for name in names:
        axis = 'xyz'.index(name[0])
        blocks[mesh.node_sets[name], axis, axis] = stiffness
    nodes = np.flatnonzero(blocks.any(axis=(1, 2)))
    return Springs(nodes, blocks[nodes])


# --- normal contact ------------------------------------------------------------------------

RADIUS, DEPTH, NU, SIDE = 0.02, 2e-4, 0.3, 0.01


def boussinesq(points, force):
    """Displacement of the half-space z <= SIDE under a point load, Johnson (1985), sec. 3.2."""
    depth, r = SIDE - points[:, 2], np.hypot(points[:, 0], points[:, 1])
    rho = np.hypot(depth, r)
    scale = force * (1.0 + NU) / (2.0 * np.pi * E * rho)
    radial = scale * (depth * r / rho**2 - (1.0 - 2.0 * NU) * r / (rho + depth))
    sink = scale * (2.0 * (1.0 - NU) + depth**2 / rho**2)
    turn = np.divide(points[:, :2], r[:, None], out=np.zeros((len(r), 2)), where=r[:, None] > 0)
    return np.column_stack([radial[:, None] * turn, -sink])


def hertz_force(depth):
    """Johnson (1985), eq. 4.22 to 4.24: F = 4/3 E* sqrt(R) depth^(3/2)."""
    return 4.0 / 3.0 * E / (1.0 - NU**2) * np.sqrt(RADIUS) * depth**1.5


def indentation(cells, depth):
    """Force of a sphere on a quarter of a half-space, far faces moved as Hertz's load would."""
    mesh = box_mesh((1.0, 1.0, 1.0), (cells,) * 3)
    xi = mesh.nodes
    graded = SIDE * np.column_stack([xi[:, :2]**1.5, 1.0 - (1.0 - xi[:, 2:])**1.5])
    mesh = quadratic_mesh(dataclasses.replace(mesh, nodes=graded))
    far = np.unique(np.concatenate([mesh.node_sets[s] for s in ('x1', 'y1', 'z0')]))
    body = soft_body(mesh, far, nu=NU, springs=rollers(mesh, ('x0', 'y0')))
    law = ContactLaw(depth=5e-6, onset=5e-7)
    solver = ContactSolver(body, [ContactPair('sphere', Sphere(RADIUS))], law=law)
    start = placed([0.0, 0.0, SIDE + RADIUS], DOWN)[None]
    held_at = mesh.nodes.copy()
    held_at[far] += boussinesq(mesh.nodes[far], hertz_force(depth))
    state = solver.step(solver.initial(start), moved(start, [[0.0, 0.0, -depth]]), held_at)
    assert state.outcome is Outcome.OK
    return 4.0 * state.force[0, 2]


def test_hertz():
    """Contact radius 2 mm in cells of 1.25 and 0.68 mm (smallest); the load grows as depth^(3/2).

    Not in Hertz's theory: finite strain (a / R = 0.1). The far faces, five contact radii away,
    move as under a point load.
    """
    coarse, fine = (indentation(cells, DEPTH) / hertz_force(DEPTH) - 1.0 for cells in (4, 6))
    assert abs(coarse) < 0.08
    assert abs(fine) < 0.03
    assert abs(fine) < 0.5 * abs(coarse)
    half = indentation(6, DEPTH / 2.0)
    exponent = np.log2((1.0 + fine) * hertz_force(DEPTH) / half)
    assert exponent == pytest.approx(1.5, abs=0.01)


def test_flat_platen_gives_uniaxial_compression():
    """A frictionless plane on a block on rollers: one stretch, closed form, uniform pressure."""
    mesh = box_mesh(BLOCK, (3, 3, 2))
    body = soft_body(mesh, np.zeros(0, dtype=int), springs=rollers(mesh, ('x0', 'y0', 'z0'), 1e9))
    law = ContactLaw(depth=2e-5, onset=2e-6)
    solver = ContactSolver(body, [ContactPair('platen', Plane())], law=law)
    start = placed(TOP, DOWN)[None]
    state = solver.step(solver.initial(start), moved(start, [[0, 0, -0.004]]))
    assert state.outcome is Outcome.OK
    stretch = np.ptp(state.x[:, 2]) / BLOCK[2]
    mu, kappa = material.moduli(E, 0.45)

    def stress(side):
        return material.stress(np.diag([side, side, stretch]), mu, kappa)

    side = brentq(lambda s: stress(s)[0, 0], 0.9, 1.3)
    pressure = -stress(side)[2, 2]
    assert state.force[0, 2] == pytest.approx(pressure * BLOCK[0] * BLOCK[1], rel=1e-6)
    assert np.ptp(state.x[:, 0]) == pytest.approx(side * BLOCK[0], rel=1e-6)
    top = solver.nodal(state).pressure[0][mesh.node_sets['z1']]
    np.testing.assert_allclose(top, pressure, rtol=1e-5)
    # What the platen went in and the block did not give way is the layer's stated depth.
    k, onset, _ = solver.assembler.law.constants(body)
    assert state.penetration[0] == pytest.approx(pressure / k + onset / 2.0, rel=1e-5)
    assert stretch * BLOCK[2] == pytest.approx(0.016 + state.penetration[0], abs=1e-8)


@pytest.fixture(scope='module')
def pressed():
    """A pad with friction pressed 3 mm into a block and dragged 0.5 mm: solver, start, state."""
    solver = ContactSolver(block(), [ContactPair('pad', Disc(0.01, 0.002), 0.4)])
    start = placed(TOP, DOWN)[None]
    state = solver.initial(start)
    for way in ([0, 0, -1e-3], [0, 0, -3e-3], [5e-4, 0, -3e-3]):
        state = solver.step(state, moved(start, [way]))
        assert state.outcome is Outcome.OK
    return solver, start, state


def test_forces_on_body_and_tissue_balance(pressed):
    solver, _, state = pressed
    solver.assembler.place(state.X_WB, state.points)
    support = solver.assembler.inner.forces(state.x)[solver.body.fixed].sum(axis=0)
    # Inner forces sum to zero, so that what is missing is what free nodes are out of balance by.
    np.testing.assert_allclose(state.force[0], support, rtol=0.0,
                               atol=len(state.x) * state.residual)
    assert state.residual < 1e-6 * np.linalg.norm(state.force)


def test_nothing_penetrates_beyond_the_stated_bound(pressed):
    solver, _, state = pressed
    k, onset, _ = solver.assembler.law.constants(solver.body)
    deepest = state.points[0].pressure.max() / k + onset / 2.0
    assert 0.0 < state.penetration[0] <= deepest * (1.0 + 1e-12)
    assert state.penetration[0] < 2e-4  # a fifth of a millimetre at the edge of a coarse pad


def test_contact_pushes_and_coulomb_bounds_every_point(pressed):
    solver, _, state = pressed
    points = state.points[0]
    k_t = solver.assembler.law.constants(solver.body)[2]
    traction = k_t * np.linalg.norm(points.slip, axis=-1)
    assert (points.pressure >= 0.0).all()
    assert (traction <= 0.4 * points.pressure * (1.0 + 1e-6) + 1e-9).all()
    assert set(np.unique(solver.nodal(state).touch)) == {Touch.FREE, Touch.STICKS, Touch.SLIPS}


def test_lift_off_leaves_no_force_and_no_shape(pressed):
    solver, start, state = pressed
    away = solver.step(state, moved(start, [[5e-4, 0, 1e-4]]))
    assert away.outcome is Outcome.OK
    assert not away.force.any() and not away.penetration.any()
    np.testing.assert_allclose(away.x, solver.body.mesh.nodes, atol=1e-8)
    assert (solver.nodal(away).touch == Touch.FREE).all()


@pytest.mark.parametrize('shape', [Disc(0.01, 0.002), Sphere(0.015)], ids=['disc', 'sphere'])
def test_tangent_and_forces_are_derivatives(shape):
    """Central differences of energy and forces, with points that stick and points that slip."""
    solver = ContactSolver(block(), [ContactPair('body', shape, 0.4)])
    start = solver.touching(placed(TOP, DOWN)[None])
    state = solver.initial(start)
    for way in ([0, 0, -2e-3], [3e-4, 0, -2e-3]):
        state = solver.step(state, moved(start, [way]))
    assembler = solver.assembler
    assembler.place(state.X_WB, state.points)
    rng, h = np.random.default_rng(4), 1e-10
    # A little farther: in a solved state, points that slip lie on the kink between both branches.
    x = state.x + 2e-6 * rng.uniform(0.5, 1.0, state.x.shape)
    for _ in range(3):
        way = rng.uniform(-1.0, 1.0, x.shape)
        slope = (assembler.forces(x + h * way) - assembler.forces(x - h * way)) / (2 * h)
        exact = (assembler.tangent(x) @ way.ravel()).reshape(-1, 3)
        np.testing.assert_allclose(slope, exact, atol=1e-4 * np.abs(exact).max())
        gain = (assembler.energy(x + 1e3 * h * way) - assembler.energy(x - 1e3 * h * way)) / 2e3
        assert gain / h == pytest.approx(np.sum(assembler.forces(x) * way), rel=1e-4)


# --- friction ------------------------------------------------------------------------------

def sheared(cells=(4, 4, 2), mu=0.5):
    solver = ContactSolver(block(cells), [ContactPair('plate', Plane(), mu)])
    start = placed(TOP, DOWN)[None]
    state = solver.step(solver.initial(start), moved(start, [[0, 0, -1e-3]]))
    assert state.outcome is Outcome.OK
    return solver, start, state


def test_tangential_force_saturates_and_friction_only_dissipates():
    """A plate dragged to and fro: |T| <= mu N, in full slip T = mu N and work = mu N travel."""
    solver, start, state = sheared()
    mu, path = 0.5, np.concatenate([np.arange(1, 9), np.arange(7, -9, -1)]) * 1e-3
    spent, work = 0.0, 0.0
    for x in path:
        new = solver.step(state, moved(start, [[x, 0, -1e-3]]))
        assert new.outcome is Outcome.OK
        assert new.dissipation[0] >= 0.0
        ratio = np.hypot(*new.force[0, :2]) / new.force[0, 2]
        assert ratio <= mu * (1.0 + 1e-7)
        travel = (new.X_WB - state.X_WB)[0, :3, 3]
        work -= 0.5 * (new.force[0] + state.force[0]) @ travel
        spent += new.dissipation[0]
        last, state = state, new
    assert ratio == pytest.approx(mu, rel=1e-6)  # the last of them slides everywhere
    slid = mu * state.force[0, 2] * 1e-3
    assert state.dissipation[0] == pytest.approx(slid, rel=1e-3)
    assert state.force[0, 0] == pytest.approx(last.force[0, 0], rel=1e-3)
    assert spent == pytest.approx(work, rel=0.1)  # trapezoids over 1 mm, and energy still stored


def test_a_block_on_an_incline_sticks_below_and_slips_above():
    """tan(slope) against mu; springs of 1.5 N/m in all, under the block, catch what slides."""
    mu, g, spring = 0.5, 9.81, 1.5
    mesh = box_mesh(BLOCK, (3, 3, 2))
    foot = mesh.node_sets['z0']
    each = np.diag([1.0, 1.0, 0.0]) * spring / len(foot)
    catch = Springs(foot, np.broadcast_to(each, (len(foot), 3, 3)))
    body = soft_body(mesh, np.zeros(0, dtype=int), springs=catch)
    solver = ContactSolver(body, [ContactPair('incline', Plane(), mu)])
    mass = solver.assembler.lumped_mass()

    def tilted(ratio):
        fields, slope = StepFields.of(body), np.arctan(ratio * mu)
        fields.nodal_force += mass[:, None] * g * np.array([np.sin(slope), 0, -np.cos(slope)])
        return fields

    flat = moved(np.eye(4)[None], [[0.0, 0.0, 1e-6]])  # it must be held from the start
    state = solver.step(solver.initial(flat), flat, fields=tilted(0.0))
    for ratio in (0.5, 0.95, 1.1):
        state = solver.step(state, flat, fields=tilted(ratio))
        assert state.outcome is Outcome.OK
        found = state.force[0, 0] / -state.force[0, 2]
        slid = (state.x - mesh.nodes)[foot, 0].mean()
        weight = mass.sum() * g * np.array([np.sin(np.arctan(ratio * mu)),
                                            np.cos(np.arctan(ratio * mu))])
        assert state.force[0, 0] == pytest.approx(weight[0] - spring * slid, rel=1e-6)
        if ratio < 1.0:
            assert found == pytest.approx(ratio * mu, rel=2e-3)
            # The edges, less loaded, give way; the block as a whole stays within its own shear.
            shear = weight[0] / (BLOCK[0] * BLOCK[1]) / body.mu[0] * BLOCK[2]
            assert slid < 0.2 * shear
        else:
            assert found == pytest.approx(mu, rel=2e-3)
            assert slid == pytest.approx((weight[0] - mu * weight[1]) / spring, rel=0.02)


def test_what_sticks_does_not_creep():
    """The same command forty times over: the state does not move."""
    solver, start, state = sheared()
    held = solver.step(state, moved(start, [[5e-4, 0, -1e-3]]))
    now = held
    for _ in range(40):
        now = solver.step(now, held.X_WB)
    np.testing.assert_allclose(now.x, held.x, atol=1e-8)
    np.testing.assert_allclose(now.force, held.force, rtol=1e-5)


@pytest.mark.parametrize('quadratic', [False, True], ids=['linear', 'quadratic'])
def test_with_much_friction_a_plate_acts_like_a_bonded_one(quadratic):
    mesh = box_mesh(BLOCK, (3, 3, 2))
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    free = soft_body(mesh, mesh.node_sets['z0'])
    pad = Pad('top', mesh.node_sets['z1'], np.array(DOWN), TOP, 0.01)
    bonded = StaticSolver(dataclasses.replace(free, pads=(pad,)))
    solver = ContactSolver(free, [ContactPair('plate', Plane(), 20.0)],
                           law=ContactLaw(depth=1e-6, onset=1e-7))
    start = placed(TOP, DOWN)[None]
    state = solver.initial(start)
    for push in (5e-4, 1e-3, 1.5e-3):
        state = solver.step(state, moved(start, [[0, 0, -push]]))
        assert state.outcome is Outcome.OK
    expected = bonded.solve(mesh.nodes, [[0, 0, -1.5e-3]])
    np.testing.assert_allclose(state.force[0], expected.pad_force[0],
                               atol=0.01 * np.abs(expected.pad_force).max())
    np.testing.assert_allclose(state.x, expected.x, atol=2e-5)
