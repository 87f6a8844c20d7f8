"""Points of the tissue's surface: where contact is evaluated, and what is known there."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import ConfigError
from arm_brachy.tissue.mesh import face_middles

# Symmetric rules on the triangle (Dunavant 1985, Int J Numer Meth Eng 21:1129), degree 2 and 4:
# barycentric coordinate that is unlike the other two, and the weight of its three points.
_DUNAVANT = {
    3: [(2.0 / 3.0, 1.0 / 3.0)],
    6: [(0.108103018168070, 0.223381589678011), (0.816847572980459, 0.109951743655322)],
}


@dataclass(frozen=True)
class SurfaceQuadrature:
    """Where on the tissue's surface contact is evaluated.

    faces : (f, a) nodes of each face, corners first
    shape : (q, a) shape functions at the points, rows sum to 1
    weights : (f, q) [m^2] rest area that each point stands for
    """

    faces: np.ndarray
    shape: np.ndarray
    weights: np.ndarray

    @property
    def spread(self):
        """No point is farther from any place than this times the farthest node of its face."""
        return float(np.abs(self.shape).sum(axis=1).max())


def surface_quadrature(mesh, faces, points=6, divisions=1):
    """Return the SurfaceQuadrature of triangles of a TetMesh, linear or quadratic.

    faces : (f, 3) corners;  points : 3 or 6 per face (exact to degree 2 or 4)
    divisions : into which each edge is divided: the rule is used on as many squared triangles, for
        bodies that are small against the faces
    Faces are flat at rest, as `mesh.quadratic_mesh` makes them.
    Raises ConfigError for another number of points.
    """
    if points not in _DUNAVANT:
        raise ConfigError(f'points = {points} per face; must be one of {sorted(_DUNAVANT)}')
    rows, weights = [], []
    for unlike, weight in _DUNAVANT[points]:
        like = (1.0 - unlike) / 2.0
        rows += [np.roll([unlike, like, like], i) for i in range(3)]
        weights += [weight] * 3
    L, nodes = np.array(rows), np.asarray(faces)
    if divisions > 1:
        L = np.concatenate([L @ corners for corners in _parts(divisions)])
        weights = weights * divisions**2
    if mesh.midside is not None:
        nodes = np.hstack([nodes, face_middles(mesh, nodes)])
        L = np.hstack([L * (2.0 * L - 1.0), 4.0 * L * np.roll(L, -1, axis=1)])
    corners = mesh.nodes[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(area, axis=1)
    return SurfaceQuadrature(np.ascontiguousarray(nodes, dtype=np.int64), L,
                             np.outer(area, np.array(weights) / np.sum(weights)))


def _parts(count):
    """Barycentric corners (3, 3) of the count^2 equal triangles that a triangle divides into."""
    def at(i, j):
        return np.array([i, j, count - i - j]) / count

    for i in range(count):
        for j in range(count - i):
            yield np.array([at(i + 1, j), at(i, j + 1), at(i, j)])
            if i + j < count - 1:
                yield np.array([at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)])


@dataclass(frozen=True)
class PointStates:
    """The surface points of one pair, vectors in the frame of the body's core.

    position : (f, q, 3) [m];  gap : (f, q) signed distance [m];  pressure : (f, q) [Pa]
    normal : (f, q, 3) outward from the body;  anchor : (f, q, 3) where the point would be without
        friction, [m];  limit : (f, q) [Pa] friction it can bear, 0 = free
    """

    position: np.ndarray
    gap: np.ndarray
    pressure: np.ndarray
    normal: np.ndarray
    anchor: np.ndarray
    limit: np.ndarray

    @property
    def slip(self):
        """(f, q, 3) [m] tangential distance from the anchor."""
        s = self.position - self.anchor
        return s - np.sum(s * self.normal, axis=-1, keepdims=True) * self.normal
