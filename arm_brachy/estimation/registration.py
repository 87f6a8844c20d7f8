"""Rigid registration of a tracker to the world frame, and how sure it is.

Landmarks are points whose place in the world is known: markers on the base, markers on a pad with
its encoder, a sensor at its rest position. Nothing here depends on the kind of tracker: the
optical tracker is registered by base and pads, an EM tracker by sensors at rest.
"""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import ArmBrachyError

FEWEST = 3            # points that fix a rotation and a translation
_ON_A_LINE = 1e-3     # second over first spread of points, below which a turn about them is open


class RegistrationFailed(ArmBrachyError):
    """Landmarks that leave the rotation open."""


@dataclass(frozen=True)
class Registration:
    """X_WM, tracker frame M to world W, from k landmarks.

    R_WM : (3, 3);  p_WM : (3,) [m];  names : k landmarks that it was fitted to
    residual : (k,) [m] distance of each from its place;  rejected : names that were left out
    centre : (3,) [m] in W, the weighted middle of the landmarks
    covariance : (6, 6) of the error in W: rotation vector [rad] about `centre`, translation [m]
    """

    R_WM: np.ndarray
    p_WM: np.ndarray
    names: tuple
    residual: np.ndarray
    centre: np.ndarray
    covariance: np.ndarray
    rejected: tuple = ()

    @property
    def rms(self):
        """Root mean square residual [m]."""
        return float(np.sqrt(np.mean(self.residual**2)))

    def apply(self, points):
        """Take points (..., 3) [m] from M to W."""
        return points @ self.R_WM.T + self.p_WM

    def covariance_about(self, point):
        """The covariance (6, 6) with the rotation about another point (3,) [m] of W.

        The error moves x by dt + w x (x - centre) = (dt + w x (point - centre)) + w x (x - point).
        """
        shift = np.eye(6)
        shift[3:, :3] = -cross_matrix(np.asarray(point) - self.centre)
        return shift @ self.covariance @ shift.T


def cross_matrix(a):
    """(3, 3) with cross_matrix(a) @ b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def register(names, p_M, p_W, sd):
    """Least-squares rotation and translation of k landmarks, weights 1 / sd^2.

    names : k;  p_M, p_W : (k, 3) [m] as the tracker has them and where they are
    sd : (k,) [m] per axis, of the difference of the two, independent between landmarks
    Returns Registration. Raises RegistrationFailed for fewer than three or on one line.
    To first order in the error: valid while sd is small beside the spread of the landmarks.
    Source: Kabsch, Acta Cryst. A32 (1976) 922; Umeyama, IEEE Trans. PAMI 13 (1991) 376;
    covariance from the normal equations.  Test: estimation/test_registration.py
    """
    p_M, p_W = np.asarray(p_M, dtype=float), np.asarray(p_W, dtype=float)
    weight = 1.0 / np.asarray(sd, dtype=float)**2
    if len(p_M) < FEWEST:
        raise RegistrationFailed(f'{len(p_M)} landmarks ({", ".join(names)}); a registration '
                                 f'needs {FEWEST}')
    centre_M, centre_W = (weight @ p / weight.sum() for p in (p_M, p_W))
    U, spread, Vt = np.linalg.svd(((p_W - centre_W) * weight[:, None]).T @ (p_M - centre_M))
    if spread[1] <= _ON_A_LINE**2 * spread[0]:
        raise RegistrationFailed(f'{len(p_M)} landmarks ({", ".join(names)}) on one line; a '
                                 'registration needs three that are not')
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    R = U @ flip @ Vt
    p = centre_W - R @ centre_M
    residual = np.linalg.norm(p_M @ R.T + p - p_W, axis=1)
    return Registration(R, p, tuple(names), residual, centre_W,
                        _covariance(p_W - centre_W, weight))


def _covariance(arms, weight):
    """Inverse (6, 6) of the normal matrix for arms (k, 3) [m] about their weighted middle.

    There rotation and translation are uncorrelated.
    """
    lengths = np.einsum('k,ki,ki->', weight, arms, arms)
    turn = lengths * np.eye(3) - np.einsum('k,ki,kj->ij', weight, arms, arms)
    out = np.zeros((6, 6))
    out[:3, :3] = np.linalg.inv(turn)
    out[3:, 3:] = np.eye(3) / weight.sum()
    return out


def register_soundly(names, p_M, p_W, sd, odd):
    """`register`, without landmarks that the others contradict.

    odd : a landmark further than this many sd from where the others put it is left out, the worst
        first, as long as three others agree on where the tracker is
    Returns Registration, `rejected` filled in. Raises RegistrationFailed.
    """
    names, p_M, p_W, sd = np.array(names), np.asarray(p_M), np.asarray(p_W), np.asarray(sd)
    kept = np.arange(len(names))
    while True:
        fit = register(names[kept], p_M[kept], p_W[kept], sd[kept])
        worst = _contradicted(kept, p_M, p_W, sd, odd) if len(kept) > FEWEST else None
        if worst is None:
            out = tuple(n for i, n in enumerate(names) if i not in kept)
            return Registration(fit.R_WM, fit.p_WM, tuple(fit.names), fit.residual, fit.centre,
                                fit.covariance, out)
        kept = kept[kept != worst]


def _contradicted(kept, p_M, p_W, sd, odd):
    """The landmark whose absence makes the others agree best, if it is off by `odd` sd then."""
    best, found = np.inf, None
    for i in kept:
        others = kept[kept != i]
        try:
            fit = register(others, p_M[others], p_W[others], sd[others])
        except RegistrationFailed:
            continue
        misfit = float(np.sum((fit.residual / sd[others])**2))
        off = np.linalg.norm(fit.apply(p_M[i]) - p_W[i]) / sd[i]
        if misfit < best:
            best, found = misfit, (i if off > odd else None)
    return found
