"""Ten-node tetrahedra of a dome, curved like it, with nodes on the rims of its pads."""
from dataclasses import dataclass

import numpy as np

from arm_brachy.prove.generator.elements import POINTS, slopes
from arm_brachy.prove.generator.rim import fit_rim, refine_rims, slide_to_rim
from arm_brachy.prove.generator.tets import (
    EDGES,
    boundary,
    curved_faces,
    edge_keys,
    half_ball,
    smooth,
)


@dataclass(frozen=True)
class Mesh:
    """Ten-node tetrahedra: four corners, then the midpoints of `EDGES`.

    nodes (n, 3) [m]; tets (m, 10), corners first; corners: the first so many nodes are corners;
    surface (s, 6) and base (b, 6): faces of six nodes, outward; patches: per pad, the faces
    (k, 6) bonded to it.
    """

    nodes: np.ndarray
    tets: np.ndarray
    corners: int
    surface: np.ndarray
    base: np.ndarray
    patches: tuple

    @property
    def base_nodes(self):
        """Numbers of the nodes of the base."""
        return np.unique(self.base)

    def patch_nodes(self, pad):
        """Numbers of the nodes bonded to the pad of number `pad`."""
        return np.unique(self.patches[pad])


def make_mesh(dome, pads, size=0.62, *, levels=2, reach=0.6, turn=0.0, quarter=0.25):
    """Mesh of a dome with `pads`; edges at most `size` radii at the rims, growing by 1 / reach.

    levels, turn : the coarse mesh of the half-ball, see `half_ball`.
    Edges that leave a rim have their middle node at the quarter by the rim, where the shape
    functions then hold the square root by which the displacement starts beside a bonded edge
    (Barsoum 1976, Int J Numer Methods Eng 10:25).
    """
    p, tets = refine_rims(*half_ball(levels, turn), dome.place, pads, size, reach)
    for pad in pads:
        p, tets = fit_rim(p, tets, dome.place, pad)
    faces, _ = curved_faces(p, tets)
    shell = np.zeros(len(p), bool)
    shell[np.unique(faces)] = True
    rims = rim_corners(p, shell, dome.place, pads)
    p = smooth(p, tets, (rims >= 0) | (np.abs(p[:, 2]) < 1e-9), shell)
    return quadratic(p, tets, dome.place, pads, rims, quarter)


def rim_corners(p, shell, place, pads):
    """Number of the pad whose rim each corner is on (n,); -1 for none."""
    x = place(p)
    rims = np.full(len(p), -1)
    for i, pad in enumerate(pads):
        rims[shell & (np.abs(pad.rim_distance(x)) < 1e-8) & pad.faces(x)] = i
    return rims


def quadratic(p, tets, place, pads, rims, quarter):
    """Ten-node mesh of corners `p` in the half-ball (n, 3) and `tets` (m, 4)."""
    n = len(p)
    edges, inverse = np.unique(
        np.sort(tets[:, EDGES].reshape(-1, 2), 1), axis=0, return_inverse=True)
    faces, _ = boundary(tets)
    curved, _ = curved_faces(p, tets)
    outer = edge_keys(curved[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), n)
    shell = np.isin(edge_keys(edges, n), outer)
    ball = np.vstack([p, middles(p, edges, shell, rims, place, pads, quarter)])
    number = dict(zip(edge_keys(edges, n).tolist(), range(n, n + len(edges)), strict=True))
    faces = np.array([[*f, *(number[min(a, b) * n + max(a, b)]
                             for a, b in ((f[0], f[1]), (f[1], f[2]), (f[2], f[0])))]
                      for f in faces.tolist()])
    base = (np.abs(p[faces[:, :3], 2]) < 1e-9).all(1)
    surface = faces[~base]
    centre = place(normalised(p[surface[:, :3]].mean(1)))
    patches = tuple(surface[(pad.rim_distance(centre) < 0) & pad.faces(centre)] for pad in pads)
    tets = np.hstack([tets, n + inverse.reshape(-1, 6)])
    return Mesh(straightened(place(ball), tets), tets, n, surface, faces[base], patches)


def straightened(x, tets):
    """Nodes (n, 3) with the edges of elements that curve inside out made straight.

    Such are single elements of coarse meshes, between a rim and another edge of the surface.
    """
    x = x.copy()
    for share in (0.5, 1.0):
        det = np.linalg.det(np.einsum('mai,qaj->mqij', x[tets], slopes(POINTS)))
        bad = tets[(det < 0.1 * np.median(det, axis=1)[:, None]).any(1)]
        middle = x[bad[:, EDGES]].mean(2)
        x[bad[:, 4:]] = (1 - share) * x[bad[:, 4:]] + share * middle
    return x


def middles(p, edges, shell, rims, place, pads, quarter):
    """Middle nodes of edges (k, 2) in the half-ball: on the sphere, the rim, or at a quarter."""
    a, b = edges.T
    share = np.full(len(edges), 0.5)
    share[(rims[a] >= 0) & (rims[b] < 0)] = quarter
    share[(rims[a] < 0) & (rims[b] >= 0)] = 1 - quarter
    ball = (1 - share)[:, None] * p[a] + share[:, None] * p[b]
    ball[shell] = normalised(ball[shell])
    for i, pad in enumerate(pads):
        along = shell & (rims[a] == i) & (rims[b] == i)
        flat = along.copy()
        flat[along] = np.abs(pad.rim_distance(place(ball[along]))) < 0.2 * np.linalg.norm(
            place(p[a[along]]) - place(p[b[along]]), axis=1)
        ball[flat] = slide_to_rim(ball[flat], place, pad)
    return ball


def normalised(vectors):
    """Rows (n, 3) over their lengths."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
