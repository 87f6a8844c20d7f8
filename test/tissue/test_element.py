"""Tetrahedra: what they must hold exactly, integrals they owe, modes they may not have."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from scipy.linalg import eigvalsh
from skfem.models.elasticity import linear_elasticity

from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import SoftBody, StepFields, TetMesh
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import (
    EDGES,
    FACES,
    SPREAD,
    element_geometry,
    point_moduli,
    shape_slopes,
    shape_values,
    signed_volumes,
)
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh

SIZE = (0.03, 0.02, 0.01)
ORDER = {'linear': 1, 'quadratic': 2}
NODES = {'linear': 4, 'quadratic': 10}


@pytest.fixture(params=list(ORDER))
def element(request):
    return request.param


def box(element, cells=(3, 2, 2)):
    mesh = box_mesh(SIZE, cells, perturbation=0.2, rng=np.random.default_rng(0))
    return quadratic_mesh(mesh) if element == 'quadratic' else mesh


def barycentric(count=20, seed=1):
    return np.random.default_rng(seed).dirichlet(np.ones(4), count)


def node_coordinates(element):
    """Barycentric coordinates of an element's nodes (a, 4)."""
    corners = np.eye(4)
    return corners if element == 'linear' else np.vstack([corners, corners[EDGES].mean(axis=1)])


def monomials(X, degree):
    """All x^i y^j z^k with i + j + k <= degree (..., c), X (..., 3) of order 1."""
    powers = [p for p in itertools.product(range(degree + 1), repeat=3) if sum(p) <= degree]
    return np.stack([np.prod(X ** np.array(p), axis=-1) for p in powers], axis=-1)


def slopes(X, degree, h=1e-6):
    """Central differences of `monomials` (..., c, 3): exact to degree 2 but for rounding / h."""
    return np.stack([(monomials(X + d, degree) - monomials(X - d, degree)) / (2.0 * h)
                     for d in h * np.eye(3)], axis=-1)


def simplex_mean(powers):
    """Mean of L0^a L1^b L2^c L3^d over a tetrahedron: 3! a! b! c! d! / (a + b + c + d + 3)!."""
    return (6.0 * math.prod(math.factorial(p) for p in powers)
            / math.factorial(sum(powers) + 3))


def geometry_of(mesh, nu=0.3):
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, nu)
    return element_geometry(mesh, np.full(m, mu), np.full(m, kappa))


def test_a_uniform_volume_change_meets_the_whole_bulk_modulus(element):
    """However kappa is shared out, a point weight's worth of it each adds up to kappa V."""
    mesh, (mu, kappa) = box(element), moduli(6e3, 0.49)
    m = len(mesh.tets)
    geometry = geometry_of(mesh, 0.49)
    fields = SimpleNamespace(mu=np.full(m, mu), kappa=np.full(m, kappa))
    shear, bulk = point_moduli(geometry, fields)
    volume = signed_volumes(mesh.nodes, mesh.tets)
    np.testing.assert_allclose((geometry.point_weights * bulk).sum(axis=1), kappa * volume)
    np.testing.assert_allclose((geometry.point_weights * shear).sum(axis=1), mu * volume)


def test_quadratic_elements_are_integrated_in_full_up_to_the_spread():
    """Up to nu = 0.3 nothing is left for the centre; beyond, only what exceeds SPREAD mu."""
    mesh = box('quadratic')
    assert geometry_of(mesh, 0.25).spread.min() == 1.0
    assert geometry_of(mesh, 0.3).spread.min() == pytest.approx(1.0, rel=1e-12)
    mu, kappa = moduli(6e3, 0.49)
    np.testing.assert_allclose(geometry_of(mesh, 0.49).spread * kappa, SPREAD * mu)


def test_plain_elements_are_those_of_another_code():
    """Stiffness of a block, nu = 0.49, against scikit-fem's quadratic tetrahedra, quadrature of
    degree 2; ours, which do without most of that at nearly all points, are softer.
    """
    mesh, nu = box('quadratic'), 0.49
    mu, kappa = moduli(6e3, nu)
    theirs = skfem.MeshTet(mesh.nodes[:int(mesh.tets.max()) + 1].T, mesh.tets.T)
    basis = skfem.Basis(theirs, skfem.ElementVector(skfem.ElementTetP2()), intorder=2)
    K = linear_elasticity(kappa - 2.0 / 3.0 * mu, mu).assemble(basis)
    u = np.random.default_rng(5).normal(size=mesh.nodes.shape)
    seen = basis.doflocs.T[::3]     # where their nodes lie, three numbers each
    there = np.linalg.norm(seen[:, None] - mesh.nodes, axis=2).argmin(axis=1)
    expected = 0.5 * u[there].ravel() @ K @ u[there].ravel()
    m = len(mesh.tets)
    energies = []
    for in_full in (True, False):
        body = SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                        np.zeros(0, dtype=np.int64), in_full=in_full)
        tangent = Assembler(body).tangent(mesh.nodes, StepFields.of(body))
        energies.append(0.5 * u.ravel() @ tangent @ u.ravel())
    assert energies[0] == pytest.approx(expected, rel=1e-9)
    assert energies[1] < 0.9 * expected


def test_shape_functions_are_one_at_their_own_node_and_sum_to_one(element):
    a = NODES[element]
    np.testing.assert_allclose(shape_values(node_coordinates(element), a), np.eye(a), atol=1e-15)
    np.testing.assert_allclose(shape_values(barycentric(), a).sum(axis=1), 1.0, rtol=1e-14)


def test_slopes_are_those_of_the_shape_functions(element):
    """Central differences of degree 2 are exact: rounding 1e-16 over the step 1e-4 is left."""
    a, h, L = NODES[element], 1e-4, barycentric()
    for k in range(3):
        step = h * (np.eye(4)[k + 1] - np.eye(4)[0])
        numeric = (shape_values(L + step, a) - shape_values(L - step, a)) / (2.0 * h)
        np.testing.assert_allclose(shape_slopes(L, a)[:, :, k], numeric, atol=1e-11)


def test_fields_up_to_the_elements_order_are_held_exactly(element):
    """Values and gradients of every monomial, on perturbed elements; lengths in cm, so order 1.

    Gradients are compared with differences of step 1e-6: rounding 1e-16 x 9 / 1e-6.
    """
    mesh = box(element)
    geometry = geometry_of(mesh)
    X = 1e2 * mesh.nodes
    nodal = monomials(X, ORDER[element])[geometry.connectivity]
    points = np.einsum('qa,mai->mqi', geometry.shape, X[geometry.connectivity])
    values = np.einsum('qa,mac->mqc', geometry.shape, nodal)
    np.testing.assert_allclose(values, monomials(points, ORDER[element]), atol=1e-14)
    gradient = np.einsum('mac,mqak->mqck', nodal, geometry.gradients) / 1e2
    np.testing.assert_allclose(gradient, slopes(points, ORDER[element]), atol=1e-8)


def test_one_degree_more_is_not_held(element):
    """The test above can fail: the next degree is missed by the square, cube of a cell."""
    mesh = box(element)
    geometry = geometry_of(mesh)
    X, degree = 1e2 * mesh.nodes, ORDER[element] + 1
    points = np.einsum('qa,mai->mqi', geometry.shape, X[geometry.connectivity])
    values = np.einsum('qa,mac->mqc', geometry.shape, monomials(X, degree)[geometry.connectivity])
    assert np.abs(values - monomials(points, degree)).max() > 1e-3


def test_quadrature_is_exact_to_its_degree_and_no_further(element):
    """One point: degree 1. Four points: degree 2. Means over a tetrahedron in closed form."""
    mesh = box(element)
    geometry = geometry_of(mesh)
    np.testing.assert_allclose(geometry.weights.sum(axis=1), signed_volumes(mesh.nodes, mesh.tets))
    np.testing.assert_allclose(geometry.weights.sum(), np.prod(SIZE))
    share = geometry.weights[0] / geometry.weights[0].sum()
    L = geometry.shape @ node_coordinates(element)  # shape functions hold linear fields exactly
    for powers in itertools.product(range(4), repeat=4):
        mean = share @ np.prod(L ** np.array(powers), axis=1)
        if sum(powers) <= ORDER[element]:
            assert mean == pytest.approx(simplex_mean(powers), rel=1e-13)
    cubes = [(ORDER[element] + 1) * row for row in np.eye(4, dtype=int)]
    assert all(abs(share @ np.prod(L ** p, axis=1) - simplex_mean(p)) > 1e-3 for p in cubes)


def polynomials(element):
    """Shape functions as {powers of (L0, L1, L2, L3): coefficient}."""
    one = np.eye(4, dtype=int)
    if element == 'linear':
        return [{tuple(row): 1.0} for row in one]
    return ([{tuple(2 * row): 2.0, tuple(row): -1.0} for row in one]
            + [{tuple(one[i] + one[j]): 4.0} for i, j in EDGES])


def mean_product(p, q):
    return sum(c * d * simplex_mean([a + b for a, b in zip(i, j, strict=True)])
               for i, c in p.items() for j, d in q.items())


def test_mass_is_the_integral_of_products_in_closed_form(element):
    N = polynomials(element)
    exact = [[mean_product(p, q) for q in N] for p in N]
    geometry = geometry_of(box(element))
    np.testing.assert_allclose(geometry.mass, exact, rtol=1e-13, atol=1e-16)
    assert geometry.mass.sum() == pytest.approx(1.0, rel=1e-14)
    assert eigvalsh(geometry.mass)[0] > 0.0


def test_lumping_is_positive_and_loses_no_mass(element):
    """Hinton, Rock & Zienkiewicz: each node its diagonal; row sums of the corners are negative."""
    geometry = geometry_of(box(element))
    assert geometry.lumping.min() > 0.0
    assert geometry.lumping.sum() == pytest.approx(1.0, rel=1e-14)
    np.testing.assert_allclose(geometry.lumping * np.trace(geometry.mass), np.diag(geometry.mass))
    if element == 'quadratic':
        assert geometry.mass.sum(axis=1)[:4].max() < 0.0


def stiffness(mesh, nu=0.3):
    """Dense tangent at rest over mu and edge length, no supports."""
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, nu)
    body = SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3), np.zeros(0, int))
    return Assembler(body).tangent(mesh.nodes).toarray() / (mu * 0.01)


def single(element):
    """One irregular tetrahedron."""
    corners = 0.01 * np.array([[0, 0, 0], [1.1, 0.1, 0], [0.2, 0.9, -0.1], [0.3, 0.4, 1.0]])
    mesh = TetMesh(corners, np.array([[0, 1, 2, 3]]))
    return quadratic_mesh(mesh) if element == 'quadratic' else mesh


@pytest.mark.parametrize('patch', ['single', 'cell', 'perturbed'])
@pytest.mark.parametrize('nu', [0.3, 0.49])
def test_rest_has_six_rigid_modes_and_no_others(element, patch, nu):
    """Four points x six strains are the 24 modes that 10 nodes have besides the rigid ones.

    Zero is rounding: 1e-16 of the largest eigenvalue, times some hundred operations. The softest
    mode of a cell that stores energy is of order 1 (mu x edge), in a perturbed patch of n cells
    across of order 1/n^2.
    """
    mesh = {'single': single(element), 'cell': box(element, (1, 1, 1)),
            'perturbed': box(element, (2, 2, 2))}[patch]
    K = stiffness(mesh, nu)
    values = eigvalsh(K)
    assert np.abs(values[:6]).max() < 1e-13 * values[-1]
    assert values[6] > 1e-2
    rigid = np.concatenate([np.tile(np.eye(3), (len(mesh.nodes), 1)).T,
                            [np.cross(axis, mesh.nodes).ravel() for axis in np.eye(3) / 0.01]])
    np.testing.assert_allclose(rigid @ K, 0.0, atol=1e-13 * values[-1])


def test_faces_and_edges_name_each_pair_and_triple_once():
    assert {tuple(e) for e in EDGES} == set(itertools.combinations(range(4), 2))
    assert {tuple(sorted(f)) for f in FACES} == set(itertools.combinations(range(4), 3))
    corners = np.vstack([np.zeros(3), np.eye(3)])  # a positive element
    for face in FACES:
        a, b, c = corners[face]
        assert np.cross(b - a, c - a) @ (a - corners.mean(axis=0)) > 0.0


def test_swapping_two_nodes_turns_the_volume_negative():
    mesh = box_mesh((0.01, 0.01, 0.01), (1, 1, 1))
    np.testing.assert_allclose(signed_volumes(mesh.nodes, mesh.tets[:, [0, 2, 1, 3]]),
                               -signed_volumes(mesh.nodes, mesh.tets))
