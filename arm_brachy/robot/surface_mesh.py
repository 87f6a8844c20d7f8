"""A skin surface that a model tells: the triangles of a mesh that deforms.

The face of `surface_scan.ScannedSurface`, for the nodes of an estimated mesh in place of a cloud:
so the probe's path is planned on the deformed body.
"""

import numpy as np

from arm_brachy.core.errors import InputError

_PARALLEL = 1e-12    # m2, twice a triangle's area along the line, below which it is seen edge-on


class MeshSurface:
    """Closed surface of triangles, outward. World frame [m]."""

    def __init__(self, x, triangles):
        """x : (n, 3) nodes;  triangles : (k, 3) indices into them."""
        a, b, c = (np.asarray(x)[triangles[:, k]] for k in range(3))
        self._a, self._ab, self._ac = a, b - a, c - a
        self._cross = np.cross(self._ab, self._ac)
        self._middle = (a + b + c) / 3.0
        self._unit = self._cross / np.linalg.norm(self._cross, axis=1, keepdims=True)

    def normal(self, x):
        """Return the outward unit normal (3,) at a point (3,) on the skin.

        The mean of the nearest triangles' normals, by the inverse of their distance: smoother
        than that of one facet.
        """
        distance = np.linalg.norm(self._middle - x, axis=1)
        near = np.argpartition(distance, _NEIGHBOURS)[:_NEIGHBOURS]
        n = (self._unit[near] / (distance[near, None] + _LEAST)).sum(axis=0)
        return n / np.linalg.norm(n)

    def distance(self, x):
        """Return how far the nearest triangle's middle is from a point (3,) [m]."""
        return float(np.linalg.norm(self._middle - x, axis=1).min())

    def intersection(self, start, direction):
        """Return where a line leaves the body (3,) [m]; several times: first where it does.

        start : (3,) [m];  direction : (3,) outward, any length. Moeller and Trumbore 1997.
        Raises InputError if the line does not leave the body.
        """
        u = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
        along = self._cross @ u
        out = np.flatnonzero(along > _PARALLEL)
        s = start - self._a[out]
        d = np.cross(s, u)
        beta = -np.einsum('ij,ij->i', self._ac[out], d) / along[out]
        gamma = np.einsum('ij,ij->i', self._ab[out], d) / along[out]
        t = -np.einsum('ij,ij->i', s, self._cross[out]) / along[out]
        hit = (beta >= 0.0) & (gamma >= 0.0) & (beta + gamma <= 1.0) & (t > 0.0)
        if not hit.any():
            place = ', '.join(f'{1e3 * c:.1f}' for c in start)
            raise InputError(f'surface mesh: the line from ({place}) mm does not leave the body; '
                             'move the probe towards the needle')
        return start + t[hit].min() * u


_NEIGHBOURS = 12     # triangles of a normal: about two rings
_LEAST = 1e-4        # m, added to distances
