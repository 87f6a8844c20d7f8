"""The steady filter against the plain recursion, scipy, filterpy and a closed form."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import solve_discrete_are

from arm_brachy.core.errors import NotConverged
from arm_brachy.estimation.steady_gain import kalman_gain, plain_step, steady_covariance


@pytest.fixture(scope='module', params=(False, True), ids=('isotropic', 'correlated'))
def system(request):
    """State model (4.3) of a chain of masses, held at one end, two of them measured."""
    n = 6
    chain = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    P = np.linalg.inv(np.eye(n) + 3.0 * chain)
    S = np.block([[2.0 * P, -P], [np.eye(n), np.zeros((n, n))]])
    C = np.zeros((2, 2 * n))
    C[0, 1] = C[1, 4] = 1.0
    Q = np.zeros((2 * n, 2 * n))
    Q[:n, :n] = np.linalg.inv(chain @ chain) if request.param else 3.0 * np.eye(n)
    return S, C, Q, 0.01 * np.eye(2)


def test_equals_the_plain_recursion_run_to_its_end(system):
    S, C, Q, R = system
    X = np.zeros_like(Q)
    for _ in range(400):
        X = plain_step(X, S, C, Q, R)
    np.testing.assert_allclose(steady_covariance(S, C, Q, R), X, rtol=1e-10, atol=1e-12)


def test_equals_scipys_solver_of_the_dual_problem(system):
    S, C, Q, R = system
    np.testing.assert_allclose(steady_covariance(S, C, Q, R),
                               solve_discrete_are(S.T, C.T, Q, R), rtol=1e-8, atol=1e-10)


def test_gain_and_estimates_equal_filterpys(system):
    """The same measurements through filterpy's filter, started in the steady state."""
    S, C, Q, R = system
    X = steady_covariance(S, C, Q, R)
    gain = kalman_gain(X, C, R)
    n, rng = len(S), np.random.default_rng(1)
    theirs = KalmanFilter(dim_x=n, dim_z=len(C))
    theirs.F, theirs.H, theirs.Q, theirs.R = S, C, Q, R
    theirs.x, theirs.P = np.zeros((n, 1)), X - gain @ C @ X
    ours = np.zeros(n)
    for _ in range(30):
        y = rng.standard_normal(len(C))
        theirs.predict()
        theirs.update(y[:, None])
        ours = S @ ours
        ours = ours + gain @ (y - C @ ours)
    np.testing.assert_allclose(theirs.K, gain, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(theirs.x[:, 0], ours, rtol=1e-8, atol=1e-10)


def test_scalar_random_walk_has_its_closed_form():
    """x <- x + w, y = x + v: X = (q + sqrt(q^2 + 4 q r)) / 2."""
    one = np.ones((1, 1))
    q, r = 0.3, 2.0
    assert steady_covariance(one, one, q * one, r * one)[0, 0] == pytest.approx(
        0.5 * (q + np.sqrt(q * q + 4.0 * q * r)), rel=1e-12)


def test_three_axes_at_once_are_three_times_one_axis(system):
    """The structure that makes the filter cheap: everything times I3."""
    S, C, Q, R = system
    one = steady_covariance(S, C, Q, R)
    all_ = steady_covariance(*(np.kron(A, np.eye(3)) for A in (S, C, Q, R)))
    np.testing.assert_allclose(all_, np.kron(one, np.eye(3)), rtol=1e-10, atol=1e-12)


def test_symmetric_and_positive(system):
    X = steady_covariance(*system)
    np.testing.assert_array_equal(X, X.T)
    assert np.linalg.eigvalsh(X).min() > 0.0


def test_an_unmeasured_error_that_grows_is_named():
    S, C = np.diag([0.5, 1.1]), np.array([[1.0, 0.0]])
    with np.errstate(over='ignore', invalid='ignore'), pytest.raises(
            NotConverged, match='grows is not measured'):
        steady_covariance(S, C, np.eye(2), np.eye(1))
