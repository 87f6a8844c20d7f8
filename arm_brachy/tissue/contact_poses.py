"""Poses of rigid bodies: X_WB (4, 4), homogeneous, from the body's frame to the world, metres."""

import numpy as np
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import ConfigError, InputError


def placed(point, direction):
    """Return the pose X_WB (4, 4) with the origin at `point` and z along `direction`.

    point : (3,) [m];  direction : (3,) into the tissue, any length. The turn about z is the one
    that takes world z (or x, if that is parallel) into the body's x-z plane.
    Raises ConfigError for a direction without length.
    """
    z = np.array(direction, dtype=float)
    if not np.linalg.norm(z) > 0.0:
        raise ConfigError(f'direction = {list(direction)}; must have a length')
    z /= np.linalg.norm(z)
    hint = np.eye(3)[2] if abs(z[2]) < 0.9 else np.eye(3)[0]
    y = np.cross(z, hint)
    y /= np.linalg.norm(y)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = np.column_stack([np.cross(y, z), y, z]), point
    return X


def moved(X_WB, displacement):
    """Return the poses X_WB (b, 4, 4) translated by `displacement` (b, 3) [m]."""
    out = np.array(X_WB, dtype=float)
    out[:, :3, 3] += displacement
    return out


def between(start, goal, t):
    """Return the poses (b, 4, 4) the fraction t of the way: straight line, turn about one axis.

    start, goal : (b, 4, 4);  t : from 0 to 1
    """
    if t == 1.0:
        return goal
    out = start.copy()
    out[:, :3, 3] += t * (goal[:, :3, 3] - start[:, :3, 3])
    turn = Rotation.from_matrix(goal[:, :3, :3] @ np.swapaxes(start[:, :3, :3], 1, 2))
    out[:, :3, :3] = Rotation.from_rotvec(t * turn.as_rotvec()).as_matrix() @ start[:, :3, :3]
    return out


def carried(x, start, goal):
    """Return where points x (n, 3) [m] go if fixed to a body that moves.

    start, goal : (4, 4) its poses
    """
    return (x - start[:3, 3]) @ start[:3, :3] @ goal[:3, :3].T + goal[:3, 3]


def tilted(direction, up, side):
    """Return a push direction (3,), a unit vector, turned by angles [rad] up and to the side.

    Up is the direction across it that is nearest to world z (to x for one along z), `placed`.
    """
    e_u, e_s = placed(np.zeros(3), direction)[:3, :2].T
    new = direction + np.tan(up) * e_u + np.tan(side) * e_s
    return new / np.linalg.norm(new)


def ridden(points, before, after):
    """Return where points (n, 3) [m] go that are fixed to a pad which is moved at rest.

    before, after : (centre (3,) [m], push direction (3,)), unit vectors, of the pad: its centre
        takes them along, and they turn about it as the push does, by the smallest turn that takes
        one direction to the other, as a bracket does that is tilted
    """
    (centre, old), (there, new) = before, after
    arm, axis = points - centre, np.cross(old, new)
    once = np.cross(axis, arm)
    return there + arm + once + np.cross(axis, once) / (1.0 + np.dot(old, new))


def checked_poses(X_WB, pairs):
    """Return X_WB as a float array (b, 4, 4), one rigid pose per ContactPair.

    Raises InputError naming the body whose pose has another shape, is not finite or not rigid.
    """
    X = np.array(X_WB, dtype=float)
    if X.shape != (len(pairs), 4, 4) or not np.isfinite(X).all():
        raise InputError(f'X_WB has shape {X.shape} or is not finite; must be '
                         f'({len(pairs)}, 4, 4) finite poses, one for each of '
                         f'{", ".join(pair.name for pair in pairs)}')
    R = X[:, :3, :3]
    off = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    bad = np.flatnonzero((off > 1e-9) | (np.linalg.det(R) < 0.0)
                         | (X[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1))
    if len(bad):
        raise InputError(f'X_WB of {pairs[bad[0]].name} is not rigid; must be a rotation and a '
                         'translation [m], last row 0 0 0 1')
    return X
