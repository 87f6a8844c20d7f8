"""Registration against rotations known beforehand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording.rigid import fit_rigid


@pytest.mark.parametrize('planar', [False, True])
def test_known_motion_is_found_also_for_markers_in_a_plane(planar):
    rng = np.random.default_rng(1)
    R, p = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    points = rng.normal(size=(5, 3))
    if planar:
        points[:, 2] = 0.0
    fit = fit_rigid(points, points @ R.T + p)
    np.testing.assert_allclose(fit.R, R, atol=1e-12)
    np.testing.assert_allclose(fit.p, p, atol=1e-12)
    np.testing.assert_allclose(fit.residual, 0.0, atol=1e-12)
    np.testing.assert_allclose(fit.apply(points[2]), R @ points[2] + p)


def test_no_reflection_is_used_and_the_fit_is_optimal():
    rng = np.random.default_rng(2)
    p_M, p_W = rng.normal(size=(2, 6, 3))
    p_W = -p_M + 0.01 * p_W  # a mirror image: the best proper rotation is not the mirror
    fit = fit_rigid(p_M, p_W)
    assert np.linalg.det(fit.R) == pytest.approx(1.0)
    best = np.sum(fit.residual**2)
    for turn in 0.05 * np.vstack([np.eye(3), -np.eye(3)]):
        R = Rotation.from_rotvec(turn).as_matrix() @ fit.R
        moved = (p_M - p_M.mean(0)) @ R.T + p_W.mean(0)
        assert np.sum((moved - p_W) ** 2) > best


@pytest.mark.parametrize('points', [np.zeros((3, 3)), np.outer(range(5), [1, 2, 3]), np.eye(2, 3)])
def test_open_rotation_is_refused(points):
    with pytest.raises(RecordingError, match='at least three'):
        fit_rigid(points, points)
