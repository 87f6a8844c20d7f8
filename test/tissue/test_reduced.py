"""The reduced model: exact where it must be, a potential, honest about where it does not hold."""

import dataclasses

import numba
import numpy as np
import pytest
from scipy.linalg import solve_triangular

from arm_brachy.core.errors import InputError, NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.tissue import hyper_reduction, jacobian
from arm_brachy.tissue.body import Pad, SoftBody, Springs
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.hyper_reduction import Galerkin, reduce, train, validate
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.mesh import embed, interpolate, quadratic_mesh
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver
from arm_brachy.tissue.reduced import ReducedOptions, ReducedSolver
from arm_brachy.tissue.reduced_basis import (
    PushDomain,
    ReducedModel,
    Snapshots,
    body_hash,
    sample_pushes,
    snapshots,
)

REACH = 4e-3
INSIDE = [[0.02, 0.02, 0.015], [0.012, 0.025, 0.02]]
TIGHT = ReducedOptions(tolerance=1e-13)


def make_body(divisions=(3, 3, 2), *, quadratic=False, gravity=0.0):
    mesh = box_mesh((0.04, 0.04, 0.03), divisions)
    mesh = quadratic_mesh(mesh) if quadratic else mesh
    x, y, z = mesh.nodes.T
    top = np.flatnonzero(np.isclose(z, 0.03) & (np.abs(x - 0.02) < 0.008)
                         & (np.abs(y - 0.02) < 0.008))
    side = np.flatnonzero(np.isclose(x, 0.0) & (np.abs(y - 0.02) < 0.008) & (z > 0.01)
                          & (z < 0.02))
    oblique = np.array([1.0, 0.6, 0.0]) / np.hypot(1.0, 0.6)
    pads = (Pad('top', top, np.array([0.0, 0.0, -1.0]), np.array([0.02, 0.02, 0.03]), 0.02),
            Pad('side', side, oblique, np.array([0.0, 0.02, 0.015]), 0.02))
    mu, kappa = moduli(6000.0, 0.45)
    m = len(mesh.tets)
    spring = Springs(np.flatnonzero(np.isclose(x, 0.04) & np.isclose(z, 0.03)),
                     np.zeros((0, 3, 3)))
    spring = dataclasses.replace(spring, stiffness=np.tile(5.0 * np.eye(3),
                                                           (len(spring.nodes), 1, 1)))
    return SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1000.0),
                    np.flatnonzero(np.isclose(z, 0.0)), pads, springs=spring,
                    gravity=np.array([0.0, 0.0, -gravity]))


@pytest.fixture(scope='module', params=[False, True], ids=['linear', 'quadratic'])
def trained(request):
    """Body under gravity, its snapshots, a sampled model."""
    body = make_body(quadratic=request.param, gravity=9.81)
    data = snapshots(body, PushDomain.of(body, REACH), 40, np.random.default_rng(3))
    return body, data, reduce(body, data, modes=8, points=60)


def pushes_of(model, count=6, seed=8):
    return sample_pushes(model.domain, 3 + count, np.random.default_rng(seed))[3:]


def test_basis_of_everything_gives_the_full_solution():
    body = make_body(gravity=9.81)
    solver = StaticSolver(body, options=NewtonOptions(tolerance=1e-13))
    rest = solver.solve(body.mesh.nodes, np.zeros((2, 3))).x
    K, _ = solver.linearise(rest)
    dofs = solver.free.dofs
    lower = np.linalg.cholesky(K.toarray()[np.ix_(dofs, dofs)])
    modes = np.zeros((rest.size, len(dofs)))
    modes[dofs] = solve_triangular(lower, np.eye(len(dofs)), lower=True).T
    domain = PushDomain.of(body, REACH)
    nothing = np.zeros((1, 2, 3))
    galerkin = Galerkin(body, Snapshots(domain, nothing, rest[None], nothing, rest), 0, True)
    galerkin.basis = np.concatenate([galerkin.basis, modes.reshape(*rest.shape, -1)], axis=2)
    model = galerkin.model(domain, 0.0)
    reduced = ReducedSolver(model, options=ReducedOptions(tolerance=1e-11))
    targets = embed(body.mesh, INSIDE)
    for push in pushes_of(model, 3):
        full, found = solver.solve(rest, push), reduced.solve(reduced.rest, push)
        assert full.outcome.ok and found.outcome.ok
        np.testing.assert_allclose(model.watch().positions(found), full.x, atol=1e-9)
        np.testing.assert_allclose(found.pad_force, full.pad_force, atol=1e-7)
        np.testing.assert_allclose(reduced.jacobian(found, model.watch(targets)),
                                   jacobian.target_jacobian(solver, full.x, targets), atol=1e-7)
        np.testing.assert_allclose(reduced.pad_stiffness(found),
                                   jacobian.pad_stiffness(solver, full.x), atol=1e-5)


def test_rest_and_its_linearisation_are_exact_with_few_modes_and_points(trained):
    """Loads, springs, pad forces: nothing of them is sampled at rest."""
    body, data, model = trained
    solver, reduced = StaticSolver(body), ReducedSolver(model)
    rest = solver.solve(body.mesh.nodes, np.zeros((2, 3)))
    found = reduced.solve(reduced.rest, np.zeros((2, 3)))
    assert found.iterations == 0
    np.testing.assert_array_equal(model.watch().positions(found), rest.x)
    # what the full solver left out of balance on free nodes, the lifts carry to the pads
    left = rest.residual * np.abs(model.basis[:, :, :6]).sum(axis=(0, 1)).max()
    np.testing.assert_allclose(found.pad_force, rest.pad_force, rtol=0.0, atol=left)
    targets = embed(body.mesh, INSIDE)
    np.testing.assert_allclose(reduced.jacobian(found, model.watch(targets)),
                               jacobian.target_jacobian(solver, rest.x, targets), atol=1e-9)
    np.testing.assert_allclose(reduced.pad_stiffness(found),
                               jacobian.pad_stiffness(solver, rest.x), rtol=1e-7, atol=1e-6)


def test_pads_and_fixed_nodes_are_met_exactly(trained):
    body, _, model = trained
    reduced, push = ReducedSolver(model), pushes_of(model)[1]
    x = model.watch().positions(reduced.solve(reduced.rest, push))
    for pad, moved in zip(body.pads, push, strict=True):
        np.testing.assert_allclose(x[pad.nodes] - body.mesh.nodes[pad.nodes],
                                   np.tile(moved, (len(pad.nodes), 1)), atol=1e-15)
    np.testing.assert_array_equal(x[body.fixed], body.mesh.nodes[body.fixed])


@pytest.mark.parametrize('exact', [True, False])
def test_every_point_with_factor_one_is_plain_galerkin(trained, exact):
    """The modes' share of the full forces vanishes at the state found: independent assembly."""
    body, data, _ = trained
    model = reduce(body, data, modes=8, exact_at_rest=exact)
    assert model.misfit == 0.0
    np.testing.assert_allclose(model.weights, body.geometry.point_weights.ravel(), rtol=1e-15)
    reduced, assembler = ReducedSolver(model, options=TIGHT), StaticSolver(body).assembler
    for push in pushes_of(model):
        found = reduced.solve(reduced.rest, push)
        forces = assembler.forces(model.watch().positions(found))
        energy, gradient = reduced.potential(push, found.q)
        projected = np.einsum('niw,ni->w', model.basis, forces)
        np.testing.assert_allclose(gradient, projected, atol=1e-10)
        assert np.abs(projected[6:]).max() < 1e-9
        rise = (assembler.energy(model.watch().positions(found))
                - assembler.energy(model.reference))
        assert energy - reduced.potential(0.0 * push, 0.0 * found.q)[0] == pytest.approx(
            rise, rel=1e-9)


def test_forces_and_tangent_are_derivatives_of_one_potential(trained):
    _, _, model = trained
    reduced, push = ReducedSolver(model), pushes_of(model)[0]
    q = reduced.solve(reduced.rest, push).q
    H = reduced.tangent(push, q)
    np.testing.assert_array_equal(H, H.T)
    assert np.linalg.eigvalsh(H[6:, 6:]).min() > 0.0
    gradient = reduced.potential(push, q)[1]
    y = np.concatenate([push.ravel(), q])
    for j in range(len(y)):
        step = np.zeros_like(y)
        step[j] = 1e-6 if j < 6 else 1e-5 * np.abs(q).max()
        ahead, back = (reduced.potential((y + s)[:6], (y + s)[6:]) for s in (step, -step))
        slope = (ahead[0] - back[0]) / (2.0 * step[j])
        assert slope == pytest.approx(gradient[j], abs=1e-6 * np.abs(gradient).max())
        np.testing.assert_allclose((ahead[1] - back[1]) / (2.0 * step[j]), H[j],
                                   atol=1e-5 * np.abs(H[j]).max())


def test_the_solution_is_the_minimum_and_newton_descends(trained):
    _, _, model = trained
    reduced, push = ReducedSolver(model), pushes_of(model)[2]
    found = reduced.solve(reduced.rest, push)
    lowest = reduced.potential(push, found.q)[0]
    assert lowest < reduced.potential(push, reduced.rest)[0]
    for change in np.random.default_rng(4).standard_normal((20, len(found.q))):
        other = found.q + 0.1 * np.linalg.norm(found.q) * change / np.linalg.norm(change)
        assert reduced.potential(push, other)[0] > lowest


def test_jacobian_matches_central_differences(trained):
    body, _, model = trained
    reduced = ReducedSolver(model, options=TIGHT)
    watch, push = model.watch(embed(body.mesh, INSIDE)), 0.5 * model.domain.axes[:, 0] * REACH
    found = reduced.solve(reduced.rest, push)
    J, stiffness = reduced.jacobian(found, watch), reduced.pad_stiffness(found)
    for i, pad in enumerate(body.pads):
        step = np.zeros((2, 3))
        step[i] = 1e-6 * pad.direction
        ahead, back = (reduced.solve(found.q, push + s) for s in (step, -step))
        np.testing.assert_allclose((watch.positions(ahead) - watch.positions(back)) / 2e-6,
                                   J[:, :, i] @ pad.direction, atol=1e-6)
        np.testing.assert_allclose((ahead.pad_force - back.pad_force) / 2e-6,
                                   stiffness[:, :, i] @ pad.direction,
                                   atol=1e-5 * np.abs(stiffness).max())


def test_unseen_pushes_come_out_and_more_modes_come_closer(trained):
    """The error falls with the modes; with sampled points it stays of the size of all points'."""
    body, data, sampled = trained
    results = [validate(model, body, np.random.default_rng(77), count=6)
               for model in (reduce(body, data, modes=2), reduce(body, data, modes=8), sampled)]
    assert all(result.ok.all() for result in results)
    few, many, points = (result.anywhere.max() for result in results)
    assert many < 0.5 * few
    assert points < 3.0 * many
    assert results[2].force.max() < 0.01
    assert np.isnan(results[0].watched).all()


def test_starting_point_does_not_matter(trained):
    _, _, model = trained
    reduced, (first, second) = ReducedSolver(model, options=TIGHT), pushes_of(model)[:2]
    warm = reduced.solve(reduced.solve(reduced.rest, first).q, second)
    cold = reduced.solve(reduced.rest, second)
    np.testing.assert_allclose(model.watch().positions(warm), model.watch().positions(cold),
                               atol=1e-11)


def test_following_a_path_reuses_the_factor_and_arrives_where_solving_does(trained):
    _, _, model = trained
    reduced, whole = ReducedSolver(model), model.watch()
    q, push = reduced.rest, 0.5 * REACH * model.domain.axes[:, 0]
    fresh = 0
    for t in np.linspace(0.02, 1.0, 50):
        found = reduced.follow(q, t * push)
        q, fresh = found.q, fresh + found.factorisations
        direct = ReducedSolver(model).solve(reduced.rest, t * push)
        np.testing.assert_allclose(whole.positions(found), whole.positions(direct), atol=3e-9)
    assert fresh < 10
    assert reduced.follow(q, 3.0 * push).outcome is Outcome.REJECTED


def test_equal_arguments_give_equal_bits_for_any_number_of_threads(trained):
    body, data, model = trained
    push, before = pushes_of(model)[0], numba.get_num_threads()
    found = []
    try:
        for threads in (1, min(2, before)):
            numba.set_num_threads(threads)
            again = reduce(body, data, modes=8, points=60)
            reduced = ReducedSolver(again)
            reduced.solve(reduced.rest, 0.5 * push)  # leaves nothing behind
            found.append((again, reduced.solve(reduced.rest, push)))
    finally:
        numba.set_num_threads(before)
    for again, solution in found:
        np.testing.assert_array_equal(again.basis, model.basis)
        np.testing.assert_array_equal(again.weights, model.weights)
        np.testing.assert_array_equal(solution.q, found[0][1].q)
        np.testing.assert_array_equal(solution.pad_force, found[0][1].pad_force)


def test_same_seed_same_model():
    body = make_body((2, 2, 2))
    domain = PushDomain.of(body, 2e-3)
    first, second = (train(body, domain, rng=np.random.default_rng(1), samples=8, modes=3,
                           points=20) for _ in range(2))
    for name in ('basis', 'points', 'weights', 'linear', 'quadratic'):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert (first.weights > 0.0).all()


def test_saved_and_loaded_it_answers_with_the_same_bits(trained, tmp_path):
    body, _, model = trained
    model.save(tmp_path / 'model.npz')
    again = ReducedModel.load(tmp_path / 'model.npz', body)
    push = pushes_of(model)[0]
    one, other = (ReducedSolver(m).solve(np.zeros(8), push) for m in (model, again))
    np.testing.assert_array_equal(one.q, other.q)
    np.testing.assert_array_equal(one.pad_force, other.pad_force)


def test_another_body_is_refused(trained, tmp_path):
    body, _, model = trained
    model.save(tmp_path / 'model.npz')
    moved = dataclasses.replace(body.mesh, nodes=body.mesh.nodes * (1.0 + 1e-12))
    for other in (dataclasses.replace(body, mu=1.001 * body.mu),
                  dataclasses.replace(body, gravity=np.zeros(3)),
                  dataclasses.replace(body, pads=body.pads[::-1]),
                  dataclasses.replace(body, mesh=moved)):
        assert body_hash(other) != body_hash(body)
        with pytest.raises(InputError, match='train a model for this body'):
            ReducedModel.load(tmp_path / 'model.npz', other)


@pytest.mark.parametrize('content', [b'', b'no archive'])
def test_a_file_that_is_no_model_is_refused(trained, tmp_path, content):
    (tmp_path / 'bad.npz').write_bytes(content)
    with pytest.raises(InputError, match='cannot be read as a reduced model'):
        ReducedModel.load(tmp_path / 'bad.npz', trained[0])


@pytest.mark.parametrize(('push', 'said'), [((1.1, 0.0), 'pad 0 pushed 4.4'),
                                            ((0.0, -0.1), 'pad 1 pushed -0.4')])
def test_outside_its_domain_it_refuses_and_says_why(trained, push, said):
    _, _, model = trained
    reduced = ReducedSolver(model)
    found = reduced.solve(reduced.rest, np.array(push)[:, None] * REACH * model.domain.axes[:, 0])
    assert found.outcome is Outcome.REJECTED
    assert said in found.message
    assert np.isnan(found.pad_force).all()
    with pytest.raises(NotConverged, match='pushed'):
        model.watch().positions(found)
    with pytest.raises(NotConverged, match='pushed'):
        reduced.jacobian(found, model.watch())


def test_domain_refuses_sideways_and_too_many_together():
    domain = PushDomain.of(make_body((2, 2, 2)), REACH, together=1.5, play=1e-4)
    inward, across = domain.axes[:, 0], domain.axes[:, 1]
    assert domain.complaint(np.zeros((2, 3))) == ''
    assert domain.complaint(0.75 * REACH * inward + 1e-4 * across) == ''
    assert 'together' in domain.complaint(0.8 * REACH * inward)
    assert 'across' in domain.complaint(2e-4 * across)
    with pytest.raises(InputError, match='push domain'):
        PushDomain.of(make_body((2, 2, 2)), 0.0)


def test_samples_fill_the_domain_and_stay_inside():
    domain = PushDomain.of(make_body((2, 2, 2)), REACH, play=1e-4)
    pushes = sample_pushes(domain, 200, np.random.default_rng(0))
    assert pushes.shape == (200, 2, 3)
    assert not any(domain.complaint(push) for push in pushes)
    depth = np.einsum('kpj,pj->kp', pushes, domain.axes[:, 0]) / REACH
    np.testing.assert_allclose(depth[:3], [[0, 1], [1, 0], [1, 1]], atol=1e-12)
    assert (np.count_nonzero(depth > 1e-9, axis=1) == 1).sum() > 40
    for corner in ([0.2, 0.2], [0.8, 0.2], [0.2, 0.8], [0.8, 0.8]):
        assert np.abs(depth - corner).max(axis=1).min() < 0.15


def test_no_equilibrium_within_the_iterations_is_said(trained):
    _, _, model = trained
    reduced = ReducedSolver(model, options=ReducedOptions(max_iterations=1, max_bisections=1))
    found = reduced.solve(reduced.rest, pushes_of(model)[2])
    assert found.outcome is Outcome.NOT_CONVERGED
    np.testing.assert_array_equal(found.q, reduced.rest)
    assert np.isnan(found.residual)


@pytest.mark.parametrize('bad', [np.zeros(3), np.full(8, np.nan)])
def test_refuses_bad_starts_and_commands(trained, bad):
    reduced = ReducedSolver(trained[2])
    with pytest.raises(InputError, match='q0'):
        reduced.solve(bad, np.zeros((2, 3)))
    with pytest.raises(InputError, match='pad_displacement'):
        reduced.solve(reduced.rest, np.zeros((1, 3)))


def test_more_modes_than_snapshots_hold_are_refused(trained):
    body, data, _ = trained
    with pytest.raises(InputError, match='ask for fewer'):
        reduce(body, data, modes=41)


def test_training_names_the_push_that_has_no_solution():
    body = make_body((2, 2, 2))
    with pytest.raises(NotConverged, match='training push'):
        hyper_reduction.train(body, PushDomain.of(body, 0.05), rng=np.random.default_rng(0),
                              samples=4)


def test_watched_points_ride_like_embedded_ones(trained):
    body, _, model = trained
    reduced, targets = ReducedSolver(model), embed(body.mesh, INSIDE)
    found = reduced.solve(reduced.rest, pushes_of(model)[0])
    np.testing.assert_allclose(model.watch(targets).positions(found),
                               interpolate(targets, model.watch().positions(found)), atol=1e-16)
