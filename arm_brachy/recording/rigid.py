"""Rigid registration of markers: from the tracker's frame M to the world frame W."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import RecordingError


@dataclass(frozen=True)
class RigidFit:
    """X_WM and what it leaves. R (3, 3), p (3,) [m];  residual (k,) [m] per marker."""

    R: np.ndarray
    p: np.ndarray
    residual: np.ndarray

    def apply(self, points):
        """Take points (..., 3) from M to W."""
        return points @ self.R.T + self.p


def fit_rigid(p_M, p_W):
    """Rotation and translation with least summed squared distance (no scale, no reflection).

    p_M, p_W : (k, 3) [m] the same markers in both frames, k >= 3, not on one line
    Returns RigidFit. Raises RecordingError if the markers leave a rotation open.
    Source: Kabsch, Acta Cryst. A32 (1976) 922; the sign of the determinant as in Umeyama,
    IEEE Trans. PAMI 13 (1991) 376.
    Test: recording/test_rigid.py.
    """
    p_M, p_W = np.asarray(p_M, dtype=float), np.asarray(p_W, dtype=float)
    centre_M, centre_W = p_M.mean(axis=0), p_W.mean(axis=0)
    U, spread, Vt = np.linalg.svd((p_W - centre_W).T @ (p_M - centre_M))
    if len(p_M) < 3 or spread[1] <= 1e-6 * spread[0]:
        raise RecordingError(f'{len(p_M)} markers, nearly on one line: a rigid fit needs at least '
                             'three that are not')
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    R = U @ flip @ Vt
    p = centre_W - R @ centre_M
    residual = np.linalg.norm(p_M @ R.T + p - p_W, axis=1)
    return RigidFit(R, p, residual)
