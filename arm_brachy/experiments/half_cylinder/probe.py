"""Values at points of a body of curved tetrahedra.  Test: half_cylinder/test_elements.py"""

import numpy as np
from scipy.sparse import csr_matrix

from arm_brachy.experiments.half_cylinder.shapes import slopes, values

TRIED = 40          # tetrahedra whose middles are nearest to a point
STEPS = 12          # of Newton's method for its local coordinates


def probe(nodes, tets, points):
    """Matrix (k, n) from values at nodes (n, 3) of tetrahedra (e, 10) to values at points (k, 3).

    A point that lies in none, as on a surface that the tetrahedra bend to, is taken from the one
    that it is least outside of.
    """
    middles = nodes[tets[:, :4]].mean(axis=1)
    rows = [_row(nodes, tets, np.argsort(((middles - point) ** 2).sum(axis=1))[:TRIED], point)
            for point in points]
    columns, weights = (np.concatenate(some) for some in zip(*rows, strict=True))
    at = np.repeat(np.arange(len(points)), tets.shape[1])
    return csr_matrix((weights, (at, columns)), shape=(len(points), len(nodes)))


def _row(nodes, tets, near, point):
    """Nodes (10,) and their weights (10,) at one point (3,)."""
    local = np.array([_local(nodes[tets[e]], point) for e in near])
    outside = -np.minimum(local.min(axis=1), 1.0 - local.sum(axis=1))
    best = np.argmin(np.maximum(outside, 0.0))
    return tets[near[best]], values(local[best:best + 1])[0]


def _local(nodes, point):
    """Local coordinates (3,) of a point in the tetrahedron with nodes (10, 3)."""
    at = np.full((1, 3), 0.25)
    for _ in range(STEPS):
        off = values(at)[0] @ nodes - point
        at = at - np.linalg.solve(nodes.T @ slopes(at)[0], off)
    return at[0]
