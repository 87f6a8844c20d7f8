"""Shape functions of tetrahedra with 10 nodes and triangles with 6, and where they are summed.

Corners first, then the middles of mesh.EDGES and mesh.FACE_EDGES. With l the barycentric
coordinates, a corner has l (2 l - 1), the middle between two corners 4 l m.
Test: experiments/half_cylinder/test_elements.py
"""

import numpy as np

from arm_brachy.experiments.half_cylinder.mesh import EDGES, FACE_EDGES

_A, _B = (5.0 + 3.0 * np.sqrt(5.0)) / 20.0, (5.0 - np.sqrt(5.0)) / 20.0
# Four points in a tetrahedron, exact for squares; each stands for a 24th of a unit cube.
POINTS = np.array([[_B, _B, _B], [_A, _B, _B], [_B, _A, _B], [_B, _B, _A]])
WEIGHT = 1.0 / 24.0
# Three in a triangle, each for a third of its area.
FACE_POINTS = np.array([[1 / 6, 1 / 6], [2 / 3, 1 / 6], [1 / 6, 2 / 3]])


def values(points, edges=EDGES):
    """Shape functions (k, nodes) at local points (k, 3), or (k, 2) of triangles."""
    l = _barycentric(points)
    first, second = np.transpose(edges)
    return np.hstack([l * (2.0 * l - 1.0), 4.0 * l[:, first] * l[:, second]])


def slopes(points, edges=EDGES):
    """Their derivatives (k, nodes, 3) by the local coordinates; (k, nodes, 2) of triangles."""
    l, d = _barycentric(points), _barycentric_slopes(points.shape[1])
    first, second = np.transpose(edges)
    middle = l[:, first, None] * d[second] + l[:, second, None] * d[first]
    return np.concatenate([(4.0 * l - 1.0)[..., None] * d, 4.0 * middle], axis=1)


def face_values():
    """Shape functions (3, 6) of a triangle at FACE_POINTS."""
    return values(FACE_POINTS, FACE_EDGES)


def face_areas(nodes):
    """Area [m^2] that each of FACE_POINTS stands for, (f, 3), of triangles' nodes (f, 6, 3)."""
    along = np.einsum('qac,fai->fqci', slopes(FACE_POINTS, FACE_EDGES), nodes)
    return np.linalg.norm(np.cross(along[:, :, 0], along[:, :, 1]), axis=-1) / 6.0


def _barycentric(points):
    return np.hstack([1.0 - points.sum(axis=1, keepdims=True), points])


def _barycentric_slopes(dimension):
    return np.vstack([-np.ones(dimension), np.eye(dimension)])
