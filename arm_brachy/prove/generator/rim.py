"""Refinement towards the rims of the pads, and corners put on every rim."""
import numpy as np
from skfem import MeshTet

from arm_brachy.prove.generator.tets import EDGES, curved_faces, orient, split


def refine_rims(p, tets, place, pads, size, reach):
    """Bisect until tetrahedra at a rim are smaller than `size` times the pad's radius.

    place : maps ball coordinates to the body.  reach : the wanted size grows by 1 / reach per
    distance from the rim.  Returns new corners in the half-ball and tetrahedra.
    """
    for _ in range(12):
        x = place(p)
        edge = np.linalg.norm(x[tets[:, EDGES[:, 0]]] - x[tets[:, EDGES[:, 1]]], axis=2).max(1)
        coarse = np.zeros(len(tets), bool)
        for pad in pads:
            coarse |= edge > wanted_size(x[tets].mean(1), pad, size, reach)
        if not coarse.any():
            break
        mesh = MeshTet(np.ascontiguousarray(p.T), np.ascontiguousarray(tets.T))
        mesh = mesh.refined(np.flatnonzero(coarse))
        p, tets = mesh.p.T.copy(), mesh.t.T.copy()
        on_sphere = np.unique(curved_faces(p, tets)[0])
        p[on_sphere] /= np.linalg.norm(p[on_sphere], axis=1, keepdims=True)
    return p, orient(p, tets)


def wanted_size(points, pad, size, reach):
    """Longest edge allowed at points (n, 3) [m]: `size` radii at the rim, growing away."""
    size = size * pad.radius
    arm = points - np.asarray(pad.centre)
    along = arm @ np.asarray(pad.direction)
    rim = np.hypot(pad.rim_distance(points), along)
    return size + np.maximum(rim - size, 0) / reach


def slide_to_rim(ball, place, pad, steps=8, h=1e-6):
    """Points (n, 3) of the unit sphere moved along it, by Newton's method, to the rim of `pad`."""
    b = ball.copy()
    for _ in range(steps):
        phi = pad.rim_distance(place(b))
        grad = np.column_stack([
            (pad.rim_distance(place(b + e)) - pad.rim_distance(place(b - e))) / (2 * h)
            for e in h * np.eye(3)
        ])
        grad -= np.einsum('ij,ij->i', grad, b)[:, None] * b
        b = b - (phi / np.einsum('ij,ij->i', grad, grad))[:, None] * grad
        b /= np.linalg.norm(b, axis=1, keepdims=True)
    return b


def crossings(p, tets, place, pad):
    """Surface edges (k, 2) that cross the rim of `pad`, and where, as share from the first end."""
    faces, _ = curved_faces(p, tets)
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), 1), axis=0)
    x = place(p)
    facing = pad.faces(x)
    edges = edges[facing[edges].all(1)]
    phi = pad.rim_distance(x)
    phi[np.abs(phi) < 1e-9] = 0
    edges = edges[phi[edges[:, 0]] * phi[edges[:, 1]] < 0]
    return edges, phi[edges[:, 0]] / (phi[edges[:, 0]] - phi[edges[:, 1]])


def fit_rim(p, tets, place, pad, near=0.3):
    """Put corners on the rim of `pad` until no edge of the surface crosses it.

    A corner within `near` of a crossing edge's length slides onto the rim; an edge that still
    crosses is broken there.  Returns corners and tetrahedra.
    """
    edges, share = crossings(p, tets, place, pad)
    move = np.unique(np.r_[edges[share < near, 0], edges[share > 1 - near, 1]])
    p = p.copy()
    p[move] = slide_to_rim(p[move], place, pad)
    for _ in range(20):
        edges, share = crossings(p, tets, place, pad)
        if not len(edges):
            return p, orient(p, tets)
        cut = (1 - share)[:, None] * p[edges[:, 0]] + share[:, None] * p[edges[:, 1]]
        cut /= np.linalg.norm(cut, axis=1, keepdims=True)
        p, tets = split(p, tets, edges, slide_to_rim(cut, place, pad))
    raise RuntimeError(f'{pad.name}: {len(edges)} edges still cross its rim; refine the mesh')
