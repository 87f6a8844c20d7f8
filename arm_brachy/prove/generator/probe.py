"""Displacement at any point of the body, by the shape functions of the element that holds it."""
from dataclasses import dataclass

import numpy as np

from arm_brachy.prove.generator.elements import shapes, slopes
from arm_brachy.prove.generator.solver import NotSolved


@dataclass(frozen=True)
class Probes:
    """Nodes (k, 10) and weights (k, 10) by which values at nodes give those at k points."""

    nodes: np.ndarray
    weights: np.ndarray

    def read(self, u):
        """Values (k, 3) at the points of nodal values u (n, 3)."""
        return np.einsum('ka,kai->ki', self.weights, u[self.nodes])


def locate(points, x, tets):
    """`Probes` of `points` (k, 3) [m] in a body with nodes x (n, 3) and `tets` (m, 10).

    A point on the curved surface may lie a hair outside of all elements: then that counts which
    it is least outside of.  Raises NotSolved beyond 4 % of its height.
    """
    low, high = x[tets].min(1), x[tets].max(1)
    room = 0.2 * (high - low)
    nodes, weights = [], []
    for point in np.asarray(points):
        near = np.flatnonzero(((point > low - room) & (point < high + room)).all(1))
        bary = invert(point, x[tets[near]])
        miss = point - np.einsum('ka,kai->ki', shapes(bary), x[tets[near]])
        found = np.linalg.norm(miss, axis=1) < 1e-6
        inside = np.where(found, bary.min(1), -np.inf)
        best = int(np.argmax(inside))
        if inside[best] < -0.04:
            raise NotSolved(f'point {point} m is outside of the mesh')
        nodes.append(tets[near[best]])
        weights.append(shapes(bary[best]))
    return Probes(np.array(nodes), np.array(weights))


def invert(point, corners, steps=12):
    """Barycentric coordinates (k, 4), of sum 1, of a point in curved elements (k, 10, 3).

    Where they have not been found after `steps`, the point is not at them.
    """
    bary = np.full((len(corners), 4), 0.25)
    for _ in range(steps):
        miss = point - np.einsum('ka,kai->ki', shapes(bary), corners)
        jac = np.einsum('kai,kaj->kij', corners, slopes(bary))
        step = np.linalg.solve(jac + 1e-12 * np.eye(3), miss[:, :, None])[:, :, 0]
        free = np.clip(bary[:, 1:] + step, -1, 2)
        # The first follows: shapes of coordinates of another sum are at the point as well, and
        # read values wrongly.
        bary = np.column_stack([1 - free.sum(1), free])
    return bary
