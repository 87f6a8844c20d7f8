"""Stiffening, fibres and swelling in whole bodies: derivatives, rotation, scaling, refusals."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import ConfigError, InputError
from arm_brachy.tissue import material
from arm_brachy.tissue.admm import AdmmSolver
from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Fibres, Pad, SoftBody, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.dynamics import DynamicSolver
from arm_brachy.tissue.element import point_moduli
from arm_brachy.tissue.hyper_reduction import Galerkin
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import quadratic_mesh
from arm_brachy.tissue.newton import StaticSolver
from arm_brachy.tissue.reduced_basis import PushDomain, Snapshots, body_hash

SIZE = (0.03, 0.02, 0.02)
MU, KAPPA = moduli(6e3, 0.49)


def make_body(element='quadratic', cells=(2, 1, 1), nu=0.49, *, beyond=True, **extra):
    """Irregular box glued below, its lid a pad; moduli and fibres differ between elements."""
    rng = np.random.default_rng(0)
    mesh = box_mesh(SIZE, cells, perturbation=0.2, rng=rng)
    mesh = quadratic_mesh(mesh) if element == 'quadratic' else mesh
    m, scale = len(mesh.tets), rng.uniform(0.5, 2.0, len(mesh.tets))
    mu, kappa = (scale * modulus for modulus in moduli(6e3, nu))
    direction = rng.normal(size=(m, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    law = {'stiffening': rng.uniform(0.0, 3.0, m) * mu,
           'fibres': Fibres(rng.uniform(0.0, 1.0, m) * mu, direction)} if beyond else {}
    lid = Pad('lid', mesh.node_sets['z1'], np.array([0, 0, -1.0]), np.array(SIZE) * [.5, .5, 1], 1)
    return SoftBody(mesh, mu, kappa, np.full(m, 1e3), mesh.node_sets['z0'], (lid,), **law, **extra)


@pytest.fixture(params=['linear', 'quadratic'])
def body(request):
    return make_body(request.param)


def strained(body, size=1e-3):
    """Positions some ten per cent of strain away from rest."""
    rng = np.random.default_rng(1)
    return body.mesh.nodes + rng.uniform(-size, size, body.mesh.nodes.shape)


def fields_of(body, swelling=1.03):
    """Fields with everything in them."""
    fields = StepFields.of(body)
    S = np.random.default_rng(2).normal(size=fields.stress.shape)
    fields.stress += 300.0 * (S + np.swapaxes(S, -1, -2))
    fields.swelling = swelling
    return fields


def differences(function, x, step=1e-6):
    out = []
    for i in range(x.size):
        d = np.zeros(x.size)
        d[i] = step
        out.append((function(x + d.reshape(x.shape)) - function(x - d.reshape(x.shape)))
                   / (2.0 * step))
    return np.array(out)


# ---- energy, forces, tangent


def test_energy_is_the_sum_of_the_law_over_the_points(body):
    """Each point with the moduli it carries: those of shear and beyond where shear is."""
    x, g = strained(body), body.geometry
    F = np.einsum('mai,mqak->mqik', x[g.connectivity], g.gradients)
    mu, kappa = point_moduli(g, body)
    beyond = np.repeat(body.beyond[:, None], len(g.shear), axis=1)
    beyond[..., :2] *= g.shear[:, None]
    expected = np.sum(g.point_weights * material.energy(F, mu, kappa, beyond))
    assert Assembler(body).energy(x) == pytest.approx(expected, rel=1e-12)
    without = np.sum(g.point_weights * material.energy(F, mu, kappa))
    assert expected > 1.01 * without  # what goes beyond counts


def test_forces_are_the_gradient_and_tangent_the_derivative(body):
    """Central differences, step 1 um of 10 mm elements: truncation 1e-8, rounding less."""
    x, fields, assembler = strained(body), fields_of(body), Assembler(body)
    forces, K = assembler.forces(x, fields), assembler.tangent(x, fields).toarray()
    numeric = differences(lambda y: assembler.energy(y, fields), x).reshape(-1, 3)
    np.testing.assert_allclose(numeric, forces, atol=1e-7 * np.abs(forces).max())
    numeric = differences(lambda y: assembler.forces(y, fields).ravel(), x)
    np.testing.assert_allclose(numeric, K, atol=1e-7 * np.abs(K).max())
    np.testing.assert_allclose(K, K.T, atol=1e-13 * np.abs(K).max())


def test_rotation_turns_the_forces_and_leaves_the_energy(body):
    Q = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    x, fields, assembler = strained(body), fields_of(body), Assembler(body)
    forces = assembler.forces(x, fields)
    np.testing.assert_allclose(assembler.forces(x @ Q.T, fields), forces @ Q.T,
                               atol=1e-11 * np.abs(forces).max())
    assert assembler.energy(x @ Q.T, fields) == pytest.approx(assembler.energy(x, fields),
                                                              rel=1e-11)


def test_a_rotated_body_needs_its_fibres_rotated_too(body):
    """Rest shape, fibres and state turned together: the forces turn. Fibres left behind: not."""
    Q = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    turned = dataclasses.replace(body, mesh=dataclasses.replace(body.mesh,
                                                                nodes=body.mesh.nodes @ Q.T))
    x, forces = strained(body), Assembler(body).forces(strained(body))
    with_fibres = dataclasses.replace(turned, fibres=dataclasses.replace(
        body.fibres, direction=body.fibres.direction @ Q.T))
    np.testing.assert_allclose(Assembler(with_fibres).forces(x @ Q.T), forces @ Q.T,
                               atol=1e-11 * np.abs(forces).max())
    left = Assembler(turned).forces(x @ Q.T)
    assert np.abs(left - forces @ Q.T).max() > 1e-2 * np.abs(forces).max()


# ---- scale


def test_all_moduli_times_two_double_the_forces_and_leave_the_positions(body):
    """To rounding: 1e-14 m, and that times a stiffness of some 1e3 N/m."""
    push = [[1e-3, 0.0, -1.5e-3]]
    one, two = (StaticSolver(b).solve(b.mesh.nodes, push)
                for b in (body, body.with_stiffness(2.0)))
    assert one.outcome.ok and two.outcome.ok
    np.testing.assert_allclose(two.x, one.x, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(two.pad_force, 2.0 * one.pad_force, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize('name', ['mu', 'kappa', 'stiffening', 'fibres'])
def test_each_of_them_alone_moves_the_tissue(name):
    """The test above can fail: what is left out of the scaling shows in the positions."""
    body, push = make_body(), [[1e-3, 0.0, -1.5e-3]]
    scaled = getattr(body.with_stiffness(2.0), name)
    one, other = (StaticSolver(b).solve(b.mesh.nodes, push)
                  for b in (body, dataclasses.replace(body, **{name: scaled})))
    assert np.abs(other.x - one.x).max() > 1e-6


def test_stiffness_may_differ_between_elements(body):
    scale = np.linspace(0.5, 2.0, len(body.mu))
    scaled = body.with_stiffness(scale)
    for name in ('mu', 'kappa', 'stiffening'):
        np.testing.assert_array_equal(getattr(scaled, name), scale * getattr(body, name))
    np.testing.assert_array_equal(scaled.fibres.modulus, scale * body.fibres.modulus)
    np.testing.assert_array_equal(scaled.fibres.direction, body.fibres.direction)
    plain = make_body(beyond=False).with_stiffness(3.0)
    assert plain.stiffening is None and plain.fibres is None


# ---- swelling


def test_a_swollen_body_is_one_with_a_larger_mesh(body):
    """Same forces and tangent as the body whose rest shape is that; with the same stress."""
    x, fields = 1.03 * strained(body), fields_of(body)
    larger, same = Assembler(body.swollen(1.03)), dataclasses.replace(fields, swelling=1.0)
    swelling = Assembler(body)
    forces, K = larger.forces(x, same), larger.tangent(x, same).toarray()
    np.testing.assert_allclose(swelling.forces(x, fields), forces,
                               atol=1e-12 * np.abs(forces).max())
    np.testing.assert_allclose(swelling.tangent(x, fields).toarray(), K,
                               atol=1e-12 * np.abs(K).max())
    assert body.swollen(1.0) is body


def test_viscous_stress_of_a_swollen_body_is_that_of_the_larger_mesh(body):
    body = dataclasses.replace(body, damping=(0.0, 0.02))
    x, v = 1.03 * strained(body), 0.1 * np.random.default_rng(4).normal(size=body.mesh.nodes.shape)
    fields = fields_of(body)
    states = [DynamicSolver(body).initial(x, v, fields=fields),
              DynamicSolver(body.swollen(1.03)).initial(
                  x, v, fields=dataclasses.replace(fields, swelling=1.0))]
    elastic = Assembler(body).forces(x, fields)
    assert np.abs(states[0].static - elastic).max() > 0.1 * np.abs(elastic).max()
    np.testing.assert_allclose(states[0].static, states[1].static,
                               atol=1e-11 * np.abs(elastic).max())


# ---- solvers that know the Neo-Hookean law only


def test_admm_refuses_what_it_does_not_know():
    with pytest.raises(ConfigError, match='admm: the body has stiffening tissue or fibres; must'):
        AdmmSolver(make_body('linear'))
    plain = make_body('linear', beyond=False)
    for name, value in (('swelling', 1.01), ('beyond', np.ones_like(plain.beyond))):
        fields = dataclasses.replace(StepFields.of(plain), **{name: value})
        with pytest.raises(InputError, match='admm: fields with swelling'):
            AdmmSolver(plain).solve(plain.mesh.nodes, np.zeros((1, 3)), fields)


def test_the_reduced_model_refuses_what_it_does_not_know():
    body, plain = make_body(), make_body(beyond=False)
    nothing = np.zeros((1, 1, 3))
    data = Snapshots(PushDomain.of(plain, 1e-3), nothing, plain.mesh.nodes[None], nothing,
                     plain.mesh.nodes)
    with pytest.raises(ConfigError, match='reduced model: the body has stiffening tissue or'):
        Galerkin(body, data, 0, True)
    assert body_hash(body) != body_hash(plain)  # so a model of the plain one does not serve it
