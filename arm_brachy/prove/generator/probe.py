"""Displacement at any point of the body, by the shape functions of the element that holds it."""
from dataclasses import dataclass

import numpy as np

from arm_brachy.prove.generator.elements import BARYCENTRIC, shapes, slopes


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
    it is least outside of.  Raises ValueError beyond 4 % of its height.
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
            raise ValueError(f'point {point} m is outside of the body')
        nodes.append(tets[near[best]])
        weights.append(shapes(bary[best]))
    return Probes(np.array(nodes), np.array(weights))


def invert(point, corners, steps=12):
    """Barycentric coordinates (k, 4) of a point in curved elements with nodes (k, 10, 3)."""
    bary = np.full((len(corners), 4), 0.25)
    for _ in range(steps):
        miss = point - np.einsum('ka,kai->ki', shapes(bary), corners)
        jac = np.einsum('kai,kaj->kij', corners, slopes(bary))
        step = np.linalg.solve(jac + 1e-12 * np.eye(3), miss[:, :, None])[:, :, 0]
        bary = np.clip(bary + step @ BARYCENTRIC.T, -1, 2)
    return bary
