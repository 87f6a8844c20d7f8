"""The Jacobian (3.23) against central differences and the printed force form (3.22)."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import eye_array

from arm_brachy.core.errors import NotConverged
from arm_brachy.tissue.body import Pad, SoftBody, Springs, StepFields
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.jacobian import (
    Equations,
    Linearisation,
    directed_jacobian,
    pad_stiffness,
    pad_translations,
    target_jacobian,
)
from arm_brachy.tissue.linear_solver import FactorisationFailed
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import embed, interpolate, quadratic_mesh
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver

STEP = 1e-5
PUSH = np.array([[0.0, 0.0005, -0.003], [0.002, 0.0, 0.0]])


@pytest.fixture(scope='module')
def setting():
    """Solver tight enough for differences, a deformed equilibrium, two targets inside."""
    mesh = box_mesh((0.04, 0.04, 0.03), (3, 3, 3), perturbation=0.15,
                    rng=np.random.default_rng(0))
    x, y, z = mesh.nodes.T
    top = np.flatnonzero(np.isclose(z, 0.03) & (np.hypot(x - 0.02, y - 0.02) < 0.012))
    side = np.flatnonzero(np.isclose(x, 0.0) & (np.abs(z - 0.015) < 0.006) & (y > 0.01)
                          & (y < 0.03))
    side_direction = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    pads = (Pad('top', top, np.array([0, 0, -1.0]), np.array([0.02, 0.02, 0.03]), 0.02),
            Pad('side', side, side_direction, np.array([0.0, 0.02, 0.015]), 0.02))
    mu, kappa = moduli(6000.0, 0.45)
    m = len(mesh.tets)
    body = SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                    mesh.node_sets['z0'], pads)
    solver = StaticSolver(body, options=NewtonOptions(tolerance=1e-13))
    solution = solver.solve(mesh.nodes, PUSH)
    assert solution.outcome.ok
    targets = embed(mesh, [[0.02, 0.02, 0.015], [0.012, 0.025, 0.02]])
    return solver, solution.x, targets


def central(solver, x, quantity):
    """Central differences of quantity(solution) in each pad translation: (..., p, 3)."""
    columns = []
    for pad in range(2):
        for axis in range(3):
            d = np.zeros((2, 3))
            d[pad, axis] = STEP
            ahead, back = solver.solve(x, PUSH + d), solver.solve(x, PUSH - d)
            columns.append((quantity(ahead) - quantity(back)) / (2 * STEP))
    return np.stack(columns, axis=-1).reshape(*columns[0].shape, 2, 3)


def test_target_jacobian_matches_central_differences(setting):
    solver, x, targets = setting
    J = target_jacobian(solver, x, targets)
    numeric = central(solver, x, lambda s: interpolate(targets, s.x))
    np.testing.assert_allclose(J, numeric, atol=1e-6 * np.abs(J).max())


def test_pad_stiffness_matches_central_differences_and_is_symmetric_negative(setting):
    solver, x, _ = setting
    K = pad_stiffness(solver, x)
    numeric = central(solver, x, lambda s: s.pad_force)
    np.testing.assert_allclose(K, numeric, atol=1e-6 * np.abs(K).max())
    matrix = K.reshape(6, 6)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-9 * np.abs(matrix).max())
    assert np.linalg.eigvalsh(matrix).max() < 0.0


def test_equals_the_printed_force_form(setting):
    """(3.22): forces on every pad node, eliminated through K with only the base held."""
    solver, x, targets = setting
    body = solver.body
    n = len(body.mesh.nodes)
    alive = np.setdiff1d(np.arange(n), body.fixed)
    dofs = (3 * alive[:, None] + np.arange(3)).ravel()
    K = solver.assembler.tangent(x).toarray()[np.ix_(dofs, dofs)]
    control = np.concatenate([pad.nodes for pad in body.pads])
    rows = (3 * control[:, None] + np.arange(3)).ravel()
    J_c = (dofs[:, None] == rows).astype(float)
    J_m = np.kron(targets.matrix(n).toarray(), np.eye(3)).T[dofs]
    flexible = np.linalg.solve(K, J_c)
    J_s = J_m.T @ flexible @ np.linalg.inv(J_c.T @ flexible)
    printed = (J_s @ pad_translations(body)[rows]).reshape(2, 3, 2, 3)
    np.testing.assert_allclose(target_jacobian(solver, x, targets), printed, atol=1e-9)


def test_directed_is_the_contraction_with_push_directions(setting):
    solver, x, targets = setting
    J, pads = target_jacobian(solver, x, targets), solver.body.pads
    directed = directed_jacobian(solver, x, targets)
    assert directed.shape == (2, 3, 2)
    for p, pad in enumerate(pads):
        np.testing.assert_allclose(directed[:, :, p], J[:, :, p] @ pad.direction, atol=1e-15)


def test_a_target_on_a_pad_moves_with_it(setting):
    solver, x, _ = setting
    on_pad = embed(solver.body.mesh, solver.body.mesh.nodes[solver.body.pads[0].nodes[:1]])
    J = target_jacobian(solver, x, on_pad)
    np.testing.assert_allclose(J[0, :, 0], np.eye(3), atol=1e-9)
    np.testing.assert_allclose(J[0, :, 1], 0.0, atol=1e-9)


def test_no_jacobian_at_an_unstable_state(setting):
    solver, x, targets = setting
    fields = StepFields.of(solver.body)
    fields.stress[:] = -1e6 * np.eye(3)
    with pytest.raises(NotConverged, match='no linearisation'):
        target_jacobian(solver, x, targets, fields)


def test_a_linearisation_outlives_what_the_solver_does_next(setting):
    solver, x, targets = setting
    lin = Linearisation(solver, x)
    before = lin.target_jacobian(targets)
    elsewhere = solver.solve(x, 0.5 * PUSH)
    directed_jacobian(solver, elsewhere.x, targets)
    np.testing.assert_array_equal(lin.target_jacobian(targets), before)
    np.testing.assert_array_equal(target_jacobian(solver, x, targets), before)
    lin.move_to(elsewhere.x)
    assert np.abs(lin.target_jacobian(targets) - before).max() > 1e-4
    lin.move_to(x)
    np.testing.assert_array_equal(lin.target_jacobian(targets), before)


def test_the_pattern_is_analysed_once_for_each_owner(setting, monkeypatch):
    solver, x, targets = setting
    analyses, analyse = [], solver.free.solver
    monkeypatch.setattr(solver.free, 'solver',
                        lambda **kind: analyses.append(1) or analyse(**kind))
    lin = Linearisation(solver, x)
    for _ in range(3):
        lin.move_to(x)
        directed_jacobian(solver, x, targets)
        pad_stiffness(solver, x)
    assert len(analyses) == 1


def test_outstanding_is_the_newton_correction(setting):
    solver, x, _ = setting
    assert Linearisation(solver, x).outstanding() < 1e-12
    off = x.copy()
    off[solver.free.free] += np.random.default_rng(1).normal(scale=1e-7, size=(
        len(solver.free.free), 3))
    np.testing.assert_allclose(Linearisation(solver, off).outstanding(), np.abs(off - x).max(),
                               rtol=1e-3)


def column():
    """Solver of a slender quadratic column, 10 x 10 x 100 mm, foot and head held."""
    mesh = quadratic_mesh(box_mesh((0.01, 0.01, 0.1), (1, 1, 10)))
    m = len(mesh.tets)
    mu, kappa = moduli(6000.0, 0.3)
    head = Pad('head', mesh.node_sets['z1'], np.array([0, 0, -1.0]),
               np.array([0.005, 0.005, 0.1]), 0.05)
    return StaticSolver(SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                                 mesh.node_sets['z0'], (head,)))


@pytest.mark.parametrize('strain, stable', [(0.01, True), (0.1, False)])
def test_a_column_has_a_jacobian_until_it_buckles(strain, stable):
    """Euler, both ends clamped: critical strain 4 pi^2 I / (A L^2) = 4 pi^2 / 1200 = 0.033."""
    solver = column()
    straight = solver.body.mesh.nodes * np.array([1 + 0.3 * strain, 1 + 0.3 * strain, 1 - strain])
    if stable:
        assert np.isfinite(pad_stiffness(solver, straight)).all()
        return
    with pytest.raises(NotConverged, match='no linearisation'):
        pad_stiffness(solver, straight)
    with pytest.raises(NotConverged, match='no linearisation'):
        Linearisation(solver, straight)


def test_an_inverted_state_is_refused_and_left_behind(setting):
    solver, x, targets = setting
    lin = Linearisation(solver, x)
    before = lin.target_jacobian(targets)
    inverted = x.copy()
    inverted[solver.free.free[0]] += 0.1
    with pytest.raises(NotConverged, match='no linearisation.*det F'):
        lin.move_to(inverted)
    np.testing.assert_array_equal(lin.target_jacobian(targets), before)


def test_after_a_refused_tangent_no_answer_until_moved(setting):
    solver, x, targets = setting
    lin, fields = Linearisation(solver, x), StepFields.of(solver.body)
    before = lin.target_jacobian(targets)
    fields.stress[:] = -1e6 * np.eye(3)
    with pytest.raises(NotConverged):
        lin.move_to(x, fields)
    with pytest.raises(FactorisationFailed):
        lin.target_jacobian(targets)
    lin.move_to(x)
    np.testing.assert_array_equal(lin.target_jacobian(targets), before)


def test_a_body_without_pads_has_an_empty_jacobian():
    free = column().body
    solver = StaticSolver(replace(free, pads=()))
    lin = Linearisation(solver, free.mesh.nodes)
    assert lin.state_sensitivity().shape == (len(free.mesh.nodes), 3, 0, 3)
    assert lin.pad_stiffness().shape == (0, 3, 0, 3)


def test_condensed_matrices_are_those_of_the_dense_tangent(setting):
    solver, x, _ = setting
    K, dofs = solver.assembler.tangent(x).toarray(), solver.free.dofs
    free, base = 3 * solver.free.free[5] + np.arange(3), 3 * solver.body.fixed[2] + np.arange(3)
    inverse = np.linalg.inv(K[np.ix_(dofs, dofs)])
    at, each = np.searchsorted(dofs, free), eye_array(x.size, format='csc')
    schur = K[np.ix_(base, base)] - K[np.ix_(base, dofs)] @ inverse @ K[np.ix_(dofs, base)]
    for single, close in ((False, 1e-10), (True, 1e-4)):
        lin = Linearisation(solver, x, single=single)
        expected = inverse[np.ix_(at, at)]
        np.testing.assert_allclose(lin.compliance(each[:, free]), expected,
                                   atol=close * np.abs(expected).max())
        np.testing.assert_allclose(lin.stiffness(base), schur, atol=close * np.abs(schur).max())


def test_what_single_precision_cannot_know_is_solved_in_double(setting):
    """A body a million times stiffer than the springs that hold it."""
    plain, x, _ = setting
    every = np.arange(0, len(x), 7)
    springs = Springs(every, np.tile(1e-3 * np.eye(3), (len(every), 1, 1)))
    body = replace(plain.body, fixed=np.zeros(0, dtype=np.int64), pads=(), springs=springs)
    rows, each = 3 * every[0] + np.arange(3), eye_array(x.size, format='csc')
    double, single = (Linearisation(Equations.of(body), body.mesh.nodes, single=single)
                      .compliance(each[:, rows]) for single in (False, True))
    np.testing.assert_allclose(single, double, rtol=1e-9)
