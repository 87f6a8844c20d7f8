"""Energy of both elements: work is stored, a cycle costs nothing, rotation changes nothing."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody, Springs, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import point_moduli
from arm_brachy.tissue.material import energy, moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver

L = 0.04
MU, KAPPA = moduli(6e3, 0.49)
FORCE = KAPPA * L ** 2  # N, what cancels in sums of nodal forces; 1e-16 of it is rounding


@pytest.fixture(params=['linear', 'quadratic'])
def element(request):
    return request.param


def box(element, cells=3):
    mesh = box_mesh((L, L, L), (cells,) * 3, perturbation=0.2, rng=np.random.default_rng(0))
    return quadratic_mesh(mesh) if element == 'quadratic' else mesh


def make_body(mesh, fixed=(), **extra):
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, MU), np.full(m, KAPPA), np.full(m, 1000.0),
                    np.array(fixed, dtype=np.int64), **extra)


@pytest.fixture
def pushed(element):
    """StaticSolver of a box glued below under two pads: half of its top, and one side's middle."""
    mesh = box(element)
    x, y, z = mesh.nodes.T
    top = np.flatnonzero(np.isclose(z, L) & (x < 0.7 * L))
    side = np.flatnonzero(np.isclose(x, L) & (np.abs(z - L / 2) < L / 3) & (y < 0.7 * L))
    pads = (Pad('top', top, np.array([0, 0, -1.0]), np.array([L / 3, L / 2, L]), L),
            Pad('side', side, np.array([-1.0, 0, 0]), np.array([L, L / 2, L / 2]), L))
    return StaticSolver(make_body(mesh, mesh.node_sets['z0'], pads=pads))


PUSH = np.array([[0.001, 0.0, -0.003], [-0.002, 0.0005, 0.0]])


def pad_forces(solver, path):
    """Forces of the pads ON the tissue (k, p, 3) along displacements (k, p, 3); the last x."""
    x, forces = solver.body.mesh.nodes, []
    for displacement in path:
        solution = solver.solve(x, displacement)
        assert solution.outcome.ok
        x = solution.x
        forces.append(-solution.pad_force)
    return np.array(forces), x


# Gauss-Lobatto on [0, 1], 5 points, degree 7 (Abramowitz & Stegun 25.4.32)
LOBATTO = np.array([0.0, 0.5 - np.sqrt(3 / 28), 0.5, 0.5 + np.sqrt(3 / 28), 1.0])
SHARES = np.array([9.0, 49.0, 64.0, 49.0, 9.0]) / 180.0


def test_work_of_the_pads_is_the_stored_energy(pushed):
    """Integral of force along a straight push. Force is nearly linear in it: its eighth
    derivative, which the rule misses, weighs some (push / pad size)^7 = 1e-6."""
    forces, x = pad_forces(pushed, LOBATTO[:, None, None] * PUSH)
    work = SHARES @ np.sum(forces * PUSH, axis=(1, 2))
    assert work == pytest.approx(pushed.assembler.energy(x), rel=1e-6)


def test_a_closed_cycle_costs_nothing(pushed):
    """Around a triangle in the space of both pads: legs by the same rule, sum 1e-6 of a leg."""
    corners = [np.zeros((2, 3)), PUSH * [[1.0], [0.0]], PUSH, np.zeros((2, 3))]
    x, work = pushed.body.mesh.nodes, []
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        leg = []
        for s in LOBATTO:
            solution = pushed.solve(x, a + s * (b - a))
            assert solution.outcome.ok
            x = solution.x
            leg.append(-np.sum(solution.pad_force * (b - a)))
        work.append(SHARES @ leg)
    assert abs(sum(work)) < 1e-6 * max(np.abs(work))
    # back where it began: Newton's tolerance
    np.testing.assert_allclose(x, pushed.body.mesh.nodes, rtol=0.0, atol=1e-9)


def test_forces_do_not_depend_on_the_way(pushed):
    """Straight or round a corner: the same state to Newton's tolerance, 1e-10 m."""
    _, straight = pad_forces(pushed, [PUSH])
    _, corner = pad_forces(pushed, [PUSH * [[0.0], [1.0]], PUSH])
    np.testing.assert_allclose(straight, corner, rtol=0.0, atol=1e-9)


@pytest.fixture
def strained(element):
    """(assembler, x, fields) far from rest, with stress added at every quadrature point."""
    body = make_body(box(element, 2))
    rng = np.random.default_rng(1)
    fields = StepFields.of(body)
    S = rng.normal(scale=300.0, size=fields.stress.shape)
    fields.stress += S + np.swapaxes(S, -1, -2)
    shear = np.array([[1.1, 0.2, -0.1], [0.05, 0.9, 0.1], [0.0, -0.2, 1.05]])
    x = body.mesh.nodes @ shear.T
    return Assembler(body), x + rng.uniform(-5e-4, 5e-4, x.shape), fields


def test_energy_is_the_plain_sum_over_quadrature_points(strained):
    """Psi + S : E in NumPy, each point with its own F and its own added stress."""
    assembler, x, fields = strained
    g = assembler.body.geometry
    F = np.einsum('mai,mqak->mqik', x[g.connectivity], g.gradients)
    green = 0.5 * (np.swapaxes(F, -1, -2) @ F - np.eye(3))
    density = energy(F, *point_moduli(g, fields)) + np.sum(fields.stress * green, axis=(-2, -1))
    assert assembler.energy(x, fields) == pytest.approx(np.sum(g.point_weights * density),
                                                        rel=1e-12)


def test_superposed_rotation_leaves_energy_and_turns_forces_and_tangent(strained):
    """Psi(Q F) = Psi(F), P(Q F) = Q P(F), K(Q x) = Q K(x) Q'; rounding, relative to FORCE."""
    assembler, x, fields = strained
    Q = Rotation.from_rotvec([0.9, -1.7, 0.6]).as_matrix()
    turned = x @ Q.T + [0.3, -0.2, 0.1]
    assert assembler.energy(turned, fields) == pytest.approx(assembler.energy(x, fields),
                                                              rel=1e-12)
    np.testing.assert_allclose(assembler.forces(turned, fields),
                               assembler.forces(x, fields) @ Q.T, atol=1e-13 * FORCE)
    K = assembler.tangent(x, fields).toarray()
    blocks = K.reshape(len(x), 3, len(x), 3)
    turned_back = np.einsum('ij,ajbk,lk->aibl', Q, blocks, Q).reshape(K.shape)
    np.testing.assert_allclose(assembler.tangent(turned, fields).toarray(), turned_back,
                               atol=1e-12 * np.abs(K).max())


def test_internal_forces_have_no_resultant_and_no_moment(strained):
    """Invariance under translation and rotation, as balances (Noether)."""
    assembler, x, fields = strained
    forces = assembler.forces(x, fields)
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-13 * FORCE)
    np.testing.assert_allclose(np.cross(x, forces).sum(axis=0), 0.0, atol=1e-13 * FORCE * L)


def test_forces_and_tangent_are_derivatives_of_the_energy(strained):
    """Central differences along random directions, step 1e-6 m; error (h / cell)^2 = 1e-8.

    The tangent is symmetric as assembled: both halves are one number.
    """
    assembler, x, fields = strained
    forces, K = assembler.forces(x, fields), assembler.tangent(x, fields)
    rng, h = np.random.default_rng(2), 1e-6
    for _ in range(4):
        d = rng.normal(size=x.shape)
        ahead, back = x + h * d, x - h * d
        slope = (assembler.energy(ahead, fields) - assembler.energy(back, fields)) / (2.0 * h)
        assert slope == pytest.approx(np.sum(forces * d), abs=1e-6 * np.abs(forces).sum())
        turn = (assembler.forces(ahead, fields) - assembler.forces(back, fields)) / (2.0 * h)
        np.testing.assert_allclose(turn.ravel(), K @ d.ravel(),
                                   atol=1e-6 * np.abs(K @ d.ravel()).max())
    assert np.abs((K - K.T).data).max(initial=0.0) < 1e-15 * np.abs(K.data).max()


def test_rigid_motion_stores_nothing(element):
    assembler = Assembler(make_body(box(element)))
    X = assembler.body.mesh.nodes
    moved = X @ Rotation.from_rotvec([0.0, 1.2, 0.3]).as_matrix().T + [0.1, -0.2, 0.05]
    assert abs(assembler.energy(moved)) < 1e-15 * FORCE * L
    np.testing.assert_allclose(assembler.forces(moved), 0.0, atol=1e-14 * FORCE)


def test_every_part_of_the_potential_is_accounted_for(pushed):
    """Work of pads = change of strain energy + springs + what weight and dead loads gave up."""
    body = pushed.body
    rng, n = np.random.default_rng(3), len(body.mesh.nodes)
    nodes = np.setdiff1d(body.mesh.node_sets['y1'],
                         np.concatenate([body.fixed, *(p.nodes for p in body.pads)]))
    loaded = dataclasses.replace(
        body, gravity=np.array([0.5, 0.0, -9.81]), nodal_mass=rng.uniform(0.0, 1e-4, n),
        nodal_force=rng.normal(scale=1e-3, size=(n, 3)),
        springs=Springs(nodes, np.broadcast_to(20.0 * np.eye(3), (len(nodes), 3, 3))))
    solver = StaticSolver(loaded)
    start = solver.solve(body.mesh.nodes, 0.0 * PUSH)
    forces, x = pad_forces(solver, LOBATTO[:, None, None] * PUSH)
    work = SHARES @ np.sum(forces * PUSH, axis=(1, 2))
    strain = [pushed.assembler.energy(y) for y in (start.x, x)]  # no springs, no loads there
    spring = [10.0 * np.sum((y - body.mesh.nodes)[nodes] ** 2) for y in (start.x, x)]
    load = loaded.nodal_force + loaded.nodal_mass[:, None] * loaded.gravity
    given = np.sum(load * (x - start.x))
    centroid = np.einsum('mq,mqi->i', body.geometry.weights, np.einsum(
        'qa,mai->mqi', body.geometry.shape, (x - start.x)[body.geometry.connectivity]))
    given += 1000.0 * centroid @ loaded.gravity
    assert work == pytest.approx(np.diff(strain)[0] + np.diff(spring)[0] - given, rel=1e-6)
