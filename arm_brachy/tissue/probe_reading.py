"""What a probe that touches tissue would report if it had a sensor for everything."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.tissue import dense


@dataclass(frozen=True)
class ProbeReading:
    """Contact of the probe at one instant, world axes, moments about the middle of its face.

    wrench : (6,) force [N] and moment [N m] of the tissue on the probe
    stiffness : (6, 6) the wrench falls by stiffness times a small translation [m] and rotation
        vector [rad] of the probe; of the step that just ended, with its friction
    area : [m^2] of the tissue that touches, measured at rest
    pressure : (s,) [Pa] mean over equal strips of the face, along the elements from -x to +x
    """

    wrench: np.ndarray
    stiffness: np.ndarray
    area: float
    pressure: np.ndarray


def untouched(face):
    """Return the ProbeReading of a ProbeFace that touches nothing: exactly zero."""
    return ProbeReading(np.zeros(6), np.zeros((6, 6)), 0.0, np.zeros(face.strips))


def read(face, patch, y, q, H):
    """Return the ProbeReading of a balanced ProbePatch.

    face : ProbeFace;  y, q, H : as `ProbePatch.balanced` has them
    """
    force = patch.points.pressure * patch.weights
    return ProbeReading(wrench(y - patch.c, q), _stiffness(patch, y, q, H),
                        float(patch.weights[patch.points.pressure > 0.0].sum()),
                        _profile(face, patch.points.position[..., 0], force))


def wrench(arms, forces):
    """Return force and moment (6,) of nodal forces (k, 3) [N] at arms (k, 3) [m]."""
    return np.concatenate([forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)])


def _stiffness(patch, y, q, H):
    """- d wrench / d pose.

    A motion (v, w) of the probe moves it against the nodes by J (v, w) = v + w x (y - c) and turns
    what it exerts: dq = (I + K_c H)^-1 (w x q - K_c J), dy = -H dq.
    """
    K, arms = patch.derivative(y), y - patch.c
    J = np.concatenate([np.tile(np.eye(3), (len(y), 1, 1)), -_cross(arms)], axis=2)
    turned = np.concatenate([np.zeros((len(y), 3, 3)), -_cross(q)], axis=2)
    pull = turned.reshape(-1, 6) - dense.product(K, np.ascontiguousarray(J.reshape(-1, 6)))
    dq = dense.solve(np.eye(len(K)) + dense.product(K, H), pull)
    dy = -dense.product(H, dq).reshape(-1, 3, 6)
    dy[:, :, :3] -= np.eye(3)
    dq = dq.reshape(-1, 3, 6)
    moment = (np.einsum('kij,kjm->im', _cross(arms), dq)
              - np.einsum('kij,kjm->im', _cross(q), dy))
    return -np.vstack([dq.sum(axis=0), moment])


def _cross(v):
    """Matrices (k, 3, 3) with V a = v x a."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - np.swapaxes(out, 1, 2)


def _profile(face, along, force):
    """Mean pressure (s,) [Pa] of points at `along` [m] that bear `force` [N]."""
    strip = np.floor((along / face.width + 0.5) * face.strips).astype(int)
    load = np.bincount(np.clip(strip, 0, face.strips - 1).ravel(), force.ravel(),
                       minlength=face.strips)
    return load * face.strips / (face.width * face.thickness)
