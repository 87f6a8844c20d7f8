"""Curved tetrahedra: patch test, rigid motion, derivatives; the ground; values at points."""

import numpy as np
import pytest

from arm_brachy.core.errors import MeshError
from arm_brachy.experiments.half_cylinder import shapes
from arm_brachy.experiments.half_cylinder.elements import NONE, Body, Past
from arm_brachy.experiments.half_cylinder.equilibrium import Solver
from arm_brachy.experiments.half_cylinder.ground import STIFFNESS
from arm_brachy.experiments.half_cylinder.law import Law, tensor

E, NU = 9e3, 0.48
SIDE = 0.03     # m, as in conftest
BEND = 5e-4     # m: of edges of 15 mm


def law(mesh):
    """Three times as stiff above the middle."""
    one, above = Law.of(E, NU), mesh.nodes[mesh.tets[:, :4]].mean(axis=1)[:, 2:] > SIDE / 2
    return Law(one.shear * (1.0 + 2.0 * above), one.bulk * (1.0 + 2.0 * above))


@pytest.fixture(scope='module')
def body(cube):
    """Bent edges, half of the base loose."""
    mesh = cube(2, BEND)
    return Body(mesh, law(mesh), loose=lambda x: x[:, 0] > SIDE / 2)


@pytest.fixture(scope='module')
def past(body):
    """Some memory."""
    kept = np.random.default_rng(4).normal(0.0, 0.1 * E, (*body.weights.shape, 3, 3))
    return Past(0.7, kept + np.swapaxes(kept, -1, -2))


def pushed(body, seed=0, size=2e-4):
    """Random displacements; the lower face goes both up and down."""
    return size * np.random.default_rng(seed).normal(size=body.size)


def test_shape_functions_are_one_at_their_node_and_sum_to_one():
    corners = np.vstack([np.zeros(3), np.eye(3)])
    middles = [corners[list(pair)].mean(axis=0) for pair in shapes.EDGES]
    np.testing.assert_allclose(shapes.values(np.vstack([corners, middles])), np.eye(10),
                               atol=1e-14)
    np.testing.assert_allclose(shapes.values(shapes.POINTS).sum(axis=1), 1.0)
    np.testing.assert_allclose(shapes.slopes(shapes.POINTS).sum(axis=1), 0.0, atol=1e-14)


def even(mesh):
    """A Body of one modulus."""
    one, alike = Law.of(E, NU), np.ones((len(mesh.tets), 1))
    return Body(mesh, Law(one.shear * alike, one.bulk * alike))


STRAIN = np.array([[0.05, 0.02, -0.03], [0.01, -0.04, 0.02], [0.03, -0.01, 0.02]])


# Four points of quadrature are exact where edges are straight.
@pytest.mark.parametrize('bend, close', [(0.0, 1e-8), (BEND, 3e-7)])
def test_an_even_strain_is_held(cube, bend, close):
    """The patch test: the surface prescribed, the nodes inside follow [m]."""
    body = even(cube(2, bend))
    outer = np.any((body.nodes < 1e-9) | (body.nodes > SIDE - 1e-9), axis=1)
    held, to = np.flatnonzero(np.repeat(outer, 3)), (body.nodes @ STRAIN.T).ravel()
    u = Solver(body, held).solve(to[held], np.zeros(body.size))
    np.testing.assert_allclose(u, to, rtol=0, atol=close)


def test_an_even_strain_has_the_laws_traction(cube):
    """Of a face of two by two cells, the nodes inside it bear two thirds of its force: a corner
    of a quadratic triangle bears nothing, the middles of its sides a third each."""
    body = even(cube(2))
    F, one = np.eye(3) + STRAIN, Law.of(E, NU)
    stress = tensor(one.shape_stress(F) + one.volume_stress(F))
    inside = (np.all((body.nodes[:, :2] > 1e-9) & (body.nodes[:, :2] < SIDE - 1e-9), axis=1)
              & (body.nodes[:, 2] > SIDE - 1e-9))
    pulled = body.forces((body.nodes @ STRAIN.T).ravel()).reshape(-1, 3)[inside].sum(axis=0)
    traction = stress @ np.linalg.inv(F).T @ [0.0, 0.0, SIDE ** 2]
    assert pulled == pytest.approx(traction * 2.0 / 3.0, rel=1e-9)


def test_a_turn_as_a_whole_costs_nothing(body):
    turn = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    u = (body.nodes @ turn.T - body.nodes).ravel()
    assert np.abs(body.forces(u)).max() < 1e-9 * E * SIDE ** 2
    # nor does a turn after a deformation change the forces but by turning them
    d = pushed(body)
    d[2::3] = np.abs(d[2::3])       # off the ground, which does not turn
    moved = (body.nodes + d.reshape(-1, 3)) @ turn.T - body.nodes
    np.testing.assert_allclose(body.forces(moved.ravel()).reshape(-1, 3),
                               body.forces(d).reshape(-1, 3) @ turn.T, atol=1e-9)


@pytest.mark.parametrize('remembers', [False, True])
def test_tangent_is_the_derivative_of_forces(body, past, remembers):
    past = past if remembers else NONE
    u, d = pushed(body), pushed(body, 1)
    each, ground = body.tangents(u, past), body.ground.tangents(u)
    change = sum(body.gathered(dofs, np.matmul(K, d[dofs][..., None])[..., 0])
                 for dofs, K in ((body.dofs, each), (body.ground.dofs, ground)))
    h = 1e-5        # no point of the ground changes between up and down in so short a step
    differences = (body.forces(u + h * d, past) - body.forces(u - h * d, past)) / (2 * h)
    np.testing.assert_allclose(change, differences, rtol=0, atol=1e-7 * np.abs(change).max())
    np.testing.assert_allclose(each, np.swapaxes(each, 1, 2), atol=1e-9 * np.abs(each).max())


def test_loose_ground_bears_pressure_and_no_pull(body):
    """Sunk evenly by s: stiffness times s times the loose area; lifted: none."""
    for step, pressure in ((-1e-5, STIFFNESS * 1e-5), (1e-5, 0.0)):
        total = body.forces(np.tile([0.0, 0.0, step], len(body.nodes))).reshape(-1, 3).sum(axis=0)
        assert total == pytest.approx([0.0, 0.0, -pressure * SIDE ** 2 / 2], abs=1e-9)
    assert np.all(body.nodes[body.glued, 0] <= SIDE / 2 + 1e-9)


def test_values_at_points_are_those_of_the_shape_functions(cube):
    """A linear field is held exactly however edges are bent, a quadratic one if they are not."""
    points = SIDE * np.array([[0.0, 0.2, 0.4], [1.0, 1.0, 1.0], [0.3, 0.6, 0.5], [0.7, 0.1, 1.0]])
    for bend, curved in ((BEND, 0.0), (0.0, 1.0)):
        mesh = cube(2, bend)
        body = Body(mesh, law(mesh))

        def field(x, curved=curved):
            return 1.0 + x @ [2.0, -1.0, 3.0] + curved * (40.0 * x[:, 0] * x[:, 2]
                                                          - 30.0 * x[:, 1] ** 2)

        np.testing.assert_allclose(body.probe(points) @ field(body.nodes), field(points),
                                   rtol=1e-9)


def test_a_tetrahedron_inside_out_is_refused(cube):
    mesh = cube(1)
    mesh.tets[2] = mesh.tets[2][[1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]
    with pytest.raises(MeshError, match='tetrahedron 2 is inside out'):
        Body(mesh, law(mesh))
