"""Everything that rides on the mesh, on quadratic tetrahedra: sets, mass, markers, pads, terms."""

import dataclasses
import math

import meshio
import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from arm_brachy.core.scene import MeshFile, PadPatch, PointLoad, Region, Scene
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.build import build_body, load_masses
from arm_brachy.tissue.element import EDGES
from arm_brachy.tissue.mass import mass_matrix
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import (
    boundary_faces,
    embed,
    interpolate,
    quadratic_mesh,
    rotations,
    with_midside,
)
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.terms.base_compliance import BaseCompliance
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity

SIZE = np.array([0.04, 0.03, 0.02])
VOLUME, DENSITY = float(np.prod(SIZE)), 1000.0
MU, KAPPA = moduli(6e3, 0.49)


def straight():
    return box_mesh(SIZE, (4, 3, 2), perturbation=0.2, rng=np.random.default_rng(0))


@pytest.fixture
def mesh():
    return quadratic_mesh(straight())


def body_on(mesh, fixed=(), mu=MU, kappa=KAPPA, **extra):
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, DENSITY),
                    np.array(fixed, dtype=np.int64), **extra)


def lidded(mesh, **extra):
    """Body glued below with a pad on all of its top."""
    lid = Pad('lid', mesh.node_sets['z1'], np.array([0, 0, -1.0]), SIZE * [0.5, 0.5, 1], 0.01)
    return body_on(mesh, mesh.node_sets['z0'], pads=(lid,), **extra)


# ---- mesh


def test_promotion_puts_one_node_in_the_middle_of_every_edge(mesh):
    """V - E + F - T = 1 for a ball: as many new nodes as edges, so neighbours share theirs."""
    old = straight()
    V, T = len(old.nodes), len(old.tets)
    F = (4 * T + len(boundary_faces(old))) // 2
    assert len(mesh.nodes) == 2 * V + F - T - 1
    assert np.array_equal(mesh.nodes[:V], old.nodes)
    np.testing.assert_allclose(mesh.nodes[mesh.midside],
                               mesh.nodes[mesh.tets[:, EDGES]].mean(axis=2), atol=1e-17)
    assert quadratic_mesh(mesh) is mesh


def test_node_sets_gain_their_middles(mesh):
    for name, nodes in mesh.node_sets.items():
        axis, side = 'xyz'.index(name[0]), int(name[1]) * SIZE['xyz'.index(name[0])]
        assert np.array_equal(nodes, np.flatnonzero(np.abs(mesh.nodes[:, axis] - side) < 1e-12))


def test_an_edge_through_the_body_stays_free_though_its_ends_are_held():
    """The one cell's diagonal from corner to corner joins two surface nodes but is inside."""
    cell = quadratic_mesh(box_mesh(SIZE, (1, 1, 1)))
    held = with_midside(cell, np.arange(8))
    assert np.linalg.norm(cell.nodes[held] - SIZE / 2.0, axis=1).min() > 0.1 * SIZE.min()
    assert len(held) == len(cell.nodes) - 1


# ---- mass and weight


@pytest.mark.parametrize('kind', ['consistent', 'lumped'])
def test_total_mass(mesh, kind):
    M = mass_matrix(Assembler(body_on(mesh)), kind)
    for axis in np.eye(3):
        u = np.tile(axis, len(mesh.nodes))
        assert u @ (M @ u) == pytest.approx(DENSITY * VOLUME, rel=1e-12)


def test_consistent_mass_is_exact_for_products_of_quadratic_fields(mesh):
    """int rho x^2 y z = rho (a^3 / 3) (b^2 / 2) (c^2 / 2), any mesh; corners alone would miss."""
    M = mass_matrix(Assembler(body_on(mesh)), 'consistent')
    x, y, z = mesh.nodes.T
    a, b, c = SIZE
    left, right = np.zeros((len(x), 3)), np.zeros((len(x), 3))
    left[:, 1], right[:, 1] = x * x, y * z
    exact = DENSITY * a ** 3 / 3.0 * b ** 2 / 2.0 * c ** 2 / 2.0
    assert left.ravel() @ (M @ right.ravel()) == pytest.approx(exact, rel=1e-12)
    assert left.ravel() @ (M @ left.ravel()) == pytest.approx(DENSITY * a ** 5 / 5.0 * b * c,
                                                               rel=1e-12)


def test_weight_has_the_exact_resultant_moment_and_work(mesh):
    """At rest only weight is out of balance; its work in a quadratic motion is the integral's."""
    gravity = np.array([1.0, -2.0, -9.81])
    weight = -Assembler(body_on(mesh, gravity=gravity)).forces(mesh.nodes)
    total = DENSITY * VOLUME * gravity
    np.testing.assert_allclose(weight.sum(axis=0), total, rtol=1e-12)
    np.testing.assert_allclose(np.cross(mesh.nodes, weight).sum(axis=0),
                               np.cross(SIZE / 2.0, total), atol=1e-12 * np.abs(total).max())
    x, y, _ = mesh.nodes.T
    a, b, c = SIZE
    assert weight[:, 2] @ (x * x) == pytest.approx(-9.81 * DENSITY * a ** 3 / 3 * b * c, rel=1e-12)
    assert weight[:, 0] @ (x * y) == pytest.approx(DENSITY * VOLUME * a * b / 4.0, rel=1e-12)


def test_a_hanging_mass_keeps_its_moment(mesh):
    """Shared among corners only, none negative, centre where it hangs (on the surface)."""
    point = np.array([0.013, 0.011, SIZE[2]])
    masses = load_masses(mesh, (PointLoad('m', tuple(point), 0.02),))
    assert masses.min() >= 0.0
    np.testing.assert_allclose(masses.sum(), 0.02, rtol=1e-12)
    np.testing.assert_allclose(masses @ mesh.nodes, 0.02 * point, atol=1e-15)


# ---- markers and targets

BEND = 3.0  # 1/m: 12 % strain at the far end


def bent(X):
    """A quadratic motion and its gradient (k, 3), (k, 3, 3)."""
    x, y, z = X.T
    moved = X + BEND * np.stack([x * z, y * x, -0.5 * x * x + z * y], axis=-1)
    o = 0.0 * x
    H = BEND * np.array([[z, o, x], [y, x, o], [-x, z, y]])
    return moved, np.eye(3) + np.moveaxis(H, -1, 0)


def test_points_inside_follow_a_quadratic_motion_exactly(mesh):
    points = np.random.default_rng(1).uniform(0.0, 1.0, (50, 3)) * SIZE
    riders = embed(mesh, points)
    moved = interpolate(riders, bent(mesh.nodes)[0])
    np.testing.assert_allclose(moved, bent(points)[0], atol=1e-14)  # ten terms of 0.04 m
    np.testing.assert_allclose(riders.matrix(len(mesh.nodes)) @ mesh.nodes, points, atol=1e-14)


def test_material_turns_by_the_polar_rotation_of_the_motion_there(mesh):
    points = np.random.default_rng(2).uniform(0.05, 0.95, (20, 3)) * SIZE
    exact = np.array([polar(F)[0] for F in bent(points)[1]])
    got = rotations(embed(mesh, points), bent(mesh.nodes)[0])
    np.testing.assert_allclose(got, exact, atol=1e-12)


def test_a_marker_off_the_surface_moves_with_the_gradient_at_its_foot(mesh):
    """x + F s, s from the surface to the marker; rigid motion carries it rigidly."""
    feet = np.array([[0.013, 0.011, SIZE[2]], [0.0, 0.017, 0.007]])
    off = np.array([[0.0, 0.0, 0.006], [-0.004, 0.0, 0.0]])
    riders = embed(mesh, feet + off)
    x, F = bent(feet)
    np.testing.assert_allclose(interpolate(riders, bent(mesh.nodes)[0]),
                               x + np.einsum('kij,kj->ki', F, off), atol=1e-14)
    Q = Rotation.from_rotvec([0.5, -1.0, 2.0]).as_matrix()
    np.testing.assert_allclose(interpolate(riders, mesh.nodes @ Q.T + 0.1),
                               (feet + off) @ Q.T + 0.1, atol=1e-14)
    np.testing.assert_allclose(rotations(riders, mesh.nodes @ Q.T), [Q, Q], atol=1e-13)


# ---- scene, pads


@pytest.fixture
def scene(tmp_path):
    mesh = box_mesh((0.04, 0.04, 0.03), (8, 8, 6))
    meshio.Mesh(mesh.nodes, [('tetra', mesh.tets)]).write(tmp_path / 'box.vtu')
    pad = PadPatch('top', (0.02, 0.02, 0.03), (0.0, 0.0, -1.0), radius=0.011)
    return Scene('box', MeshFile(str(tmp_path / 'box.vtu')),
                 Region('half_space', normal=(0.0, 0.0, -1.0), point=(0.0, 0.0, 0.0)), pads=(pad,))


def test_a_scene_names_its_element(scene):
    for element, nodes in (('quadratic', 10), ('linear', 4)):
        body = build_body(dataclasses.replace(scene, element=element))
        assert body.geometry.connectivity.shape[1] == nodes


def test_a_pad_holds_its_middles_and_moves_as_one(scene):
    """Edges under the disc cannot bow: every surface edge with both ends held has its middle."""
    body = build_body(scene)
    linear = build_body(dataclasses.replace(scene, element='linear'))
    pad, corners = body.pads[0], linear.pads[0].nodes
    assert np.array_equal(pad.nodes[pad.nodes < len(linear.mesh.nodes)], corners)
    x, y, z = body.mesh.nodes[pad.nodes].T
    assert np.abs(z - 0.03).max() < 1e-12 and np.hypot(x - 0.02, y - 0.02).max() <= 0.011 * 1.001
    faces = boundary_faces(body.mesh)
    under = faces[np.isin(faces, corners).all(axis=1)]
    edges = np.unique(np.sort(under[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    middles = body.mesh.nodes[edges].mean(axis=1)
    gaps = np.linalg.norm(middles[:, None] - body.mesh.nodes[pad.nodes], axis=2).min(axis=1)
    assert gaps.max() < 1e-12
    push = np.array([0.001, 0.0, -0.003])
    solver = StaticSolver(body)
    found = solver.solve(body.mesh.nodes, [push])
    np.testing.assert_array_equal(found.x[pad.nodes], body.mesh.nodes[pad.nodes] + push)
    np.testing.assert_array_equal(found.x[body.fixed], body.mesh.nodes[body.fixed])
    base = solver.assembler.forces(found.x)[body.fixed].sum(axis=0)
    # what is out of balance inside: tolerance 1e-10 m times the stiffness of some 1e3 N/m
    np.testing.assert_allclose(found.pad_force[0], base, atol=1e-7)


# ---- terms

NORMAL, TANGENTIAL = 2e6, 5e5  # N/m^3


def test_foundation_resists_rigid_motions_exactly(mesh):
    """Force k A t; moments k_n I about x and y, k_t (I_x + I_y) about z; degree 2, so no error."""
    springs = BaseCompliance(NORMAL, TANGENTIAL).prepare(
        body_on(mesh, mesh.node_sets['z0'])).springs
    a, b, _ = SIZE
    arm = mesh.nodes[springs.nodes] - SIZE * [0.5, 0.5, 0.0]

    def forces(u):
        return np.einsum('sij,sj->si', springs.stiffness, np.broadcast_to(u, arm.shape))

    k = np.array([TANGENTIAL, TANGENTIAL, NORMAL])
    t = np.array([0.3, -0.2, 0.7])
    np.testing.assert_allclose(forces(t).sum(axis=0), k * a * b * t, rtol=1e-12)
    np.testing.assert_allclose(np.cross(arm, forces(t)).sum(axis=0), 0.0, atol=1e-12 * NORMAL * a)
    inertia = a * b / 12.0 * np.array([NORMAL * b ** 2, NORMAL * a ** 2,
                                       TANGENTIAL * (a ** 2 + b ** 2)])
    for axis, moment in zip(np.eye(3), inertia, strict=True):
        f = forces(np.cross(axis, arm))
        np.testing.assert_allclose(np.cross(arm, f).sum(axis=0), axis * moment,
                                   atol=1e-12 * inertia.max())
        np.testing.assert_allclose(f.sum(axis=0), 0.0, atol=1e-12 * NORMAL * a ** 2 * b)


def test_a_sprung_lidded_body_balances_lid_and_springs(mesh):
    """Solved: what the springs carry is what the lid is pushed with."""
    body = BaseCompliance(NORMAL, TANGENTIAL).prepare(lidded(mesh))
    found = StaticSolver(body).solve(mesh.nodes, [[0.0005, 0.0, -0.001]])
    assert found.outcome.ok
    u = (found.x - mesh.nodes)[body.springs.nodes]
    carried = -np.einsum('sij,sj->i', body.springs.stiffness, u)
    # out of balance inside: tolerance 1e-10 m times some 1e3 N/m
    np.testing.assert_allclose(found.pad_force[0], carried, atol=1e-7)


def test_homogeneous_relaxation_is_the_prony_series(mesh):
    """A sudden isochoric strain, held: every nodal force follows one curve, nothing inside moves.

    Exact recursion: rounding, and 1e-9 s of ramp over tau.
    """
    term, body = Viscoelasticity(g1=0.3, tau1=3.0, g2=0.2, tau2=40.0), body_on(mesh)
    assembler = Assembler(body)
    F = np.array([[1.2, 0.3, 0.0], [0.0, 1.1, 0.1], [0.0, 0.0, 1.0 / 1.32]])  # det 1
    x, memory, before = mesh.nodes @ F.T, term.memory(body), 0.0
    rested = assembler.forces(x)
    inside = np.setdiff1d(np.arange(len(x)), with_midside(mesh, boundary_faces(mesh)))
    for t in (1e-9, 0.5, 2.0, 10.0, 100.0):
        fields = StepFields.of(body)
        term.before_step(body, memory, t, t - before, fields)
        series = (0.5 + 0.3 * math.exp(-t / 3.0) + 0.2 * math.exp(-t / 40.0)) / 0.5
        forces = assembler.forces(x, fields)
        np.testing.assert_allclose(forces, series * rested, atol=1e-8 * np.abs(rested).max())
        np.testing.assert_allclose(forces[inside], 0.0, atol=1e-12 * np.abs(rested).max())
        memory, before = term.after_step(body, memory, x, t, t - before), t


def test_series_bar_of_two_halves():
    """A sphere so large that it is a half space, nu = 0: E_eff = 2 E ratio / (1 + ratio)."""
    bar = quadratic_mesh(box_mesh((0.02, 0.02, 0.08), (2, 2, 8)))
    end = Pad('end', bar.node_sets['z1'], np.array([0, 0, 1.0]), np.array([0.01, 0.01, 0.08]), 1.0)
    mu, kappa = moduli(6e3, 0.0)
    half = Inclusion(centre=(0.01, 0.01, 0.04 + 1e4), radius=1e4, ratio=3.0)
    body = half.prepare(body_on(bar, bar.node_sets['z0'], mu, kappa, pads=(end,)))
    strain = 1e-5  # the law is linear to that
    pull = StaticSolver(body).solve(bar.nodes, [[0.0, 0.0, strain * 0.08]])
    assert -pull.pad_force[0, 2] == pytest.approx(2 * 6e3 * 3 / 4 * strain * 4e-4, rel=1e-4)


def test_stiffness_scales_forces_and_leaves_positions(mesh):
    body, push = lidded(mesh), [[0.001, 0.0, -0.001]]
    plain, scaled = (StaticSolver(b).solve(mesh.nodes, push)
                     for b in (body, StiffnessScale(factor=2.5).prepare(body)))
    assert plain.outcome.ok and scaled.outcome.ok
    np.testing.assert_allclose(scaled.x, plain.x, rtol=0.0, atol=1e-9)  # ten times the tolerance
    np.testing.assert_allclose(scaled.pad_force, 2.5 * plain.pad_force, rtol=1e-6, atol=1e-7)
