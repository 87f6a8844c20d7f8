"""Whole-body energy, forces and tangent, whatever the number of threads."""

import dataclasses

import numba
import numpy as np
import pytest

from arm_brachy.tissue import material
from arm_brachy.tissue.assembly import Assembler, InvertedElement
from arm_brachy.tissue.body import SoftBody, Springs, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import edge_matrices
from arm_brachy.tissue.mesh import volumes


@pytest.fixture
def body():
    rng = np.random.default_rng(0)
    mesh = box_mesh((0.03, 0.02, 0.02), (3, 2, 2), perturbation=0.2, rng=rng)
    m, n = len(mesh.tets), len(mesh.nodes)
    k = rng.normal(size=(5, 3, 3))
    return SoftBody(mesh, rng.uniform(1e3, 3e3, m), rng.uniform(1e4, 3e4, m),
                    rng.uniform(900, 1100, m), mesh.node_sets['z0'],
                    springs=Springs(np.arange(5), 10.0 * k @ k.transpose(0, 2, 1)),
                    gravity=np.array([1.0, 2.0, -9.0]), nodal_force=rng.normal(size=(n, 3)),
                    nodal_mass=rng.uniform(0, 0.01, n))


@pytest.fixture
def state(body):
    """Deformed positions and fields with added stress."""
    rng = np.random.default_rng(1)
    fields = StepFields.of(body)
    S = rng.normal(size=fields.stress.shape)
    fields.stress += 500.0 * (S + np.swapaxes(S, -1, -2))
    return body.mesh.nodes + rng.uniform(-1e-3, 1e-3, body.mesh.nodes.shape), fields


def differences(function, x, step=1e-6):
    out = []
    for i in range(x.size):
        d = np.zeros(x.size)
        d[i] = step
        d = d.reshape(x.shape)
        out.append((function(x + d) - function(x - d)) / (2 * step))
    return np.array(out)


def test_energy_equals_a_plain_sum(body, state):
    x, fields = state
    mesh = body.mesh
    F = edge_matrices(x, mesh.tets) @ np.linalg.inv(edge_matrices(mesh.nodes, mesh.tets))
    green = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(3))
    density = (material.energy(F, body.mu, body.kappa)
               + np.sum(fields.stress[:, 0] * green, axis=(1, 2)))
    u = x - mesh.nodes
    mass = np.bincount(mesh.tets.ravel(), np.repeat(body.density * volumes(mesh) / 4, 4))
    mass += body.nodal_mass
    held = np.einsum('si,sij,sj->', u[:5], body.springs.stiffness, u[:5])
    expected = (density @ volumes(mesh) + 0.5 * held - np.sum(body.nodal_force * u)
                - np.sum(mass[:, None] * body.gravity * u))
    assembler = Assembler(body)
    np.testing.assert_allclose(assembler.lumped_mass(), mass)
    np.testing.assert_allclose(assembler.energy(x, fields), expected, rtol=1e-12)


def test_forces_and_tangent_match_central_differences(body, state):
    x, fields = state
    assembler = Assembler(body)
    forces, K = assembler.forces(x, fields), assembler.tangent(x, fields).toarray()
    numeric = differences(lambda y: assembler.energy(y, fields), x).reshape(-1, 3)
    np.testing.assert_allclose(numeric, forces, atol=1e-7 * np.abs(forces).max())
    numeric = differences(lambda y: assembler.forces(y, fields).ravel(), x)
    np.testing.assert_allclose(numeric, K, atol=1e-7 * np.abs(K).max())
    np.testing.assert_allclose(K, K.T, atol=1e-14 * np.abs(K).max())


def test_default_fields_are_the_bodys_own(body):
    assembler = Assembler(body)
    x = 1.01 * body.mesh.nodes
    assert np.array_equal(assembler.forces(x), assembler.forces(x, StepFields.of(body)))


def test_same_bits_for_any_number_of_threads(body, state):
    x, fields = state
    assembler = Assembler(body)
    available = numba.get_num_threads()
    results = []
    for threads in {1, available}:
        numba.set_num_threads(threads)
        results.append((assembler.evaluate(x, fields), assembler.tangent(x, fields).data.copy()))
    numba.set_num_threads(available)
    for state_, tangent in results:
        assert state_.energy == results[0][0].energy
        assert np.array_equal(state_.forces, results[0][0].forces)
        assert np.array_equal(tangent, results[0][1])


def test_results_share_no_memory(body, state):
    x, fields = state
    assembler = Assembler(body)
    first, K = assembler.forces(x, fields), assembler.tangent(x, fields)
    kept = first.copy(), K.data.copy()
    assembler.forces(body.mesh.nodes, fields)
    assembler.tangent(body.mesh.nodes, fields)
    assert np.array_equal(first, kept[0])
    assert np.array_equal(K.data, kept[1])


def test_inverted_element_is_reported(body):
    assembler = Assembler(body)
    x = body.mesh.nodes * [1.0, 1.0, -1.0]
    state = assembler.evaluate(x)
    assert state.energy == np.inf
    assert state.min_J < 0.0
    with pytest.raises(InvertedElement, match='det F'):
        assembler.forces(x)


def test_without_springs_and_loads_rest_is_balanced(body):
    bare = dataclasses.replace(body, gravity=np.zeros(3), nodal_force=None, nodal_mass=None)
    np.testing.assert_allclose(Assembler(bare).forces(body.mesh.nodes), 0.0, atol=1e-12)
