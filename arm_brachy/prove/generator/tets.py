"""Corners and tetrahedra of the half-ball, and what can be done to them."""
import numpy as np
from scipy.sparse import coo_matrix
from skfem import MeshTet

EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])


def half_ball(levels, turn):
    """Corners (n, 3) and tetrahedra (m, 4) of the half-ball: four octants refined `levels` times.

    Each octant has one face on the sphere, so no tetrahedron is flattened by rounding it.
    turn : angle of the octants about z [rad]
    """
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1.0]])
    tets = np.array([[0, i, i % 4 + 1, 5] for i in range(1, 5)])
    mesh = MeshTet(np.ascontiguousarray(points.T), np.ascontiguousarray(tets.T)).refined(levels)
    p = mesh.p.T
    size = np.linalg.norm(p, axis=1, keepdims=True)
    p = p * np.abs(p).sum(1, keepdims=True) / np.where(size == 0, 1, size)
    c, s = np.cos(turn), np.sin(turn)
    return p @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), mesh.t.T


def boundary(tets):
    """Faces (f, 3) of tetrahedra (m, 4) that only one of them has, and their owners (f,)."""
    faces = tets[:, FACES].reshape(-1, 3)
    key = np.sort(faces, 1)
    _, first, count = np.unique(key, axis=0, return_index=True, return_counts=True)
    once = np.sort(first[count == 1])
    return faces[once], once // 4


def orient(points, tets):
    """Same tetrahedra (m, 4), all of positive volume."""
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    negative = np.einsum('ij,ij->i', np.cross(b - a, c - a), d - a) < 0
    tets = tets.copy()
    tets[negative, :2] = tets[negative, 1::-1]
    return tets


def curved_faces(p, tets):
    """Boundary faces (f, 3) on the sphere (not in the base plane) and their owners (f,)."""
    faces, owners = boundary(tets)
    dome = ~(np.abs(p[faces][:, :, 2]) < 1e-9).all(1)
    return faces[dome], owners[dome]


def edge_keys(edges, n):
    """One number (k,) for each edge (k, 2) between n nodes, whichever way it points."""
    edges = np.sort(edges, 1)
    return edges[:, 0] * n + edges[:, 1]


def split(p, tets, edges, points):
    """Break `edges` (k, 2) at `points` (k, 3), save those that share a tetrahedron with another.

    Of edges that share one, the first goes now; call again for the others.
    """
    keys = edge_keys(tets[:, EDGES].reshape(-1, 2), len(p)).reshape(-1, 6)
    rank = {key: i for i, key in enumerate(edge_keys(edges, len(p)))}
    order = np.array([[rank.get(key, len(edges)) for key in row] for row in keys])
    first = order.min(1)
    # An edge is halved now if in each of its tetrahedra it comes first.
    blocked = np.zeros(len(edges) + 1, bool)
    blocked[order[order > first[:, None]]] = True
    blocked[-1] = True
    chosen = ~blocked[first]
    new = np.cumsum(~blocked[:-1]) - 1 + len(p)
    a, b = edges[first[chosen]].T
    mid = new[first[chosen]]
    one, two = tets[chosen].copy(), tets[chosen].copy()
    one[one == b[:, None]] = np.repeat(mid, (one == b[:, None]).sum(1))
    two[two == a[:, None]] = np.repeat(mid, (two == a[:, None]).sum(1))
    return np.vstack([p, points[~blocked[:-1]]]), np.vstack([tets[~chosen], one, two])


def quality(x, tets):
    """Shape of tetrahedra (m,), 1 for a regular one, 0 or less for a flat or inverted one."""
    edge = x[tets[:, EDGES[:, 0]]] - x[tets[:, EDGES[:, 1]]]
    mean = np.einsum('mij,mij->m', edge, edge) / 6
    a, b, c, d = (x[tets[:, i]] for i in range(4))
    volume = np.einsum('ij,ij->i', np.cross(b - a, c - a), d - a) / 6
    return 6 * np.sqrt(2) * volume / mean**1.5


def smooth(p, tets, fixed, on_sphere, passes=6):
    """Move corners to the mean of their neighbours where that spoils no tetrahedron.

    fixed (n,) bool: stays; on_sphere (n,) bool: averaged with others on the sphere only, and
    kept on it.
    """
    i, j = tets[:, EDGES].reshape(-1, 2).T
    for _ in range(passes):
        weights = coo_matrix((np.ones(2 * len(i)), (np.r_[i, j], np.r_[j, i])),
                             (len(p), len(p))).tocsr()
        weights.data[:] = 1
        sphere = weights.multiply(on_sphere[None, :]).tocsr()
        mean = (weights @ p) / weights.sum(1)
        shell = (sphere @ p)[on_sphere] / sphere.sum(1)[on_sphere]
        mean[on_sphere] = shell / np.linalg.norm(shell, axis=1, keepdims=True)
        trial = np.where(fixed[:, None], p, p + 0.5 * (mean - p))
        trial[on_sphere] /= np.linalg.norm(trial[on_sphere], axis=1, keepdims=True)
        before, after = quality(p, tets), quality(trial, tets)
        worse = (after < 0.25) & (after < before)
        while worse.any():
            trial[np.unique(tets[worse])] = p[np.unique(tets[worse])]
            after = quality(trial, tets)
            worse = (after < 0.25) & (after < before)
        p = trial
    return p
