"""The programme (3.29) against closed forms, another solver, and its own limits."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize

from arm_brachy.control.mpc import Mpc, MpcParams
from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome

WIDE = 10.0    # m, and m/s: limits that never act
J4 = np.array([[-0.40, 0.42, 0.05, -0.06], [0.03, -0.05, -0.38, 0.41], [0.1, 0.1, 0.1, 0.1]])


def wide_open(params, p):
    """An Mpc whose limits are out of the way."""
    return Mpc(params, np.full(p, WIDE), WIDE)


def test_without_limits_it_is_the_batch_least_squares_solution():
    params = MpcParams(horizon=6, retraction=True, terminal_weight=3.0)
    error = np.array([1e-3, -2e-3, 0.5e-3])
    answer = wide_open(params, 4).step(error, J4, np.full(4, WIDE / 2))
    # Stack sqrt(Q) (e0 - J sum u) and sqrt(R) u as one ordinary least-squares problem.
    N, p = params.horizon, 4
    rows = [np.hstack([J4 if i <= h else np.zeros((3, p)) for i in range(N)]) for h in range(N)]
    weight = np.sqrt(params.error_weight) * np.ones(N)
    weight[-1] *= np.sqrt(params.terminal_weight)
    A = np.vstack([*(w * r for w, r in zip(weight, rows, strict=True)),
                   np.sqrt(params.push_weight) * np.eye(N * p)])
    b = np.concatenate([*(w * error for w in weight), np.zeros(N * p)])
    expected = np.linalg.lstsq(A, b, rcond=None)[0].reshape(N, p)
    assert np.allclose(answer.plan, expected, atol=1e-9)
    assert np.allclose(answer.push, expected[0], atol=1e-9)


def test_a_long_horizon_gives_the_riccati_feedback():
    params = MpcParams(horizon=60, retraction=True)
    j = 0.4
    J = np.array([[j], [0.0], [0.0]])
    answer = wide_open(params, 1).step(np.array([1e-3, 0, 0]), J, np.full(1, WIDE / 2))
    Q, R = params.error_weight, params.push_weight
    # e_0 cannot be changed and drops out, so the state cost acts from the next error on.
    S = solve_discrete_are(np.eye(1), np.array([[j]]), Q * np.eye(1), R * np.eye(1))[0, 0]
    assert answer.push[0] == pytest.approx(1e-3 * j * S / (R + j * S * j), rel=1e-6)


def test_default_weights_shrink_the_error_by_about_a_quarter_per_period():
    params = MpcParams(retraction=True)
    J = np.array([[0.4], [0.0], [0.0]])
    answer = wide_open(params, 1).step(np.array([1e-3, 0, 0]), J, np.full(1, WIDE / 2))
    assert 0.2 < 0.4 * answer.push[0] / 1e-3 < 0.3


def reference_solution(params, error, J, q, stroke, step):
    """Minimise (3.29) with a general solver, in mm."""
    N, p = params.horizon, J.shape[1]
    e0, Jm = error * 1e3, J

    def cost(z):
        plan = z.reshape(N, p)
        errors = e0 - np.cumsum(plan, axis=0) @ Jm.T
        return 0.5 * (np.sum(errors**2) + 2.0 * np.sum(plan**2))

    travel = {'type': 'ineq',
              'fun': lambda z: ((stroke - q) * 1e3 - np.cumsum(z.reshape(N, p), axis=0)).ravel()}
    answer = minimize(cost, np.zeros(N * p), bounds=[(0, step * 1e3)] * (N * p),
                      constraints=[travel], method='SLSQP',
                      options={'ftol': 1e-14, 'maxiter': 500})
    return answer.x.reshape(N, p) * 1e-3, cost


def test_with_limits_it_agrees_with_a_general_solver():
    params = MpcParams(horizon=4)
    rng = np.random.default_rng(1)
    stroke, speed = np.full(4, 3e-3), 5e-3
    mpc = Mpc(params, stroke, speed)
    for _ in range(8):
        error, q = rng.normal(size=3) * 2e-3, rng.uniform(1.5e-3, 3e-3, 4)
        J = J4 + 0.1 * rng.normal(size=(3, 4))
        answer = mpc.step(error, J, q)
        expected, cost = reference_solution(params, error, J, q, stroke, speed * params.period)
        assert answer.outcome is Outcome.OK
        assert cost(answer.plan.ravel() * 1e3) == pytest.approx(cost(expected.ravel() * 1e3),
                                                                rel=1e-6)
        assert np.allclose(answer.push, expected[0], atol=2e-7)


@pytest.mark.parametrize('retraction', [False, True])
def test_push_stroke_and_speed_limits_hold_on_random_problems(retraction):
    params = MpcParams(horizon=8, retraction=retraction)
    rng = np.random.default_rng(7)
    stroke, speed = rng.uniform(5e-3, 30e-3, 4), rng.uniform(2e-3, 10e-3, 4)
    mpc = Mpc(params, stroke, speed)
    back = -speed * params.period if retraction else np.zeros(4)
    for _ in range(60):
        q = rng.uniform(0.0, 1.0, 4) * stroke
        answer = mpc.step(rng.normal(size=3) * 8e-3, rng.normal(size=(3, 4)) * 0.4, q)
        assert answer.outcome is Outcome.OK
        assert np.all(answer.push >= back) and np.all(answer.push <= speed * params.period)
        assert np.all(q + answer.push >= 0.0) and np.all(q + answer.push <= stroke)


def test_a_far_goal_runs_at_the_speed_limit_and_ends_at_the_stroke():
    params = MpcParams()
    mpc = Mpc(params, np.array([4e-3]), 5e-3)
    J, q, pushes = np.array([[0.5], [0.0], [0.0]]), np.zeros(1), []
    for _ in range(12):
        pushes.append(mpc.step(np.array([50e-3, 0, 0]) - J @ q, J, q).push)
        q = q + pushes[-1]
    assert np.allclose(pushes[:8], 5e-4, atol=1e-9)     # 5 mm/s for 0.1 s
    assert q[0] == pytest.approx(4e-3, abs=1e-9)
    assert pushes[-1][0] == pytest.approx(0.0, abs=1e-9)


def test_a_free_axis_weighs_nothing():
    error = np.array([-5e-3, 0.0, 0.0])
    mpc = wide_open(MpcParams(retraction=True), 4)
    relaxed = mpc.step(error + [0.0, 7e-3, -3e-3], J4, np.full(4, 1.0), (True, False, False))
    same = wide_open(MpcParams(retraction=True), 4).step(error, J4, np.full(4, 1.0),
                                                         (True, False, False))
    assert np.allclose(relaxed.push, same.push, atol=1e-9)
    # One controlled axis: the plan lies along that row of the Jacobian.
    assert abs(np.corrcoef(relaxed.push, J4[0])[0, 1]) == pytest.approx(1.0, abs=1e-6)


def test_predicted_path_is_the_prediction_3_27():
    mpc = Mpc(MpcParams(horizon=5), np.full(4, 30e-3), 5e-3)
    error = np.array([2e-3, 1e-3, 0.0])
    answer = mpc.step(error, J4, np.zeros(4))
    walked = error - np.array([J4 @ answer.plan[:h + 1].sum(axis=0) for h in range(5)])
    assert np.allclose(answer.path, walked, atol=1e-12)


def test_a_pad_beyond_its_stroke_is_infeasible_and_holds():
    answer = Mpc(MpcParams(), np.full(4, 30e-3), 5e-3).step(
        np.array([1e-3, 0, 0]), J4, np.array([31e-3, 0, 0, 0]))
    assert answer.outcome is Outcome.INFEASIBLE
    assert np.all(answer.push == 0.0)


def test_same_sequence_same_bits():
    def run():
        mpc, rng = Mpc(MpcParams(), np.full(4, 30e-3), 5e-3), np.random.default_rng(3)
        return [mpc.step(rng.normal(size=3) * 3e-3, J4, np.full(4, 1e-3)).push.tobytes()
                for _ in range(20)]
    assert run() == run()


def test_a_warm_start_changes_nothing_that_matters():
    mpc, rng = Mpc(MpcParams(), np.full(4, 30e-3), 5e-3), np.random.default_rng(5)
    for _ in range(15):
        error = rng.normal(size=3) * 3e-3
        fresh = Mpc(MpcParams(), np.full(4, 30e-3), 5e-3).step(error, J4, np.zeros(4))
        assert np.allclose(mpc.step(error, J4, np.zeros(4)).push, fresh.push, atol=1e-8)


def test_bad_parameters_are_refused_by_name():
    with pytest.raises(ConfigError, match='horizon = 0'):
        MpcParams(horizon=0)
    with pytest.raises(ConfigError, match='push_weight_per_mm2'):
        config.from_mapping(MpcParams, {'push_weight_per_mm2': -1.0}, 'test.yaml')
    assert config.from_mapping(MpcParams, config.to_mapping(MpcParams()), 'x') == MpcParams()
