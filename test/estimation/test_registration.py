"""Rigid registration: against another solution, its covariance against repeated measurement."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.estimation.registration import (
    RegistrationFailed,
    register,
    register_soundly,
)

PLACES = np.array([[82, 60, 0], [-82, 60, 0], [-82, -60, 0], [74, 0, 27], [0, 68, 27],
                   [-71, 0, 27], [0, -72, 27]]) * 1e-3
NAMES = tuple('abcdefg')
SD = np.array([0.1, 0.1, 0.1, 0.3, 0.3, 0.3, 0.3]) * 1e-3
R_WM = Rotation.from_euler('xyz', [30.0, -70.0, 140.0], degrees=True)
P_WM = np.array([0.4, -1.2, 0.9])


def measured(places, error):
    """What a tracker at X_WM makes of places in W, with an error (k, 3) [m] in W."""
    return R_WM.inv().apply(places + error - P_WM)


@pytest.fixture
def noisy():
    rng = np.random.default_rng(1)
    return measured(PLACES, rng.standard_normal(PLACES.shape) * SD[:, None])


def test_equals_scipy_about_the_weighted_middle(noisy):
    fit = register(NAMES, noisy, PLACES, SD)
    weight = SD**-2.0
    middle = [weight @ p / weight.sum() for p in (noisy, PLACES)]
    theirs, rssd = Rotation.align_vectors(PLACES - middle[1], noisy - middle[0], weights=weight)
    np.testing.assert_allclose(fit.R_WM, theirs.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(fit.apply(middle[0]), middle[1], atol=1e-12)
    assert np.sqrt(weight @ fit.residual**2) == pytest.approx(rssd, rel=1e-9)


def test_without_error_the_frame_is_found_exactly():
    fit = register(NAMES, measured(PLACES, 0.0), PLACES, SD)
    np.testing.assert_allclose(fit.R_WM, R_WM.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(fit.p_WM, P_WM, atol=1e-12)
    assert fit.rms < 1e-12


def test_never_a_reflection():
    mirrored = measured(PLACES, 0.0) * [1.0, 1.0, -1.0]
    assert np.linalg.det(register(NAMES, mirrored, PLACES, SD).R_WM) == pytest.approx(1.0)


def errors_of(n=1000, about=None):
    """(n, 6) errors of n registrations: rotation vector, translation of a point; and the fit."""
    rng = np.random.default_rng(2)
    out = []
    for _ in range(n):
        fit = register(NAMES, measured(PLACES, rng.standard_normal(PLACES.shape) * SD[:, None]),
                       PLACES, SD)
        at = fit.centre if about is None else about
        turn = (Rotation.from_matrix(fit.R_WM) * R_WM.inv()).as_rotvec()
        out.append([*turn, *(fit.apply(R_WM.inv().apply(at - P_WM)) - at)])
    return np.array(out), fit


def test_the_covariance_is_that_of_repeated_registration():
    """1000 of them leave 4.5 % of a variance; whitened, so that radians and metres count alike."""
    errors, fit = errors_of()
    whitened = np.linalg.solve(np.linalg.cholesky(fit.covariance), errors.T)
    np.testing.assert_allclose(np.cov(whitened), np.eye(6), atol=0.15)


def test_the_covariance_about_another_point_is_that_of_the_error_there():
    point = np.array([0.05, -0.12, 0.2])
    errors, fit = errors_of(about=point)
    shifted = fit.covariance_about(point)
    whitened = np.linalg.solve(np.linalg.cholesky(shifted), errors.T)
    np.testing.assert_allclose(np.cov(whitened), np.eye(6), atol=0.15)
    assert np.trace(shifted[3:, 3:]) > 2.0 * np.trace(fit.covariance[3:, 3:])


@pytest.mark.parametrize('kept', [slice(0, 2), [0, 0, 0, 0]])
def test_landmarks_that_leave_a_turn_open_are_refused(kept):
    with pytest.raises(RegistrationFailed, match='registration needs'):
        register(NAMES[:len(PLACES[kept])], PLACES[kept], PLACES[kept], SD[kept])


def test_an_em_tracker_is_registered_by_its_sensors_at_rest():
    """Five sensors, some on one level: what is left is their noise, less the six fitted."""
    rest = np.array([[0, 0, 27], [15, 7, 27], [-9, 15, 27], [-14, -10, 27], [8, -17, 27]]) * 1e-3
    rng = np.random.default_rng(3)
    sd, left = 0.08e-3, []
    for _ in range(400):
        fit = register('12345', measured(rest, sd * rng.standard_normal(rest.shape)), rest,
                       np.full(5, sd))
        left.append(np.sum(fit.residual**2))
    assert np.mean(left) == pytest.approx((15 - 6) * sd**2, rel=0.1)


def test_one_landmark_that_the_others_contradict_is_left_out_by_name(noisy):
    off = noisy.copy()
    off[1] += [0.0, 20e-3, 0.0]
    fit = register_soundly(NAMES, off, PLACES, SD, odd=8.0)
    assert fit.rejected == ('b',) and 'b' not in fit.names
    np.testing.assert_allclose(fit.R_WM, R_WM.as_matrix(), atol=0.01)
    assert fit.rms < 0.6e-3


def test_two_swapped_landmarks_are_left_out(noisy):
    swapped = noisy[[0, 2, 1, 3, 4, 5, 6]]
    assert set(register_soundly(NAMES, swapped, PLACES, SD, odd=8.0).rejected) == {'b', 'c'}


def test_sound_landmarks_are_all_kept(noisy):
    assert register_soundly(NAMES, noisy, PLACES, SD, odd=8.0).names == NAMES
