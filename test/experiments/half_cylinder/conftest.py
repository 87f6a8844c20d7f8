"""A few tetrahedra, and a made-up half-cylinder for the tests that need no solution."""

import numpy as np
import pytest

from arm_brachy.experiments.half_cylinder.layout import DIRECTIONS, PADS, POINTS
from arm_brachy.experiments.half_cylinder.mesh import with_middles
from arm_brachy.experiments.half_cylinder.protocol import RAYS
from arm_brachy.experiments.ray import Ray

SIDE, NEAR = 0.03, 1e-9     # m
SHARE = np.array((0.0, 1 / 3, 2 / 3, 1.0))
# A cube of one cell in six tetrahedra around its diagonal: ways from corner 000 to corner 111.
WAYS = np.array([(4, 2, 1), (4, 1, 2), (2, 4, 1), (2, 1, 4), (1, 4, 2), (1, 2, 4)])


def _cube(cells):
    """Corners ((cells + 1)^3, 3) [m] and tetrahedra (6 cells^3, 4) of a cube of SIDE [m]."""
    grid = np.stack(np.meshgrid(*[np.arange(cells + 1)] * 3, indexing='ij'), axis=-1)
    corner = grid[:-1, :-1, :-1].reshape(-1, 1, 1, 3)
    bits = np.cumsum(np.hstack([np.zeros((6, 1), int), WAYS]), axis=1)
    steps = np.stack([bits >> 2 & 1, bits >> 1 & 1, bits & 1], axis=-1)
    at = corner + steps[None]
    tets = at @ np.array([(cells + 1) ** 2, cells + 1, 1])
    corners, tets = SIDE / cells * grid.reshape(-1, 3), tets.reshape(-1, 4)
    turned = np.linalg.det(corners[tets[:, 1:]] - corners[tets[:, :1]]) < 0.0
    tets[turned] = tets[turned][:, [0, 2, 1, 3]]
    return corners, tets


@pytest.fixture(scope='session')
def cube():
    """(cells along a side, bend [m]) -> mesh.Mesh; middles of edges inside off by up to `bend`."""
    def made(cells, bend=0.0):
        corners, tets = _cube(cells)
        faces = tets[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]].reshape(-1, 3)
        low = faces[(corners[faces, 2] < NEAR).all(axis=1)]
        mesh = with_middles(corners, tets, {'base': low}, np.zeros(len(tets), bool))
        inner = np.all((mesh.nodes > NEAR) & (mesh.nodes < SIDE - NEAR), axis=1)
        inner[:len(corners)] = False
        mesh.nodes[inner] += np.random.default_rng(5).uniform(-bend, bend, (inner.sum(), 3))
        return mesh
    return made


@pytest.fixture(scope='session')
def rays():
    """Name -> Ray: points follow the pads in part, forces are springs of 200 N/m."""
    centres = np.array([pad.centre for pad in PADS])
    near = np.exp(-np.linalg.norm(POINTS[:, None] - centres, axis=-1) / SIDE)
    out = {}
    for name, full in RAYS.items():
        q = np.outer(SHARE, full)
        u = np.einsum('kp,np,pi->kni', q, near, DIRECTIONS)
        out[name] = Ray(np.array(full), SHARE, u, -200.0 * q[:, :, None] * DIRECTIONS)
    return out
