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
    The nodes of each cell of a grid are drawn as the one nearest to their mean; what then has two
    corners in one cell is left out. The grid is the finest, in steps of 15 %, that leaves few
    enough. Returns ThinSurface. Valid for looking at: thin parts may close.
    Source: Rossignac and Borrel 1993, multi-resolution 3D approximations, vertex clustering.
    """
    used = np.unique(triangles)
    if len(triangles) <= most:
        return ThinSurface(used, np.searchsorted(used, triangles), rest[used])
    corners = rest[triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    spacing = edges.mean()
    while True:
        thin = _clustered(rest, triangles, used, spacing)
        if len(thin.triangles) <= most:
            return thin
        spacing *= _GROWTH


def _clustered(rest, triangles, used, spacing):
    points = rest[used]
    cell = np.floor((points - points.min(axis=0)) / spacing).astype(int)
    _, group = np.unique(cell, axis=0, return_inverse=True)
    group = group.ravel()
    count = np.bincount(group)
    mean = np.column_stack([np.bincount(group, column) for column in points.T]) / count[:, None]
    away = np.linalg.norm(points - mean[group], axis=1)
    order = np.lexsort((away, group))
    chosen = used[order[np.searchsorted(group[order], np.arange(len(count)))]]
    drawn = group[np.searchsorted(used, triangles)]
    drawn = drawn[(drawn != np.roll(drawn, 1, axis=1)).all(axis=1)]
    _, first = np.unique(np.sort(drawn, axis=1), axis=0, return_index=True)
    return ThinSurface(chosen, drawn[np.sort(first)], rest[chosen])
