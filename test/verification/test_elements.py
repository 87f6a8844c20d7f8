"""Both elements against manufactured solutions: exact where they must be, else at their rate."""

import numpy as np
import pytest
from scipy.special import roots_jacobi

from arm_brachy.tissue import material
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import edge_matrices, shape_slopes, shape_values
from arm_brachy.tissue.free_dofs import FreeDofs
from arm_brachy.tissue.mesh import (
    boundary_faces,
    face_middles,
    quadratic_mesh,
    volumes,
)
from arm_brachy.tissue.newton import StaticSolver

L = 0.04
E = 6000.0
ELEMENTS = ('linear', 'quadratic')


def box(element, cells, size=(L, L, L), seed=0):
    """Perturbed box; inner nodes move by up to a fifth of a cell."""
    cells = (cells,) * 3 if np.isscalar(cells) else cells
    mesh = box_mesh(size, cells, perturbation=0.2, rng=np.random.default_rng(seed))
    return quadratic_mesh(mesh) if element == 'quadratic' else mesh


def make_body(mesh, fixed, nu, **extra):
    m, (mu, kappa) = len(mesh.tets), material.moduli(E, nu)
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0), fixed, **extra)


def surface(mesh, names=('x0', 'x1', 'y0', 'y1', 'z0', 'z1')):
    return np.unique(np.concatenate([mesh.node_sets[name] for name in names]))


# ---- integration independent of the engine's own rules: Gauss-Jacobi points on collapsed bricks
# (Stroud 1971, Approximate Calculation of Multiple Integrals, sec. 2.4), degree 2 n - 1

def simplex_rule(dimension, n=3):
    """Barycentric points (q, d + 1) and weights (q,) that sum to 1."""
    L, w = np.ones((1, 1)), np.ones(1)
    for d in range(1, dimension + 1):
        x, v = roots_jacobi(n, 0.0, d - 1.0)  # weight (1 + x)^(d - 1) on [-1, 1]
        t, v = (1.0 + x) / 2.0, v / v.sum()
        L = np.concatenate([np.column_stack([s * L, np.full(len(L), 1.0 - s)]) for s in t])
        w = np.concatenate([s * w for s in v])
    return L, w


VOLUME_RULE, FACE_RULE = simplex_rule(3), simplex_rule(2)


def nodal_loads(mesh, body_force, traction, face_names):
    """Consistent nodal forces (n, 3) of a body force [N/m^3] and of tractions on flat faces."""
    load = np.zeros_like(mesh.nodes)
    points, weights = VOLUME_RULE
    conn = mesh.connectivity
    X = np.einsum('qa,mai->mqi', points, mesh.nodes[mesh.tets])
    N = shape_values(points, conn.shape[1])
    np.add.at(load, conn, np.einsum('m,q,qa,mqi->mai', volumes(mesh), weights, N, body_force(X)))
    points, weights = FACE_RULE
    N = shape_values(np.column_stack([points, np.zeros(len(points))]), conn.shape[1])
    N = N[:, [0, 1, 2] if mesh.midside is None else [0, 1, 2, 4, 7, 5]]
    for name in face_names:
        faces = boundary_faces(mesh)
        faces = faces[np.isin(faces, mesh.node_sets[name]).all(axis=1)]
        corners = mesh.nodes[faces]
        area = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        X = np.einsum('qa,fai->fqi', points, corners)
        shares = np.einsum('q,qa,fqij,fj->fai', weights, N, traction(X), area)
        np.add.at(load, faces if mesh.midside is None
                  else np.hstack([faces, face_middles(mesh, faces)]), shares)
    return load


class Bulging:
    """u = A sin(w x) sin(w y) sin(w z / 2): volume changes; zero but on the face z1."""

    amplitude, w = L * np.array([0.05, -0.03, 0.04]), np.pi / L * np.array([1.0, 1.0, 0.5])

    def displacement(self, X):
        return np.prod(np.sin(self.w * X), axis=-1, keepdims=True) * self.amplitude

    def gradient(self, X):
        s, c = np.sin(self.w * X), self.w * np.cos(self.w * X)
        slope = np.stack([c[..., 0] * s[..., 1] * s[..., 2], s[..., 0] * c[..., 1] * s[..., 2],
                          s[..., 0] * s[..., 1] * c[..., 2]], axis=-1)
        return self.amplitude[:, None] * slope[..., None, :]


class Sliding:
    """u1 = a sin(w y) cos(w z), u2 = b sin(w z): J = 1, so kappa has no share in the stress.

    The same fields and loads belong to it for every nu: what the error gains as nu approaches
    0.5 is locking and nothing else.
    """

    a, b, w = 0.06 * L, 0.06 * L, np.pi / L

    def displacement(self, X):
        y, z = self.w * X[..., 1], self.w * X[..., 2]
        return np.stack([self.a * np.sin(y) * np.cos(z), self.b * np.sin(z), 0.0 * z], axis=-1)

    def gradient(self, X):
        y, z = self.w * X[..., 1], self.w * X[..., 2]
        H = np.zeros((*X.shape, 3))
        H[..., 0, 1] = self.w * self.a * np.cos(y) * np.cos(z)
        H[..., 0, 2] = -self.w * self.a * np.sin(y) * np.sin(z)
        H[..., 1, 2] = self.w * self.b * np.cos(z)
        return H


def exact_stress(solution, X, nu):
    return material.stress(np.eye(3) + solution.gradient(X), *material.moduli(E, nu))


def body_force(solution, X, nu):
    """-Div P by central differences of the closed form, step 1e-5 L: off by some 1e-9 of it."""
    h, out = 1e-5 * L, np.zeros_like(X)
    for k, step in enumerate(h * np.eye(3)):
        ahead, back = (exact_stress(solution, X + s * step, nu) for s in (1.0, -1.0))
        out -= (ahead - back)[..., k] / (2 * h)
    return out


def errors(solution, element, cells, nu):
    """Relative L2 errors of displacement and of its gradient; z1 carries tractions, rest held."""
    mesh = box(element, cells)
    load = nodal_loads(mesh, lambda X: body_force(solution, X, nu),
                       lambda X: exact_stress(solution, X, nu), ['z1'])
    body = make_body(mesh, surface(mesh, ('x0', 'x1', 'y0', 'y1', 'z0')), nu, nodal_force=load)
    found = StaticSolver(body).solve_held(
        mesh.nodes, mesh.nodes + solution.displacement(mesh.nodes))
    assert found.outcome.ok
    u = (found.x - mesh.nodes)[mesh.connectivity]
    points, weights = VOLUME_RULE
    X = np.einsum('qa,mai->mqi', points, mesh.nodes[mesh.tets])
    slopes = np.einsum('qak,mkj->mqaj', shape_slopes(points, u.shape[1]),
                       np.linalg.inv(edge_matrices(mesh.nodes, mesh.tets)))
    exact, tilt = solution.displacement(X), solution.gradient(X)
    off = np.einsum('qa,mai->mqi', shape_values(points, u.shape[1]), u) - exact
    turn = np.einsum('mai,mqaj->mqij', u, slopes) - tilt

    def norm(field):
        squared = np.sum(field ** 2, axis=tuple(range(2, field.ndim)))
        return np.sqrt(np.einsum('m,q,mq->', volumes(mesh), weights, squared))

    return norm(off) / norm(exact), norm(turn) / norm(tilt)


@pytest.mark.parametrize(('element', 'cells', 'order'),
                         [('linear', (6, 12), 1), ('quadratic', (4, 8), 2)])
def test_finite_strain_converges_at_the_order_of_the_element(element, cells, order):
    """Order p in the gradient and p + 1 in u (Ciarlet 1978, The FEM for Elliptic Problems, 3.2).

    From two perturbed meshes that are not nested a rate comes out within 0.15 (gradient) and 0.3
    (u) of its limit; a wrong order would be off by 1.
    """
    coarse, fine = (np.array(errors(Bulging(), element, c, 0.3)) for c in cells)
    rate_u, rate_gradient = np.log2(coarse / fine)
    assert rate_gradient == pytest.approx(order, abs=0.15)
    assert rate_u == pytest.approx(order + 1, abs=0.3)
    assert fine[0] < {'linear': 0.04, 'quadratic': 0.002}[element]


@pytest.mark.parametrize(('nu', 'order'), [(0.49, 2.0), (0.499, 2.0), (0.4999, 1.0)])
def test_quadratic_converges_near_incompressibility(nu, order):
    """Full order where the pressure is constant, which one constraint an element holds exactly.

    For any nu at least one order less is asked.
    """
    coarse, fine = (np.array(errors(Sliding(), 'quadratic', c, nu)) for c in (4, 8))
    rate_u, rate_gradient = np.log2(coarse / fine)
    assert rate_gradient > order - 0.2
    assert rate_u > order + 1.0 - 0.3


def test_quadratic_errors_do_not_depend_on_nu_up_to_the_default():
    """Same solution, same mesh: what nu = 0.49 adds is below a tenth, at 0.499 below a half.

    Linear elements on as many nodes, half as wide, are off by seven times as much at nu = 0.3,
    and by two thirds more at 0.499.
    """
    loose, default, tight = (errors(Sliding(), 'quadratic', 6, nu)[0] for nu in (0.3, 0.49, 0.499))
    assert default < 1.1 * loose
    assert tight < 1.5 * loose


# ---- polynomials of degree 2, small strain: the tangent at rest

def centred(mesh, size):
    return mesh.nodes - np.array(size) / 2.0


SIZE = (0.06, 0.02, 0.02)


def bending(mesh, nu, curvature=1.0):
    """Saint-Venant's pure bending about y: sigma_xx = E c z and nothing else; u is quadratic."""
    x, y, z = centred(mesh, SIZE).T
    return curvature * np.stack([x * z, -nu * y * z, -0.5 * (x * x + nu * (z * z - y * y))],
                                axis=-1)


def rest_tangent(mesh, nu):
    return Assembler(make_body(mesh, surface(mesh), nu)).tangent(mesh.nodes)


@pytest.mark.parametrize('nu', [0.0, 0.3])
def test_pure_bending_is_exact_in_quadratic_elements(nu):
    """No force but on the end faces, and there the moment E I c, on any mesh.

    Rounding: 1e-16 of the forces that cancel in an element, of order kappa c h^3.
    """
    mesh = box('quadratic', (6, 3, 3), SIZE)
    u = bending(mesh, nu)
    force = (rest_tangent(mesh, nu) @ u.ravel()).reshape(-1, 3)
    kappa = material.moduli(E, nu)[1]
    ends = surface(mesh, ('x0', 'x1'))
    inner = np.setdiff1d(np.arange(len(u)), ends)
    np.testing.assert_allclose(force[inner], 0.0, atol=1e-13 * kappa * SIZE[1] ** 3)
    end = mesh.node_sets['x1']
    moment = np.cross(centred(mesh, SIZE)[end], force[end]).sum(axis=0)
    inertia = SIZE[1] * SIZE[2] ** 3 / 12.0
    np.testing.assert_allclose(moment, [0.0, E * inertia, 0.0],
                               atol=1e-12 * kappa * SIZE[1] ** 4)


def bending_excess(element, cells, nu):
    """Energy of the bar with its ends held in pure bending over the exact one, minus 1."""
    mesh = box(element, cells, SIZE)
    ends = surface(mesh, ('x0', 'x1'))
    body = make_body(mesh, ends, nu)
    solver = StaticSolver(body)
    K = solver.assembler.tangent(mesh.nodes)
    u, dofs = bending(mesh, nu).ravel(), FreeDofs(solver.assembler, ends).dofs
    _, factor = solver.linearise(mesh.nodes)
    u[dofs] = 0.0
    u[dofs] = -factor.solve((K @ u)[dofs])
    exact = E * SIZE[1] * SIZE[2] ** 3 / 12.0 * SIZE[0]
    return (u @ (K @ u)) / exact - 1.0


def test_one_volume_constraint_bends_too_easily_by_second_order_whatever_nu():
    """The price of not locking: pressure varies across a bent bar, and is constant in an element.

    Its error is of first order, the energy's of second (Boffi, Brezzi & Fortin 2013, 8.5): a
    quarter for half the cell. Two cells across leave about 1 %, at nu = 0.4999 as at 0.49.
    """
    loose, tight = ([bending_excess('quadratic', (3 * n, n, n), nu) for n in (2, 4)]
                    for nu in (0.49, 0.4999))
    for excess in (loose, tight):
        assert np.log2(excess[0] / excess[1]) == pytest.approx(2.0, abs=0.1)
        assert -0.015 < excess[0] < 0.0
    assert tight[1] == pytest.approx(loose[1], rel=0.05)


def test_linear_elements_are_too_stiff_in_bending_and_lock():
    """The known defect, its sign and its order.

    Ritz: held displacements and too few shapes give too much energy, by O(h^2). The factor in
    front grows with kappa / mu, which is 2 at nu = 0.3 and 500 at 0.499: with six cells across the
    bar is 1.1 times too stiff there and 12 times here.
    """
    loose = [bending_excess('linear', (3 * n, n, n), 0.3) for n in (3, 6)]
    tight = [bending_excess('linear', (3 * n, n, n), 0.499) for n in (3, 6)]
    assert np.log2(loose[0] / loose[1]) == pytest.approx(2.0, abs=0.2)
    assert np.log2(tight[0] / tight[1]) == pytest.approx(2.0, abs=0.2)
    assert 0.0 < loose[1] < 0.2
    assert tight[1] > 50.0 * loose[1]


@pytest.mark.parametrize('nu', [0.0, 0.3])
def test_any_quadratic_displacement_is_exact_under_its_body_force(nu):
    """Small strain: stress is linear, -div of it a constant. 27 coefficients at random.

    At finite strain the stress of such a field is no polynomial and no quadrature is exact.
    """
    rng, (mu, kappa) = np.random.default_rng(4), material.moduli(E, nu)
    Q = rng.normal(size=(3, 3, 3)) / L
    Q = Q + Q.transpose(0, 2, 1)
    mesh = box('quadratic', 3)
    u = 0.5 * np.einsum('ijk,nj,nk->ni', Q, mesh.nodes, mesh.nodes) + mesh.nodes @ rng.normal(
        size=(3, 3)).T
    # (lambda + mu) grad div u + mu laplace u, lambda = kappa - 2/3 mu
    push = (kappa + mu / 3.0) * np.einsum('jjk->k', Q) + mu * np.einsum('ijj->i', Q)
    load = nodal_loads(mesh, lambda X: np.broadcast_to(-push, X.shape), None, [])
    residual = (rest_tangent(mesh, nu) @ u.ravel()).reshape(-1, 3) - load
    inner = np.setdiff1d(np.arange(len(u)), surface(mesh))
    assert np.abs(load[inner]).max() > 1e-4 * kappa * L  # the load is not lost in the bound below
    np.testing.assert_allclose(residual[inner], 0.0, atol=1e-13 * kappa * L)
