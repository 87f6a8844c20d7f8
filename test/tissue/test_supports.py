"""One-sided ground: derivatives, complementarity, and the independent contact of a rigid plane."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.tissue.admm import AdmmSolver
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import NO_SUPPORTS, Pad, SoftBody, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.contact import ContactLaw, ContactPair
from arm_brachy.tissue.contact_poses import placed
from arm_brachy.tissue.contact_shapes import Plane
from arm_brachy.tissue.contact_solver import ContactSolver
from arm_brachy.tissue.hyper_reduction import train
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import boundary_faces, quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.reduced_basis import PushDomain
from arm_brachy.tissue.supports import chosen, positions, reactions, support_points

SIDE, HEIGHT, WEIGHT = 0.04, 0.02, 1e3 * 9.81
STILL = np.zeros(3)
both_elements = pytest.mark.parametrize('quadratic', [False, True], ids=['linear', 'quadratic'])


def block(quadratic=False, cells=(4, 4, 2), gravity=9.81):
    """Block of 40 x 40 x 20 mm, 6 kPa, hung from a disc in the middle of its top."""
    mesh = box_mesh((SIDE, SIDE, HEIGHT), cells)
    top = mesh.node_sets['z1']
    disc = top[np.linalg.norm(mesh.nodes[top, :2] - SIDE / 2, axis=1) < 0.0101]
    if quadratic:
        mesh = quadratic_mesh(mesh)
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.45)
    pad = Pad('pad', disc, np.array([0.0, 0.0, -1.0]), np.array([SIDE / 2, SIDE / 2, HEIGHT]),
              0.01)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    np.zeros(0, dtype=np.int64), (pad,), gravity=np.array([0.0, 0.0, -gravity]))


def base_of(body):
    """Faces of the plane z = 0."""
    faces = boundary_faces(body.mesh)
    return faces[(body.mesh.nodes[faces][:, :, 2] == 0.0).all(axis=1)]


def grounded(**options):
    """The block on ground that it touches everywhere."""
    body = block(**options)
    return dataclasses.replace(body, supports=support_points(body, base_of(body)))


@both_elements
def test_points_share_the_area_and_face_inward(quadratic):
    body = grounded(quadratic=quadratic)
    points = body.supports
    stiffness, _, _ = ContactLaw().constants(body)
    assert points.stiffness.sum() == pytest.approx(stiffness * SIDE**2, rel=1e-12)
    where = positions(points, body.mesh.nodes)
    np.testing.assert_allclose(where[:, 2], 0.0, atol=1e-15)
    assert where[:, :2].min() > 0.0 and where[:, :2].max() < SIDE
    np.testing.assert_allclose(points.normal, np.broadcast_to([0, 0, 1.0], where.shape))


@both_elements
def test_forces_and_tangent_are_derivatives(quadratic):
    """Some points open, some closed and some glued, over a base that has moved."""
    body = grounded(quadratic=quadratic, cells=(2, 2, 1))
    rng = np.random.default_rng(3)
    glue = np.where(rng.random(len(body.supports.nodes)) < 0.3, 50.0, 0.0)
    body = dataclasses.replace(body, supports=dataclasses.replace(body.supports, glue=glue))
    assembler, fields = Assembler(body), StepFields.of(body)
    fields.base[:] = 1e-4, -2e-4, -2e-5
    x = body.mesh.nodes + rng.uniform(-3e-4, 3e-4, body.mesh.nodes.shape)
    gap, _ = reactions(body.supports, x - body.mesh.nodes, fields.base)
    assert 0.2 < (gap < 0.0).mean() < 0.8
    for _ in range(3):
        way, h = rng.uniform(-1.0, 1.0, x.shape), 1e-9
        slope = (assembler.forces(x + h * way, fields)
                 - assembler.forces(x - h * way, fields)) / (2.0 * h)
        exact = (assembler.tangent(x, fields) @ way.ravel()).reshape(-1, 3)
        np.testing.assert_allclose(slope, exact, rtol=0.0, atol=1e-5 * np.abs(exact).max())
        gain = (assembler.energy(x + h * way, fields)
                - assembler.energy(x - h * way, fields)) / (2.0 * h)
        assert gain == pytest.approx(np.sum(assembler.forces(x, fields) * way), rel=1e-4)


def test_the_support_tangent_is_its_share_of_the_tangent():
    body = grounded()
    x = body.mesh.nodes - [0.0, 0.0, 1e-4]
    fields, free = StepFields.of(body), Assembler(dataclasses.replace(body, supports=NO_SUPPORTS))
    share = Assembler(body).support_tangent(x, fields)
    assert share.any()
    np.testing.assert_allclose(Assembler(body).tangent(x).data, free.tangent(x).data + share,
                               rtol=1e-12, atol=1e-9)


def test_carried_ground_goes_with_the_base_and_other_ground_stays():
    body, shift = grounded(), np.array([3e-4, -1e-4, 2e-4])
    u = np.random.default_rng(0).uniform(-2e-4, 2e-4, body.mesh.nodes.shape)
    _, at_home = reactions(body.supports, u, STILL)
    _, carried = reactions(body.supports, u + shift, shift)
    np.testing.assert_allclose(carried, at_home, rtol=1e-9, atol=1e-12)
    stays = dataclasses.replace(body.supports, carried=np.zeros(len(body.supports.nodes)))
    np.testing.assert_array_equal(reactions(stays, u, shift)[1], at_home)


@both_elements
@pytest.mark.parametrize('push', [[0.0, 0.0, 0.0], [0.0, 0.0, -1.5e-3], [1e-3, 0.0, 2e-4]])
def test_complementarity_and_balance(quadratic, push):
    """Gap >= 0 but for the stated depth, force >= 0, never both; forces add up to the weight."""
    body = grounded(quadratic=quadratic)
    found = StaticSolver(body).solve(body.mesh.nodes, np.array([push]))
    assert found.outcome.ok
    gap, force = reactions(body.supports, found.x - body.mesh.nodes, STILL)
    depth = force / body.supports.stiffness + body.supports.onset  # >= p / k + onset / 2
    assert (force >= 0.0).all() and (gap >= -depth).all() and force.max() > 0.0
    assert not force[gap >= 0.0].any()
    weight = WEIGHT * SIDE**2 * HEIGHT
    # no friction: the ground bears none of what goes sideways, so that the pad bears nothing
    up = force @ body.supports.normal - found.pad_force[0]
    np.testing.assert_allclose(up, [0.0, 0.0, weight], rtol=0.0, atol=len(gap) * found.residual)
    assert len(gap) * found.residual < 1e-3 * weight


@both_elements
def test_the_contact_solver_finds_the_same_state_on_a_rigid_plane(quadratic):
    """Ground and plane have one law, and nothing else in common: neither potential nor Newton."""
    body, push = grounded(quadratic=quadratic), np.array([[0.0, 0.0, -1e-3]])
    here = StaticSolver(body).solve(body.mesh.nodes, push)
    plain = dataclasses.replace(body, supports=NO_SUPPORTS)
    solver = ContactSolver(plain, [ContactPair('ground', Plane(), faces=base_of(body))])
    X_WB = placed([SIDE / 2, SIDE / 2, 0.0], [0.0, 0.0, 1.0])[None]
    there = solver.step(solver.initial(X_WB), X_WB, solver.statics.held_positions(push))
    assert here.outcome.ok and there.outcome.ok
    np.testing.assert_allclose(here.x, there.x, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(here.pad_force, there.pad_force, rtol=1e-6, atol=1e-7)


def test_states_do_not_depend_on_the_path():
    body = grounded(quadratic=True)
    solver, x = StaticSolver(body), body.mesh.nodes
    for push in ([0, 0, 2e-3], [1e-3, 0, -1e-3], [0, 0, 1e-3], [0, 5e-4, -5e-4]):
        x = solver.follow(x, solver.held_positions([push])).x
    fresh = StaticSolver(body).solve(body.mesh.nodes, np.array([push]))
    np.testing.assert_allclose(x, fresh.x, rtol=0.0, atol=1e-8)


def test_a_part_of_the_points_and_two_sets_joined_are_the_whole():
    body = grounded()
    left = positions(body.supports, body.mesh.nodes)[:, 0] < SIDE / 2
    parts = chosen(body.supports, left), chosen(body.supports, ~left)
    whole = NO_SUPPORTS.joined(parts[0]).joined(parts[1])
    x = body.mesh.nodes - [0.0, 0.0, 5e-5]
    forces = [Assembler(dataclasses.replace(body, supports=s)).forces(x)
              for s in (body.supports, whole)]
    np.testing.assert_allclose(*forces, rtol=1e-12, atol=1e-12)


def test_solvers_without_ground_refuse_it():
    body = grounded()
    with pytest.raises(ConfigError, match='admm: .* one-sided supports'):
        AdmmSolver(body)
    with pytest.raises(ConfigError, match='reduced model: .* one-sided supports'):
        train(body, PushDomain.of(body, 1e-3), rng=np.random.default_rng(0), samples=2, modes=1)
