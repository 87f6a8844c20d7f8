"""A surface with few triangles whose corners are nodes of a mesh, to follow what the nodes do."""

from dataclasses import dataclass

import numpy as np

_GROWTH = 1.15     # of the spacing from one try to the next


@dataclass(frozen=True)
class ThinSurface:
    """Triangles (f, 3) over nodes (k,) of a mesh, and where these are at rest (k, 3) [m]."""

    nodes: np.ndarray
    triangles: np.ndarray
    rest: np.ndarray

    def shape(self, x):
        """Return corners (k, 3) [m] and displacement (k,) [m] with the mesh's nodes at x (n, 3).

        Raises IndexError if x has fewer nodes than the mesh.
        """
        now = x[self.nodes]
        return now, np.linalg.norm(now - self.rest, axis=1)


def thinned(rest, triangles, most):
    """Draw a surface with at most `most` triangles.

    rest : (n, 3) [m] nodes of the mesh at rest;  triangles : (s, 3) outward
    The nodes of each cell of a grid are drawn as one of them, the sharpest, among equals that
    nearest to their mean; what then has two corners in one cell is left out. The grid is the
    finest, in steps of 15 %, that leaves few enough.
    Returns ThinSurface. Valid for looking at: thin parts may close.
    Source: Rossignac and Borrel 1993, multi-resolution 3D approximations, vertex clustering.
    """
    used = np.unique(triangles)
    if len(triangles) <= most:
        return ThinSurface(used, np.searchsorted(used, triangles), rest[used])
    corners = rest[triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    spacing, sharp = edges.mean(), _sharpness(rest, triangles)[used]
    while True:
        thin = _clustered(rest, triangles, used, sharp, spacing)
        if len(thin.triangles) <= most:
            return thin
        spacing *= _GROWTH


def _sharpness(rest, triangles):
    """(n,) of each node, in tenths: 0 where the surface is flat, up to 10 on a spike."""
    corners = rest[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    count = np.bincount(triangles.ravel(), minlength=len(rest))
    mean = np.column_stack([np.bincount(triangles.ravel(), np.repeat(column, 3), len(rest))
                            for column in normal.T]) / np.maximum(count, 1)[:, None]
    return np.round(10.0 * (1.0 - np.linalg.norm(mean, axis=1))).astype(int)


def _clustered(rest, triangles, used, sharp, spacing):
    points = rest[used]
    cell = np.floor((points - points.min(axis=0)) / spacing).astype(int)
    _, group = np.unique(cell, axis=0, return_inverse=True)
    group = group.ravel()
    count = np.bincount(group)
    mean = np.column_stack([np.bincount(group, column) for column in points.T]) / count[:, None]
    away = np.linalg.norm(points - mean[group], axis=1)
    order = np.lexsort((away, -sharp, group))
    chosen = used[order[np.searchsorted(group[order], np.arange(len(count)))]]
    drawn = group[np.searchsorted(used, triangles)]
    drawn = drawn[(drawn != np.roll(drawn, 1, axis=1)).all(axis=1)]
    _, first = np.unique(np.sort(drawn, axis=1), axis=0, return_index=True)
    return ThinSurface(chosen, drawn[np.sort(first)], rest[chosen])
