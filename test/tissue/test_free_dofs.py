"""Elimination of held nodes."""

import numpy as np

from arm_brachy.tissue.assembly import Assembler
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.free_dofs import FreeDofs, held_nodes


def make_body():
    mesh = box_mesh((0.03, 0.02, 0.02), (3, 2, 2), perturbation=0.2, rng=np.random.default_rng(0))
    m = len(mesh.tets)
    pad = Pad('top', mesh.node_sets['z1'][:4], np.array([0, 0, -1.0]), np.zeros(3), 0.01)
    return SoftBody(mesh, np.full(m, 2e3), np.full(m, 2e4), np.full(m, 1e3),
                    mesh.node_sets['z0'], (pad,))


def test_reduced_matrix_is_the_free_part():
    body = make_body()
    assembler = Assembler(body)
    x = body.mesh.nodes + np.random.default_rng(1).uniform(-1e-3, 1e-3, body.mesh.nodes.shape)
    K = assembler.tangent(x)
    free = FreeDofs(assembler, held_nodes(body))
    dense = K.toarray()[np.ix_(free.dofs, free.dofs)]
    rows = np.repeat(np.arange(len(free.dofs)), np.diff(free.indptr))
    upper = np.zeros_like(dense)
    upper[rows, free.indices] = free.upper(K)
    assert np.array_equal(upper, np.triu(dense))
    assert np.array_equal(free.upper(K)[free.diagonal], np.diag(dense))


def test_solver_solves_the_free_part():
    body = make_body()
    assembler = Assembler(body)
    free, K = FreeDofs(assembler, held_nodes(body)), assembler.tangent(body.mesh.nodes)
    solver = free.solver()
    solver.factor(free.upper(K))
    b = np.random.default_rng(2).normal(size=len(free.dofs))
    dense = K.toarray()[np.ix_(free.dofs, free.dofs)]
    np.testing.assert_allclose(solver.solve(b), np.linalg.solve(dense, b), rtol=1e-8)


def test_held_and_free_nodes_part_the_mesh():
    body = make_body()
    free = FreeDofs(Assembler(body), held_nodes(body))
    assert np.array_equal(np.sort(np.concatenate([free.free, free.held])),
                          np.arange(len(body.mesh.nodes)))
    assert set(body.fixed) | set(body.pads[0].nodes) == set(free.held)
