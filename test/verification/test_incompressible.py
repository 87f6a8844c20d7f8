"""Nearly incompressible bodies: pressurised sphere, cantilever, kept volume.

Quadratic elements must come out right; linear ones are shown to lock, with sign and size.
"""

import numpy as np
import pytest
from skfem import ElementTriP2
from skfem.quadrature import get_quadrature

from arm_brachy.tissue.body import Pad, SoftBody, Springs, TetMesh
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import point_moduli, signed_volumes
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import boundary_faces, face_middles, quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver

E = 6000.0
NO_PADS = np.zeros((0, 3))


def as_element(mesh, element):
    return quadratic_mesh(mesh) if element == 'quadratic' else mesh


def make_body(mesh, nu, fixed, **extra):
    m, (mu, kappa) = len(mesh.tets), moduli(E, nu)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0), fixed, **extra)


def rollers(planes, held, n, stiffness=1e6):
    """Springs normal to planes {axis: nodes}, not at `held` ones: 1e6 N/m gives way by 1e-8 m."""
    blocks = np.zeros((n, 3, 3))
    for axis, nodes in planes.items():
        blocks[np.setdiff1d(nodes, held), axis, axis] = stiffness
    nodes = np.flatnonzero(blocks.any(axis=(1, 2)))
    return Springs(nodes, blocks[nodes])


# ---- thick-walled sphere, an octant, blown up from inside

INNER, OUTER = 0.02, 0.04


def sphere_octant(cells):
    """Three blocks, one over each face of the cube that meets the octant, glued together."""
    parts, tets, start = [], [], 0
    for axis in range(3):
        block = box_mesh((1.0, 1.0, 1.0), (cells,) * 3)
        s, t, r = block.nodes.T
        angle = np.tan(np.pi / 4.0 * np.column_stack([s, t]))  # equal angles between grid lines
        ray = np.insert(angle, axis, 1.0, axis=1) if axis else np.column_stack([np.ones(len(s)),
                                                                                 angle])
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        parts.append((INNER + (OUTER - INNER) * r)[:, None] * ray)
        tets.append(block.tets + start)
        start += len(s)
    nodes, tets = np.vstack(parts), np.vstack(tets)
    _, first, which = np.unique(np.round(nodes / OUTER, 9), axis=0, return_index=True,
                                return_inverse=True)
    nodes, tets = nodes[first], which.reshape(-1)[tets]
    flip = signed_volumes(nodes, tets) < 0.0
    tets[flip] = tets[flip][:, [0, 2, 1, 3]]
    radius = np.linalg.norm(nodes, axis=1)
    sets = {'inner': np.flatnonzero(radius < INNER * (1 + 1e-9)),
            'outer': np.flatnonzero(radius > OUTER * (1 - 1e-9))}
    sets |= {f'plane{axis}': np.flatnonzero(nodes[:, axis] < 1e-12) for axis in range(3)}
    return TetMesh(nodes, tets, sets)


def blown_sphere(element, cells, nu, inflated=1.2):
    """(pressure on the inner wall [Pa], distance [m] of the outer wall from where it belongs).

    Inner nodes are put where the incompressible solution takes them. The pressure is the work of
    their forces in a radial motion over the volume that it sweeps, pi/2 r^2 per octant; planes
    of symmetry do no work in it.
    """
    mesh = as_element(sphere_octant(cells), element)
    X, sets = mesh.nodes, mesh.node_sets
    inner, outer = sets['inner'], sets['outer']
    planes = {axis: sets[f'plane{axis}'] for axis in range(3)}
    body = make_body(mesh, nu, inner, springs=rollers(planes, inner, len(X)))
    R = np.linalg.norm(X, axis=1, keepdims=True)
    grown = X / R * np.cbrt(R ** 3 + (inflated ** 3 - 1.0) * INNER ** 3)
    solver = StaticSolver(body)
    found = solver.solve_held(X, grown)
    assert found.outcome.ok
    x, a = found.x, inflated * INNER
    radial = x[inner] / np.linalg.norm(x[inner], axis=1, keepdims=True)
    work = np.sum(solver.assembler.forces(x)[inner] * radial)
    return work / (0.5 * np.pi * a ** 2), np.linalg.norm((x - grown)[outer], axis=1).max()


def sphere_closed_form(mu, inflated=1.2):
    """Incompressible Neo-Hookean: p = 2 mu [f(b) - f(a)], f = 1/l + 1/(4 l^4), l = r / R.

    From p = int 2 mu (l^2 - l^-4) dr / r (Green & Zerna 1968, Theoretical Elasticity, 3.10).
    """
    b = np.cbrt(OUTER ** 3 + (inflated ** 3 - 1.0) * INNER ** 3)

    def f(stretch):
        return 1.0 / stretch + 0.25 / stretch ** 4

    return 2.0 * mu * (f(b / OUTER) - f(inflated))


def test_quadratic_sphere_approaches_the_incompressible_closed_form():
    """Pressure and outer wall at nu = 0.4999, off by some mu / kappa = 2e-4 for that.

    Edges are straight at rest: the hole is a polyhedron, with volume and area off by O(h^2), and
    that order is what is left. From 2 to 4 cells across a quarter circle the pressure's error
    falls from 3 to 0.6 %.
    """
    exact = sphere_closed_form(moduli(E, 0.4999)[0])
    (coarse, far), (fine, near) = (blown_sphere('quadratic', n, 0.4999) for n in (2, 4))
    assert abs(fine / exact - 1.0) < 0.01
    assert np.log2((coarse - exact) / (fine - exact)) > 1.8
    assert np.log2(far / near) > 1.8


def test_linear_sphere_locks():
    """The known defect: the wall must keep its volume in every element, pressure is ten times p.

    Too stiff, as Ritz's method must be; worse the nearer to 0.5; halving h does not help enough.
    """
    pressure = {(nu, n): blown_sphere('linear', n, nu)[0] / sphere_closed_form(moduli(E, nu)[0])
                for nu, n in ((0.49, 4), (0.499, 4), (0.4999, 4), (0.4999, 8))}
    assert 1.2 < pressure[0.49, 4] < pressure[0.499, 4] < pressure[0.4999, 4]
    assert pressure[0.4999, 4] > 5.0
    assert pressure[0.4999, 8] > 3.0


# ---- cantilever under a force at its end

LENGTH, HEIGHT = 0.12, 0.02


def area_shares(mesh, name):
    """(n,) share of each node in a uniform traction on the flat face `name`, sum 1."""
    faces = boundary_faces(mesh)
    faces = faces[np.isin(faces, mesh.node_sets[name]).all(axis=1)]
    a, b, c = (mesh.nodes[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    carriers = faces if mesh.midside is None else face_middles(mesh, faces)
    shares = np.bincount(carriers.ravel(), np.repeat(area, 3), minlength=len(mesh.nodes))
    return shares / shares.sum()


def cantilever(element, cells, nu):
    """Deflection of the end over Timoshenko's, small load, square section, half its width.

    w = F L^3 / (3 E I) + F L / (k G A), k = 10 (1 + nu) / (12 + 11 nu) (Cowper 1966, J Appl Mech
    33:335). The root may not move along the beam but may shrink sideways as beam theory has it;
    the shear force enters there as a traction, so that z is held at one node without reaction.
    """
    mesh = as_element(box_mesh((LENGTH, HEIGHT / 2.0, HEIGHT), cells), element)
    n, root = len(mesh.nodes), mesh.node_sets['x0']
    springs = rollers({0: root, 1: mesh.node_sets['y0'], 2: root[:1]}, [], n)
    solver = StaticSolver(make_body(mesh, nu, np.zeros(0, dtype=int), springs=springs))
    load = np.zeros((n, 3))
    load[:, 2] = area_shares(mesh, 'x1') - area_shares(mesh, 'x0')  # N
    _, factor = solver.linearise(mesh.nodes)
    deflection = load.ravel() @ factor.solve(load.ravel())  # mean of the end less that of the root
    area = HEIGHT ** 2 / 2.0
    inertia, G = area * HEIGHT ** 2 / 12.0, E / (2.0 * (1.0 + nu))
    k = 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu)
    return deflection / (LENGTH ** 3 / (3.0 * E * inertia) + LENGTH / (k * G * area))


def test_quadratic_cantilever_bends_as_timoshenko_says():
    """Two cells across: within half a percent where elements are integrated in full.

    A root that may not warp takes 0.1 % off (the share of shear, 2 %, times (h / L)^2 and a
    half), shear that varies across a cell another 0.2 %.
    """
    assert cantilever('quadratic', (12, 1, 2), 0.3) == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize('nu', [0.49, 0.499, 0.4999])
def test_quadratic_cantilever_near_incompressibility(nu):
    """Too soft by 1 % with two cells across, whatever nu; a quarter of it with four.

    Less by the 0.3 % of the test above, which does not fall with the cell.
    """
    two, four = (cantilever('quadratic', (6 * n, n // 2, n), nu) - 1.0 for n in (2, 4))
    assert 0.0 < two < 0.015
    assert (four + 0.001) / (two + 0.001) == pytest.approx(0.25, abs=0.05)


def test_linear_cantilever_locks():
    """The known defect: bends by half with two cells across at nu = 0.3, by a tenth near 0.5.

    Ritz: the deflection under a given force is too small. Four times the cells across brings the
    first within 10 %, the second from 0.09 to 0.12.
    """
    loose = [cantilever('linear', (12 * n, n, 2 * n), 0.3) for n in (1, 4)]
    tight = [cantilever('linear', (12 * n, n, 2 * n), 0.4999) for n in (1, 4)]
    assert loose[0] < 0.6 and 0.9 < loose[1] < 1.0
    assert tight[0] < tight[1] < 0.2


# ---- volume


def enclosed_volume(mesh, x):
    """Volume inside the deformed surface, one third of its flux of x: no tetrahedron involved.

    On a curved triangle x . (dx/ds x dx/dt) has degree 4.
    """
    (s, t), weights = get_quadrature(ElementTriP2(), 4)
    r = 1.0 - s - t
    N = np.stack([r * (2 * r - 1), s * (2 * s - 1), t * (2 * t - 1), 4 * r * s, 4 * s * t,
                  4 * t * r])
    Ns = np.stack([1 - 4 * r, 4 * s - 1, 0 * s, 4 * (r - s), 4 * t, -4 * t])
    Nt = np.stack([1 - 4 * r, 0 * t, 4 * t - 1, -4 * s, 4 * s, 4 * (r - t)])
    faces = boundary_faces(mesh)
    X = x[np.hstack([faces, face_middles(mesh, faces)])]
    at, along, across = (np.einsum('aq,fai->fqi', n, X) for n in (N, Ns, Nt))
    return np.einsum('q,fqi,fqi->', weights, at, np.cross(along, across)) / 3.0


def pressed_box(nu, side=0.03):
    """Box glued below, a square pad on top pushed in by 2 mm: (mesh, body, x, forces)."""
    mesh = quadratic_mesh(box_mesh((side,) * 3, (4, 4, 4)))
    inside = np.abs(mesh.nodes[:, :2] - side / 2.0).max(axis=1) < 0.3 * side
    top = np.intersect1d(mesh.node_sets['z1'], np.flatnonzero(inside))
    pad = Pad('pad', top, np.array([0, 0, -1.0]), np.array([side / 2, side / 2, side]), side)
    solver = StaticSolver(make_body(mesh, nu, mesh.node_sets['z0'], pads=(pad,)))
    found = solver.solve(mesh.nodes, [[0.0, 0.0, -0.002]])
    assert found.outcome.ok
    return mesh, solver.body, found.x, solver.assembler.forces(found.x)


def test_volume_is_kept_but_for_pressure_over_bulk_modulus():
    """The isochoric stress does no work in F, so sum f . x = 3 int kappa J (J - 1) exactly.

    The constraint is on J at the centre of each element: its sum goes with 1 / kappa. The volume
    enclosed differs from it by the error of one point for a polynomial of degree 3, of second
    order in the cell: below 2 % of the volume that the pad takes.
    """
    changes = []
    for nu in (0.499, 0.4999):
        mesh, body, x, forces = pressed_box(nu)
        g, volume, taken = body.geometry, 0.03 ** 3, 0.002 * 0.018 ** 2
        J = np.linalg.det(np.einsum('mai,mqak->mqik', x[g.connectivity], g.gradients))
        kappa = point_moduli(g, body)[1]
        change = np.sum((g.point_weights * (1.0 - g.shear)) * (J - 1.0))
        virial = np.sum(forces * x)
        assert virial == pytest.approx(3.0 * np.sum(g.point_weights * kappa * J * (J - 1.0)),
                                       rel=1e-6)
        assert enclosed_volume(mesh, mesh.nodes) == pytest.approx(volume, rel=1e-12)
        assert abs(enclosed_volume(mesh, x) - volume - change) < 0.02 * taken
        changes.append(change / volume)
    assert abs(changes[1]) < 1e-4
    assert changes[0] / changes[1] == pytest.approx(10.0, rel=0.15)  # as 1 / kappa
