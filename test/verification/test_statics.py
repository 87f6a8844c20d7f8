"""Quasi-static elasticity against closed forms, balances, convergence rates and another solver."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from arm_brachy.tissue import material
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody, Springs
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import edge_matrices
from arm_brachy.tissue.mesh import boundary_faces, volumes
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver

L = 0.04
E, NU = 6000.0, 0.45
MU, KAPPA = material.moduli(E, NU)
GAMMA = 0.4


def make_body(mesh, fixed, *, mu=MU, kappa=KAPPA, **extra):
    m = len(mesh.tets)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0), fixed, **extra)


def irregular_box(cells=4, size=(L, L, L), seed=0):
    return box_mesh(size, (cells,) * 3, perturbation=0.2, rng=np.random.default_rng(seed))


def boundary_nodes(mesh):
    return np.unique(boundary_faces(mesh))


def nodal_areas(mesh):
    """(n, 3) outward area vectors lumped to nodes: exact for a constant traction."""
    faces = boundary_faces(mesh)
    corners = mesh.nodes[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 6.0
    out = np.zeros_like(mesh.nodes)
    np.add.at(out, faces.ravel(), np.repeat(area, 3, axis=0))
    return out


SHEAR = np.array([[1.0, GAMMA, 0], [0, 1, 0], [0, 0, 1]])
SQUEEZE = np.diag([1.0, 1.0, 0.8])
GENERAL = np.array([[1.1, 0.2, -0.1], [0.05, 0.9, 0.1], [0.0, -0.2, 1.05]])


@pytest.mark.parametrize('F', [SHEAR, SQUEEZE, GENERAL], ids=['shear', 'confined', 'general'])
def test_patch(F):
    """Affine boundary motion gives the affine field inside and constant traction on the faces."""
    mesh = irregular_box()
    body = make_body(mesh, boundary_nodes(mesh))
    solver = StaticSolver(body, options=NewtonOptions(tolerance=1e-14))
    affine = mesh.nodes @ F.T
    result = solver.solve_held(mesh.nodes, affine)
    np.testing.assert_allclose(result.x, affine, atol=1e-13)
    traction = nodal_areas(mesh) @ material.stress(F, MU, KAPPA).T
    np.testing.assert_allclose(solver.assembler.forces(result.x), traction,
                               atol=1e-12 * KAPPA * L ** 2)


def test_simple_shear_closed_form():
    """F = I + gamma e1 e2': shear traction mu gamma, and the normal -mu gamma^2 / 3 (Poynting)."""
    mesh = irregular_box()
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


@pytest.mark.parametrize('stretch', [0.75, 1.3])
def test_uniaxial_closed_form(stretch):
    """A dead load on the end face, sides free: lateral stretch from P22 = 0, load = P11 A."""
    def stress(lateral):
        return material.stress(np.diag([stretch, lateral, lateral]), MU, KAPPA)

    lateral = brentq(lambda b: stress(b)[1, 1], 0.5, 1.5, xtol=1e-15)
    mesh = irregular_box(3)
    load = np.zeros_like(mesh.nodes)
    end = mesh.node_sets['x1']
    load[end, 0] = stress(lateral)[0, 0] * nodal_areas(mesh)[end, 0]
    body = make_body(mesh, np.zeros(0, dtype=int), springs=rollers(mesh, 1e8), nodal_force=load)
    solution = StaticSolver(body).solve(mesh.nodes, np.zeros((0, 3)))
    assert solution.outcome.ok
    exact = mesh.nodes * [stretch, lateral, lateral]
    # the springs give way by load / stiffness, some 1e-8 m
    np.testing.assert_allclose(solution.x, exact, atol=5e-8)


def test_rigid_motion_gives_no_stress_and_turns_what_there_is():
    mesh = irregular_box(3)
    assembler = Assembler(make_body(mesh, np.zeros(0, dtype=int)))
    angle = 1.2
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    scale = KAPPA * L ** 2
    moved = mesh.nodes @ R.T + [0.1, -0.2, 0.05]
    np.testing.assert_allclose(assembler.forces(moved), 0.0, atol=1e-13 * scale)
    x = mesh.nodes + np.random.default_rng(1).uniform(-1e-3, 1e-3, mesh.nodes.shape)
    np.testing.assert_allclose(assembler.forces(x @ R.T + 0.1), assembler.forces(x) @ R.T,
                               atol=1e-12 * scale)


def pushed_box(**extra):
    mesh = irregular_box(4, (L, L, 0.75 * L))
    x, y, z = mesh.nodes.T
    top = np.flatnonzero(np.isclose(z, 0.75 * L) & (np.hypot(x - L / 2, y - L / 2) < 0.0145))
    side = np.flatnonzero(np.isclose(x, 0.0) & (np.hypot(y - L / 2, z - 0.015) < 0.011))
    pads = (Pad('top', top, np.array([0, 0, -1.0]), np.array([L / 2, L / 2, 0.75 * L]), 0.02),
            Pad('side', side, np.array([1.0, 0, 0]), np.array([0, L / 2, 0.015]), 0.02))
    return make_body(mesh, mesh.node_sets['z0'], pads=pads, **extra)


PUSH = np.array([[0.0005, 0.0, -0.004], [0.003, 0.0, 0.0]])


def test_work_of_the_pads_is_the_stored_energy():
    """Simpson's rule along the path; its error at 16 intervals is below 1e-6 of the energy."""
    solver = StaticSolver(pushed_box())
    x, power = solver.body.mesh.nodes, []
    for fraction in np.linspace(0.0, 1.0, 17):
        solution = solver.solve(x, fraction * PUSH)
        x = solution.x
        power.append(-np.sum(solution.pad_force * PUSH))
    weights = np.array([1.0] + 7 * [4.0, 2.0] + [4.0, 1.0]) / 48.0
    np.testing.assert_allclose(weights @ power, solver.assembler.energy(x), rtol=1e-6)


def test_forces_and_moments_balance():
    """Pads, base, springs, weight and dead loads leave no net force and no net moment."""
    plain = pushed_box()
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
    mass = np.bincount(body.mesh.tets.ravel(), np.repeat(250.0 * volumes(body.mesh), 4))
    applied = (mass + body.nodal_mass)[:, None] * body.gravity + body.nodal_force
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


# ---- convergence on a manufactured solution: u = A g(X), zero on the surface of the cube

AMPLITUDE = L * np.array([0.05, -0.03, 0.04])
WAVE = np.pi / L
# Degree-2 rule on the tetrahedron (Zienkiewicz & Taylor): four points, equal weights.
QUADRATURE = np.full((4, 4), 0.1381966011250105) + np.eye(4) * 0.4472135954999579


def exact_displacement(X):
    return np.prod(np.sin(WAVE * X), axis=-1, keepdims=True) * AMPLITUDE


def exact_gradient(X):
    s, c = np.sin(WAVE * X), np.cos(WAVE * X)
    slope = WAVE * np.stack([c[..., 0] * s[..., 1] * s[..., 2], s[..., 0] * c[..., 1] * s[..., 2],
                             s[..., 0] * s[..., 1] * c[..., 2]], axis=-1)
    return AMPLITUDE[:, None] * slope[..., None, :]


def body_force(X, mu, kappa):
    """-Div P, by central differences of the exact stress in X."""
    h, out = 1e-5 * L, np.zeros_like(X)
    for k in range(3):
        step = h * np.eye(3)[k]
        ahead, back = (material.stress(np.eye(3) + exact_gradient(X + s * step), mu, kappa)
                       for s in (1.0, -1.0))
        out -= (ahead - back)[..., k] / (2 * h)
    return out


def manufactured_errors(cells):
    """Relative L2 error of displacement and of its gradient on a mesh of cells^3 x 6 elements."""
    mesh = irregular_box(cells)
    mu, kappa = material.moduli(E, 0.3)
    V = volumes(mesh)
    points = np.einsum('qa,mai->mqi', QUADRATURE, mesh.nodes[mesh.tets])
    load = np.zeros_like(mesh.nodes)
    shares = np.einsum('m,qa,mqi->mai', V / 4, QUADRATURE, body_force(points, mu, kappa))
    np.add.at(load, mesh.tets, shares)
    body = make_body(mesh, boundary_nodes(mesh), mu=mu, kappa=kappa, nodal_force=load)
    solution = StaticSolver(body).solve(mesh.nodes, np.zeros((0, 3)))
    assert solution.outcome.ok
    u = solution.x - mesh.nodes
    H = (edge_matrices(solution.x, mesh.tets)
         @ np.linalg.inv(edge_matrices(mesh.nodes, mesh.tets)) - np.eye(3))
    exact, slope = exact_displacement(points), exact_gradient(points)
    off = np.einsum('qa,mai->mqi', QUADRATURE, u[mesh.tets]) - exact
    tilt = H[:, None] - slope

    def norm(field):
        squared = np.sum(field ** 2, axis=tuple(range(2, field.ndim)))
        return np.sqrt(np.sum(V[:, None] / 4 * squared))

    return norm(off) / norm(exact), norm(tilt) / norm(slope)


def test_manufactured_solution_converges_at_the_rate_of_linear_elements():
    """Error halves per halving of h in the gradient (order 1) and quarters in u (order 2)."""
    coarse, fine = np.array(manufactured_errors(6)), np.array(manufactured_errors(12))
    rate_u, rate_gradient = np.log2(coarse / fine)
    assert 1.8 < rate_u < 2.2
    assert 0.9 < rate_gradient < 1.1
    assert fine[0] < 0.05
