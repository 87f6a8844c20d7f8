"""Quasi-static elasticity in both elements against closed forms, balances and another solver."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from arm_brachy.tissue import material
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody, Springs
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import edge_matrices
from arm_brachy.tissue.mesh import (
    boundary_faces,
    face_middles,
    quadratic_mesh,
    volumes,
    with_midside,
)
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver

L = 0.04
E, NU = 6000.0, 0.45
MU, KAPPA = material.moduli(E, NU)
GAMMA = 0.4


def make_body(mesh, fixed, *, mu=MU, kappa=KAPPA, **extra):
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0), fixed, **extra)


@pytest.fixture(params=['linear', 'quadratic'])
def element(request):
    return request.param


def irregular_box(element, cells=4, size=(L, L, L), seed=0):
    mesh = box_mesh(size, (cells,) * 3, perturbation=0.2, rng=np.random.default_rng(seed))
    return quadratic_mesh(mesh) if element == 'quadratic' else mesh


def boundary_nodes(mesh):
    return with_midside(mesh, boundary_faces(mesh))


def nodal_areas(mesh):
    """(n, 3) outward area vectors of the nodes: integrals of the shape functions over the surface.

    Of a linear face a third at each corner, of a quadratic one nothing there and a third at each
    middle (Zienkiewicz & Taylor): exact for a constant traction.
    """
    faces = boundary_faces(mesh)
    corners = mesh.nodes[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 6.0
    out = np.zeros_like(mesh.nodes)
    carriers = faces if mesh.midside is None else face_middles(mesh, faces)
    np.add.at(out, carriers.ravel(), np.repeat(area, 3, axis=0))
    return out


SHEAR = np.array([[1.0, GAMMA, 0], [0, 1, 0], [0, 0, 1]])
SQUEEZE = np.diag([1.0, 1.0, 0.8])
GENERAL = np.array([[1.1, 0.2, -0.1], [0.05, 0.9, 0.1], [0.0, -0.2, 1.05]])


@pytest.mark.parametrize('F', [SHEAR, SQUEEZE, GENERAL], ids=['shear', 'confined', 'general'])
def test_patch(element, F):
    """Affine boundary motion gives the affine field inside and constant traction on the faces."""
    mesh = irregular_box(element)
    body = make_body(mesh, boundary_nodes(mesh))
    solver = StaticSolver(body, options=NewtonOptions(tolerance=1e-14))
    affine = mesh.nodes @ F.T
    result = solver.solve_held(mesh.nodes, affine)
    np.testing.assert_allclose(result.x, affine, atol=1e-13)
    traction = nodal_areas(mesh) @ material.stress(F, MU, KAPPA).T
    np.testing.assert_allclose(solver.assembler.forces(result.x), traction,
                               atol=1e-12 * KAPPA * L ** 2)


def test_simple_shear_closed_form(element):
    """F = I + gamma e1 e2': shear traction mu gamma, and the normal -mu gamma^2 / 3 (Poynting)."""
    mesh = irregular_box(element)
    forces = Assembler(make_body(mesh, boundary_nodes(mesh))).forces(mesh.nodes @ SHEAR.T)
    top = np.setdiff1d(mesh.node_sets['y1'], np.concatenate(
        [mesh.node_sets[s] for s in ('x0', 'x1', 'z0', 'z1')]))  # not on the edges of the face
    area = nodal_areas(mesh)[top, 1]
    expected = np.array([MU * GAMMA, -MU * GAMMA ** 2 / 3.0, 0.0])
    np.testing.assert_allclose(forces[top], area[:, None] * expected, atol=1e-11 * KAPPA * L ** 2)


def rollers(mesh, stiffness):
    """Stiff springs that stop the faces x0, y0, z0 along their normals and nothing else."""
    blocks = np.zeros((len(mesh.nodes), 3, 3))
    for axis, name in enumerate(('x0', 'y0', 'z0')):
        blocks[mesh.node_sets[name], axis, axis] = stiffness
    nodes = np.flatnonzero(blocks.any(axis=(1, 2)))
    return Springs(nodes, blocks[nodes])


def held_by_dead_loads(element, stretches, tractions):
    """Check x = diag(stretches) X under tractions [Pa] on the faces x1, y1, z1 of a box."""
    mesh = irregular_box(element, 3)
    load, area = np.zeros_like(mesh.nodes), nodal_areas(mesh)
    for axis, name in enumerate(('x1', 'y1', 'z1')):
        end = mesh.node_sets[name]
        load[end, axis] = tractions[axis] * area[end, axis]
    body = make_body(mesh, np.zeros(0, dtype=int), springs=rollers(mesh, 1e8), nodal_force=load)
    solution = StaticSolver(body).solve(mesh.nodes, np.zeros((0, 3)))
    assert solution.outcome.ok
    # the springs give way by load / stiffness, some 1e-8 m
    np.testing.assert_allclose(solution.x, mesh.nodes * stretches, atol=5e-8)


@pytest.mark.parametrize('stretch', [0.8, 1.3])
def test_uniaxial_closed_form(element, stretch):
    """A dead load on the end face, sides free: lateral stretch from P22 = 0, load = P11 A.

    Stable down to 0.76, where the load reaches mu: from there on the loaded face, which the dead
    load does not hold flat, tilts (lowest eigenvalue of the tangent at the homogeneous state).
    """
    def stress(lateral):
        return material.stress(np.diag([stretch, lateral, lateral]), MU, KAPPA)

    lateral = brentq(lambda b: stress(b)[1, 1], 0.5, 1.5, xtol=1e-15)
    held_by_dead_loads(element, [stretch, lateral, lateral], [stress(lateral)[0, 0], 0.0, 0.0])


def test_equibiaxial_closed_form(element):
    """Principal stresses of the law written out; thickness from P33 = 0.

    P_i = mu J^(-2/3) (l_i - I1 / (3 l_i)) + kappa J (J - 1) / l_i
    """
    def traction(stretch, thickness):
        stretches = np.array([stretch, stretch, thickness])
        J, I1 = np.prod(stretches), np.sum(stretches ** 2)
        return (MU * J ** (-2.0 / 3.0) * (stretches - I1 / (3.0 * stretches))
                + KAPPA * J * (J - 1.0) / stretches)

    thickness = brentq(lambda t: traction(1.2, t)[2], 0.3, 1.5, xtol=1e-15)
    P = traction(1.2, thickness)
    held_by_dead_loads(element, [1.2, 1.2, thickness], [P[0], P[1], 0.0])


def pushed_box(element, **extra):
    mesh = irregular_box(element, 4, (L, L, 0.75 * L))
    x, y, z = mesh.nodes.T
    top = np.flatnonzero(np.isclose(z, 0.75 * L) & (np.hypot(x - L / 2, y - L / 2) < 0.0145))
    side = np.flatnonzero(np.isclose(x, 0.0) & (np.hypot(y - L / 2, z - 0.015) < 0.011))
    pads = (Pad('top', top, np.array([0, 0, -1.0]), np.array([L / 2, L / 2, 0.75 * L]), 0.02),
            Pad('side', side, np.array([1.0, 0, 0]), np.array([0, L / 2, 0.015]), 0.02))
    return make_body(mesh, mesh.node_sets['z0'], pads=pads, **extra)


PUSH = np.array([[0.0005, 0.0, -0.004], [0.003, 0.0, 0.0]])


def tissue_mass(mesh):
    """(n,) [kg] integrals of the shape functions times 1000 kg/m^3, in closed form.

    A quarter of the element at each corner if linear; if quadratic minus a twentieth there and a
    fifth at each middle, which alone has the right resultant and moment.
    """
    shares = np.full(4, 0.25) if mesh.midside is None else np.repeat([-0.05, 0.2], [4, 6])
    return np.bincount(mesh.connectivity.ravel(),
                       1000.0 * np.outer(volumes(mesh), shares).ravel())


def test_forces_and_moments_balance(element):
    """Pads, base, springs, weight and dead loads leave no net force and no net moment."""
    plain = pushed_box(element)
    n = len(plain.mesh.nodes)
    rng = np.random.default_rng(2)
    nodes = np.setdiff1d(plain.mesh.node_sets['x1'], plain.fixed)
    body = dataclasses.replace(
        plain, gravity=np.array([0.3, 0.0, -9.81]), nodal_mass=rng.uniform(0, 1e-4, n),
        nodal_force=rng.normal(scale=1e-3, size=(n, 3)),
        springs=Springs(nodes, np.broadcast_to(20.0 * np.eye(3), (len(nodes), 3, 3))))
    solver = StaticSolver(body)
    solution = solver.solve(body.mesh.nodes, PUSH)
    assert solution.outcome.ok
    x, X = solution.x, body.mesh.nodes
    applied = (tissue_mass(body.mesh) + body.nodal_mass)[:, None] * body.gravity + body.nodal_force
    applied[nodes] -= 20.0 * (x - X)[nodes]
    base = solver.assembler.forces(x)[body.fixed]
    force = applied.sum(axis=0) + base.sum(axis=0) - solution.pad_force.sum(axis=0)
    centres = np.array([p.centre for p in body.pads]) + PUSH
    moment = (np.cross(x, applied).sum(axis=0) + np.cross(x[body.fixed], base).sum(axis=0)
              - (solution.pad_moment + np.cross(centres, solution.pad_force)).sum(axis=0))
    scale = np.abs(solution.pad_force).max()
    np.testing.assert_allclose(force, 0.0, atol=1e-7 * scale)
    np.testing.assert_allclose(moment, 0.0, atol=1e-7 * scale * L)


def test_agrees_with_an_independent_minimiser():
    """SciPy's BFGS on energies summed in plain NumPy, a mesh of 48 elements."""
    mesh = box_mesh((L, L, L), (2, 2, 2), perturbation=0.2, rng=np.random.default_rng(3))
    centre = np.array([L / 2, L / 2, L])
    pad = Pad('top', mesh.node_sets['z1'], np.array([0, 0, -1.0]), centre, L)
    body = make_body(mesh, mesh.node_sets['z0'], pads=(pad,), gravity=np.array([0, 0, -9.81]))
    solver = StaticSolver(body)
    ours = solver.solve(mesh.nodes, [[0.004, 0.0, -0.006]])
    inverse = np.linalg.inv(edge_matrices(mesh.nodes, mesh.tets))
    weight = np.bincount(mesh.tets.ravel(), np.repeat(250.0 * volumes(mesh), 4)) * -9.81
    free = solver.free.free
    start = solver.held_positions([[0.004, 0.0, -0.006]])
    start[free] += [0.002, 0.0, -0.003]  # halfway, or the top layer begins turned inside out

    def positions(q):
        x = start.copy()
        x[free] = L * q.reshape(-1, 3)
        return x

    def energy(q):
        x = positions(q)
        F = edge_matrices(x, mesh.tets) @ inverse
        stored = volumes(mesh) @ material.energy(F, MU, KAPPA)
        return (stored - weight @ (x - mesh.nodes)[:, 2]) / (E * L ** 3)

    found = minimize(energy, start[free].ravel() / L, method='BFGS', options={'gtol': 1e-10})
    np.testing.assert_allclose(ours.x, positions(found.x), atol=1e-6)
    np.testing.assert_allclose(solver.assembler.energy(ours.x), found.fun * E * L ** 3,
                               rtol=1e-9)
