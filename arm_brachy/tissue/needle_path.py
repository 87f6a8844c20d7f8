"""Where a needle whose path is given meets the tissue as it is deformed now."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from arm_brachy.core.errors import InputError
from arm_brachy.tissue.mesh import embed

SPOTS = 12      # along the inserted length, where friction is handed to the tissue
SHORTEST = 1e-9  # m of needle out of the template below which it has no direction
GRAZING = 1e-12  # sine of the angle below which a line runs along a face


@dataclass(frozen=True)
class NeedleInTissue:
    """A needle: points (k, 3) [m] of its shaft, template first, tip last, at equal distances.

    depth : [m] length inserted from the template, along the shaft
    Raises InputError for points of another shape or not finite.
    """

    points: np.ndarray
    depth: float

    def __post_init__(self):
        points = np.asarray(self.points, dtype=float)
        if points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 2 or not (
                np.isfinite(points).all() and np.isfinite(self.depth)):
            raise InputError(f'needle: points have shape {points.shape} or are not finite; must '
                             'be (k, 3), from the template to the tip, k >= 2')

    def at(self, depth):
        """Return the needle with its tip at another depth [m]: cut, or with a straight end."""
        points = np.asarray(self.points, dtype=float)
        if depth == self.depth or _lengths(points)[-1] < SHORTEST:
            return self
        return NeedleInTissue(along(points, np.linspace(0.0, depth, len(points)))[0], depth)


@dataclass(frozen=True)
class NeedleStretch:
    """What a needle has in the tissue, work-equivalent on the nodes, as vectors (n, 3).

    A force f along the needle at the skin, the tip or evenly over the shaft puts f times the
    vector on the nodes; the product of a vector with displacements is what that part moves along
    the needle.
    inside : [m] length of shaft inside the tissue
    """

    skin: np.ndarray
    tip: np.ndarray
    shaft: np.ndarray
    inside: float


def tangents(points, otherwise):
    """Return (k, 3) unit directions of a shaft at its points (k, 3) [m], equally far apart.

    otherwise : (k, 3) unit, of a shaft too short to have a direction
    """
    if _lengths(points)[-1] < SHORTEST:
        return np.asarray(otherwise, dtype=float)
    ways = np.gradient(points, axis=0, edge_order=2 if len(points) > 2 else 1)
    return ways / np.linalg.norm(ways, axis=1, keepdims=True)


def stretch(mesh, faces, needle, x):
    """Return the NeedleStretch of a NeedleInTissue, None if it is outside.

    mesh : TetMesh;  faces : (f, 3) boundary triangles;  x : (n, 3) [m] nodes now
    Elements are taken as straight-edged to find points in them, which shifts the place where a
    force acts by what the edges are bent; the force is kept exactly.
    """
    points = np.asarray(needle.points, dtype=float)
    found = _entry(points, faces, x)
    if found is None:
        return None
    s, face, share, way = found
    depth = _lengths(points)[-1]
    at = s + (np.arange(SPOTS) + 0.5) / SPOTS * (depth - s)
    places, ways = along(points, np.append(at, depth))
    held = embed(dataclasses.replace(mesh, nodes=x), places, standoff=np.inf)
    spread = [np.zeros_like(x) for _ in range(3)]
    spread[0][faces[face]] = share[:, None] * way
    np.add.at(spread[1], held.nodes[-1], held.weights[-1][:, None] * ways[-1])
    np.add.at(spread[2], held.nodes[:-1].ravel(), (
        held.weights[:-1, :, None] * ways[:-1, None, :]).reshape(-1, 3) / SPOTS)
    return NeedleStretch(*spread, float(depth - s))


def _lengths(points):
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def along(points, at):
    """Return places (m, 3) [m] and unit directions (m, 3) of a polyline at arc lengths `at` (m,).

    points : (k, 3) [m]
    """
    lengths = _lengths(points)
    i = np.clip(np.searchsorted(lengths, at, side='right') - 1, 0, len(points) - 2)
    ways = np.diff(points, axis=0)
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), SHORTEST)
    return points[i] + (at - lengths[i])[:, None] * ways[i], ways[i]


def _entry(points, faces, x):
    """(arc length [m], face, its corners' shares (3,), direction (3,)) of the first entry.

    None for a needle that does not enter.
    """
    start, way = points[:-1], np.diff(points, axis=0)
    if np.linalg.norm(way, axis=1).sum() < SHORTEST:
        return None
    a, e, f = x[faces[:, 0]], x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]
    normal = np.cross(e, f)
    lengths = np.linalg.norm(way, axis=1)
    for i in range(len(way)):
        u, v, t, into = _crossings(start[i], way[i], a, e, f, normal)
        hit = np.flatnonzero(into & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t >= 0.0)
                             & (t <= 1.0))
        if len(hit):
            k = hit[t[hit].argmin()]
            return (lengths[:i].sum() + t[k] * lengths[i], int(k),
                    np.array([1.0 - u[k] - v[k], u[k], v[k]]), way[i] / lengths[i])
    return None


def _crossings(p, d, a, e, f, normal):
    """Where the line p + t d meets triangles a + u e + v f: (u, v, t, from outside)."""
    down = normal @ d
    into = down < -GRAZING * np.linalg.norm(normal, axis=1) * np.linalg.norm(d)
    safe = np.where(into, down, 1.0)
    t = np.einsum('ki,ki->k', normal, a - p) / safe
    r = p + t[:, None] * d - a
    area = np.einsum('ki,ki->k', normal, normal)
    u = np.einsum('ki,ki->k', np.cross(r, f), normal) / area
    v = np.einsum('ki,ki->k', np.cross(e, r), normal) / area
    return u, v, t, into
