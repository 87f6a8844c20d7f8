"""The arm and its probe as surfaces to draw: tubes between joints, a box at the end.

PyBullet's software renderer shows cylinders of a URDF by their end caps alone; meshes it shows
whole.
"""

import numpy as np

from arm_brachy.robot.rigid_body import frames

_SIDES = 16                                   # of a tube
_LINK, _WRIST = 0.055, 0.045                  # m, radii of the covers
_FACE = np.array([0.024, 0.008])              # m, half length and half width of the probe's face
_ELBOW = 4                                    # links before the forearm
_BODY = 0.1                                   # m of the probe's own housing
_WHITE, _GREY, _BLUE = (0.93, 0.93, 0.95, 1.0), (0.45, 0.47, 0.5, 1.0), (0.25, 0.45, 0.75, 1.0)
_BOX = np.array([[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3],
                 [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]])


def tube(a, b, radius):
    """Return (x (n, 3), triangles (k, 3)) of a closed tube from a (3,) to b (3,), outward."""
    u = (b - a) / np.linalg.norm(b - a)
    v = np.cross(u, np.eye(3)[np.abs(u).argmin()])
    v /= np.linalg.norm(v)
    turn = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    ring = radius * (np.cos(turn)[:, None] * v + np.sin(turn)[:, None] * np.cross(u, v))
    x = np.vstack([a + ring, b + ring, a, b])
    i, j, n = np.arange(_SIDES), (np.arange(_SIDES) + 1) % _SIDES, _SIDES
    sides = np.vstack([np.column_stack([i, j, n + i]), np.column_stack([j, n + j, n + i])])
    caps = np.vstack([np.column_stack([j, i, np.full(n, 2 * n)]),
                      np.column_stack([n + i, n + j, np.full(n, 2 * n + 1)])])
    return x, np.vstack([sides, caps])


def arm_surfaces(arm, q):
    """Return a list of (x, triangles, colour) of the arm at joint angles q (7,), base frame."""
    R, p = frames(arm.dh, np.asarray(q, dtype=float))
    points = [np.zeros(3), *p]
    out = []
    for k, (a, b) in enumerate(zip(points[:-1], points[1:], strict=True)):
        if np.linalg.norm(b - a) > _LINK:
            out.append((*tube(a, b, _LINK if k < _ELBOW else _WRIST), _WHITE))
    tip = p[-1] + R[-1] @ arm.tip
    neck = tip - _BODY * R[-1, :, 2]
    out.append((*tube(p[-1], neck, _WRIST), _GREY))
    corners = np.array([[x, y, z] for z in (0.0, _BODY) for y in (-1, 1) for x in (-1, 1)])
    corners[:, :2] *= _FACE
    out.append((neck + corners @ R[-1].T, _BOX, _BLUE))
    return out
