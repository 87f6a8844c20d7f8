"""MAP: exact where the problem is linear, honest on its own prior, named where it fails."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.estimation import map as estimator
from arm_brachy.estimation.estimate import Surface
from arm_brachy.estimation.forward import TOLERANCE
from arm_brachy.estimation.gaussian import student_weights
from arm_brachy.estimation.known_load import KnownLoad, nodal_forces
from arm_brachy.estimation.map_update import hypotheses, own_variance
from arm_brachy.estimation.unknowns import PriorParams

PRIOR = PriorParams(modulus_modes=8, force_modes=4, load_places=0)
# Gaussian noise and one prior; with memory and iterations, which the defaults leave out
PARAMS = estimator.MapParams(prior=PRIOR, dof=1e9, memory=30.0, iterations=2, others=1.0)
Q = np.array([0.003, 0.001])
FRAME = np.diag([1e-3, 1e-3, 1e-3, 2e-4, 2e-4, 2e-4])**2


@pytest.fixture(scope='module')
def built(block):
    return estimator.build(block.scene, (), block.targets, block.markers, PARAMS)


def truth(built, rng, params=PARAMS, size=1.0):
    """A Surface and the targets of the nonlinear model with unknowns drawn from the prior."""
    forward, k = built._forward, built._k
    theta = size * rng.normal(size=k)
    theta[forward.unknowns.part('slides')] = 0.0    # these and the base have no exact solve
    theta[forward.unknowns.part('base')] = 0.0
    x = built._rest
    for _ in range(4):  # fibres take their stress from the state before
        fields, offset, _ = forward.unknowns.applied(theta, Q, x)
        x = forward.solve(x, Q, fields, offset)
    points, strain = forward.points(x), forward.strain(x)**estimator.STRAINED
    m = forward.n_markers
    own = np.sqrt(params.offset**2 + (params.marker_local * strain[:m])**2)
    seen = points[:m] + own[:, None] * rng.normal(size=(m, 3))
    local = np.sqrt(params.floor**2 + (params.target_local * strain[m:])**2)
    targets = points[m:] + local[:, None] * rng.normal(size=(len(points) - m, 3))
    return Surface(0.0, Q, seen + params.noise * rng.normal(size=(m, 3))), targets


def test_a_linear_case_gives_the_exact_posterior(block):
    built = estimator.build(block.scene, (), block.targets, block.markers,
                            replace(PARAMS, iterations=1))
    forward, m = built._forward, built._forward.n_markers
    x = forward.solve(built._rest, Q)
    points, strain = forward.points(x), forward.strain(x)**estimator.STRAINED
    H = forward.response(x, Q)
    rng = np.random.default_rng(3)
    offset = 1e-5 * rng.normal(size=(m, 3))     # small: every weight is one
    arms = points[:m] - points[:m].mean(axis=0)
    J = np.zeros((m, 3, 6))
    for a in range(3):
        J[:, :, a], J[:, a, 3 + a] = np.cross(np.eye(3)[a], arms), 1.0
    J = J.reshape(-1, 6)
    own = np.repeat(PARAMS.offset**2 + (PARAMS.marker_local * strain[:m])**2, 3)
    R = J @ FRAME @ J.T + np.diag(own + PARAMS.noise**2)
    # The information form, unknowns only, the rest marginalised into the noise.
    Hm, Ht = H[:3 * m], H[3 * m:]
    information = np.eye(H.shape[1]) + Hm.T @ np.linalg.solve(R, Hm)
    theta = np.linalg.solve(information, Hm.T @ np.linalg.solve(R, offset.ravel()))
    spread = Ht @ np.linalg.solve(information, Ht.T)
    found = built.step(Surface(0.0, Q, points[:m] + offset, FRAME))
    np.testing.assert_allclose(found.points.ravel(), points[m:].ravel() + Ht @ theta,
                               atol=TOLERANCE)
    local = PARAMS.floor**2 + (PARAMS.target_local * strain[m:])**2
    for i, block_ in enumerate(found.covariance):
        expected = PARAMS.inflation * (spread[3 * i:3 * i + 3, 3 * i:3 * i + 3]
                                       + local[i] * np.eye(3))
        np.testing.assert_allclose(block_, expected, rtol=1e-3,   # x is known to TOLERANCE
                                   atol=1e-12)


def test_ellipses_hold_nonlinear_draws_from_the_prior_as_often_as_they_say(built):
    inside, rng, count = 0, np.random.default_rng(11), 24
    for _ in range(count):
        surface, targets = truth(built, rng, size=0.5)
        built.reset()
        found = built.step(surface)
        assert found.outcome.ok
        error = found.points[0] - targets[0]
        # half the prior's spread, so that the ellipse is wide rather than narrow
        inside += error @ np.linalg.solve(found.covariance[0] / PARAMS.inflation, error) < (
            chi2.ppf(0.95, 3))
    assert inside >= binom.ppf(1e-3, count, 0.95)


def test_it_comes_nearer_than_the_model_without_markers(built):
    errors, open_loop, rng = [], [], np.random.default_rng(12)
    for _ in range(20):
        surface, targets = truth(built, rng)
        built.reset()
        errors.append(np.linalg.norm(built.step(surface).points - targets, axis=1).mean())
        x = built._forward.solve(built._rest, Q)
        points = built._forward.points(x)[built._m:]
        open_loop.append(np.linalg.norm(points - targets, axis=1).mean())
    assert np.mean(errors) < 0.8 * np.mean(open_loop)


def test_the_fixed_point_is_a_minimum_of_the_posterior(block):
    """Iterated to the end, the gradient of the negative logarithm of the posterior vanishes."""
    built = estimator.build(block.scene, (), block.targets, block.markers, replace(
        PARAMS, iterations=12, settled=1e-9))
    surface, _ = truth(built, np.random.default_rng(13))
    assert built.step(surface).outcome.ok
    k, m = built._k, built._m
    at, s = built._at, built._state.average()
    own = np.repeat(np.sqrt(own_variance(at, built.params)), 3)

    def slope(points, s):
        left = (surface.markers - points[:m]).ravel() - own * s[k + 6:]
        found = s.copy()
        found[:k] -= at.response[:3 * m].T @ left / PARAMS.noise**2
        found[k + 6:] -= own * left / PARAMS.noise**2
        return np.abs(found).max()
    x = built._forward.solve(built._rest, Q)
    assert slope(at.points, s) < 5e-3 * slope(built._forward.points(x), np.zeros(len(s)))


def test_memory_that_is_short_leaves_no_trace(block):
    params = replace(PARAMS, memory=1e-3)
    built = estimator.build(block.scene, (), block.targets, block.markers, params)
    first, _ = truth(built, np.random.default_rng(14))
    second, _ = truth(built, np.random.default_rng(15))
    built.reset()
    alone = built.step(replace(second, t=10.0))
    built.reset()
    built.step(first)
    after = built.step(replace(second, t=10.0))
    np.testing.assert_allclose(after.points, alone.points, atol=2e-5)


def test_what_was_seen_narrows_what_is_believed_next(built):
    built.reset()
    surface, _ = truth(built, np.random.default_rng(16))
    first = built.step(surface)
    few = surface.markers.copy()
    few[2:] = np.nan
    later = built.step(replace(surface, t=0.1, markers=few))
    built.reset()
    alone = built.step(replace(surface, markers=few))
    assert np.trace(later.covariance[0]) < np.trace(alone.covariance[0])
    assert np.trace(first.covariance[0]) < np.trace(alone.covariance[0])


def test_an_outlying_marker_is_named_and_hardly_moves_the_estimate(block):
    built = estimator.build(block.scene, (), block.targets, block.markers,
                            replace(PARAMS, dof=4.0))
    surface, _ = truth(built, np.random.default_rng(17))
    clean = built.step(surface)
    built.reset()
    off = surface.markers.copy()
    off[3] += [0.0, 0.02, 0.0]
    robust = built.step(replace(surface, markers=off))
    assert robust.outcome.ok
    assert block.markers[3] in robust.message
    assert np.linalg.norm(robust.points - clean.points, axis=1).max() < 5e-4


def test_markers_of_something_else_are_refused(block):
    built = estimator.build(block.scene, (), block.targets, block.markers,
                            replace(PARAMS, dof=4.0))
    surface, _ = truth(built, np.random.default_rng(18))
    wrong = built.step(replace(surface, markers=surface.markers[::-1].copy()))
    assert wrong.outcome is Outcome.DEPARTED
    assert np.isnan(wrong.points).all()
    assert built.step(surface).outcome.ok


def test_failures_are_named(built, block):
    surface, _ = truth(built, np.random.default_rng(19))
    built.reset()
    blind = built.step(replace(surface, markers=np.full_like(surface.markers, np.nan)))
    assert blind.outcome is Outcome.REJECTED
    crushed = built.step(replace(surface, q=np.array([0.5, 0.5])))
    assert crushed.outcome is Outcome.NOT_CONVERGED
    assert crushed.message
    assert built.step(surface).outcome.ok
    with pytest.raises(ConfigError, match='no such file'):
        estimator.build(block.scene, (), block.targets, block.markers,
                        replace(PARAMS, mesh='none.msh'))


def test_same_input_same_bits(built, block):
    other = estimator.build(block.scene, (), block.targets, block.markers, PARAMS)
    surface, _ = truth(other, np.random.default_rng(20))
    built.step(replace(surface, q=2.0 * Q))
    built.reset()
    other.reset()
    for t in (0.0, 0.1):
        a, b = (one.step(replace(surface, t=t)) for one in (built, other))
        assert a.points.tobytes() == b.points.tobytes()
        assert a.covariance.tobytes() == b.covariance.tobytes()


def test_weights_are_one_inside_and_fall_with_the_square_outside():
    w = student_weights(np.array([0.0, 3.0, 300.0, 3e6]), 4.0)
    assert w[0] == w[1] == 1.0
    assert 0.0 < w[3] < w[2] < 0.05


def test_within_reuse_the_linearisation_is_moved_and_as_good_as_a_new_one(block):
    """The pads' motion is followed to first order: far below a marker's noise at a millimetre."""
    params = replace(PARAMS, memory=1e-3, iterations=1, reuse=1e-3)
    moved, fresh = (estimator.build(block.scene, (), block.targets, block.markers, p)
                    for p in (params, replace(params, reuse=0.0)))
    surface, _ = truth(moved, np.random.default_rng(21))
    there = replace(surface, t=1.0, q=Q + [0.9e-3, 0.0])
    points = fresh._forward.points(fresh._forward.solve(fresh._rest, there.q))
    there = replace(there, markers=surface.markers + points[:moved._m]
                    - fresh._forward.points(fresh._forward.solve(fresh._rest, Q))[:moved._m])
    for one in (moved, fresh):
        one.reset()
        one.step(surface)
    before = moved._at
    a, b = moved.step(there), fresh.step(there)
    assert moved._at is before and fresh._at.q is not before.q
    assert np.linalg.norm(a.points - b.points, axis=1).max() < 0.1e-3
    assert np.linalg.norm(b.points - moved.step(surface).points, axis=1).max() > 0.2e-3
    np.testing.assert_allclose(a.x, b.x, atol=0.2e-3)


def test_the_suspicion_that_explains_the_markers_gains_weight(block):
    """Pads slid by two standard deviations, and a body that is as the model has it.

    Without the faces of pads, which explain part of the same.
    """
    built = estimator.build(block.scene, (), block.targets, block.markers, replace(
        PARAMS, others=0.1, iterations=1, prior=replace(PRIOR, faces=0.0)))
    scale = hypotheses(built.unknowns, 0.1)
    part, x = built.unknowns.part('slides'), built._rest
    of_slides = int(np.flatnonzero(scale[:, part].min(axis=1) == 1.0)[0])
    fields, offset, _ = built.unknowns.applied(np.zeros(built._k), Q, x)
    x = built._forward.solve(x, Q, fields, offset)
    H = built._forward.response(x, Q)
    points = built._forward.points(x)[:built._m]
    theta = np.zeros(built._k)
    built.step(Surface(0.0, Q, points))
    at_rest = built._state.weights[of_slides]
    theta[part] = 2.0
    built.reset()
    built.step(Surface(0.0, Q, points + (H @ theta).reshape(-1, 3)[:built._m]))
    assert built._state.weights.argmax() == of_slides
    assert built._state.weights[of_slides] > at_rest


def test_a_load_that_nobody_told_is_named_and_widens_the_ellipse(block):
    """Half a newton on the skin beside the pads; without it nothing is named."""
    params = estimator.MapParams(prior=replace(PRIOR, load_places=8))
    built = estimator.build(block.scene, (), block.targets, block.markers, params)
    x = built._forward.solve(built._rest, Q)
    theta = np.zeros(built._k)
    quiet = built.step(Surface(0.0, Q, built._forward.points(x)[:built._m]))
    assert quiet.notice is Outcome.OK
    theta[built.unknowns.part('load').start + 4] = 0.5
    fields, offset, _ = built.unknowns.applied(theta, Q, x)
    pressed = built._forward.points(built._forward.solve(x, Q, fields, offset))
    built.reset()
    found = built.step(Surface(0.0, Q, pressed[:built._m]))
    assert found.outcome.ok and found.notice is Outcome.UNKNOWN_LOAD
    off = found.points - pressed[built._m:]
    squared = [o @ np.linalg.solve(P, o) for o, P in zip(off, found.covariance, strict=True)]
    assert max(squared) < chi2.ppf(0.95, 3)
    assert found.covariance[0].trace() > 2.0 * quiet.covariance[0].trace()


TOP = 0.02, 0.02, 0.06     # m, on the block's skin, between middle and corner


def load_at(place, force, sd=8e-3):
    return KnownLoad(np.asarray(place), np.asarray(force), sd**2 * np.eye(3))


def under(built, load, q, share=1.0):
    """Points of the nonlinear model under a share of a load."""
    known = share * nodal_forces((load,), built._rest, built._volume)
    fields, offset, _ = built.unknowns.applied(np.zeros(built._k), q, built._rest, None, known)
    return built._forward.points(built._forward.solve(built._rest, q, fields, offset))


@pytest.mark.parametrize('share', [1.0, 0.7])
def test_a_load_that_is_told_is_no_unknown_one_and_leaves_the_targets_where_they_are(block, share):
    """Half a newton on the skin; the body may give by 0.7 of what the model thinks."""
    params = estimator.MapParams(prior=replace(PRIOR, load_places=8))
    built = estimator.build(block.scene, (), block.targets, block.markers, params)
    load = load_at(TOP, [0.1, 0.0, -0.5])
    points = under(built, load, Q, share)
    moved = np.linalg.norm(points - built._forward.points(built._forward.solve(built._rest, Q)),
                           axis=1)[built._m:]
    off = {}
    for loads in ((), (load,)):
        built.reset()
        found = built.step(Surface(0.0, Q, points[:built._m], loads=loads))
        off[len(loads)] = np.linalg.norm(found.points - points[built._m:], axis=1)
        assert (found.notice is Outcome.UNKNOWN_LOAD) == (not loads)
    assert moved.max() > 0.1e-3
    assert off[1].max() < 0.5 * off[0].max() and off[1].max() < 0.25 * moved.max()
    squared = [o @ np.linalg.solve(P, o) for o, P in zip(
        found.points - points[built._m:], found.covariance, strict=True)]
    assert max(squared) < chi2.ppf(0.95, 3)


def test_a_load_that_grows_is_followed_to_first_order_between_two_linearisations(block):
    """The one that starts anew at every frame solves; the other does while `reload` lasts."""
    params = replace(PARAMS, iterations=1, memory=1e-3, others=0.25)
    moved, fresh = (estimator.build(block.scene, (), block.targets, block.markers, params)
                    for _ in range(2))
    solved = []
    for k, force in enumerate((0.0, 0.2, 0.4, 2.0)):
        load = load_at(TOP, [0.0, 0.0, -force])
        points, before = under(fresh, load, Q), moved._at
        seen = Surface(0.1 * k, Q, points[:moved._m], loads=(load,))
        fresh.reset()
        a, b = moved.step(seen), fresh.step(seen)
        solved.append(moved._at is not before)
        by_load = np.linalg.norm(points - under(fresh, load_at(TOP, np.zeros(3)), Q), axis=1)
        apart = np.linalg.norm(a.points - b.points, axis=1)
        assert apart.max() <= max(20e-6, 0.03 * by_load[moved._m:].max())
    assert solved == [True, False, False, True]


def test_markers_under_a_load_are_not_looked_at(block):
    built = estimator.build(block.scene, (), block.targets, block.markers, PARAMS)
    points = built._forward.points(built._forward.solve(built._rest, Q))
    load = load_at(points[0], [0.0, 0.0, -0.2], sd=1e-3)
    seen = points[:built._m].copy()
    said = []
    for off in (0.0, 0.01):
        seen[0] = points[0] + [0.0, 0.0, 0.1 * off]
        built.reset()
        said.append(built.step(Surface(0.0, Q, seen, loads=(load,))).points)
    assert np.array_equal(*said)


def test_a_frame_that_solves_and_one_that_differentiates_are_as_good_as_both_in_one(block):
    """Pads that go on by more than `reuse`; the other estimator starts anew at every frame."""
    params = replace(PARAMS, iterations=1, memory=1e-3, others=0.25, reuse=0.1e-3)
    moved, fresh = (estimator.build(block.scene, (), block.targets, block.markers, params)
                    for _ in range(2))
    x, stale = moved._rest, []
    for k, way in enumerate((0.0, 0.4e-3, 0.45e-3, 0.9e-3)):
        x = moved._forward.solve(x, Q + [way, 0.0])
        seen = Surface(0.1 * k, Q + [way, 0.0], moved._forward.points(x)[:moved._m] + 1e-4)
        fresh.reset()
        a, b = moved.step(seen), fresh.step(seen)
        stale.append(moved._at.stale)
        np.testing.assert_allclose(a.points, b.points, atol=5e-6)
        assert np.linalg.norm(a.covariance - b.covariance) < 0.1 * np.linalg.norm(b.covariance)
    assert stale == [False, True, False, True]
