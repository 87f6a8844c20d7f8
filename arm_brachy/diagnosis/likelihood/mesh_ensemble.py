"""Companions of a mesh: the same body meshed as well, or better, without asking a mesher again.

The mesher is not deterministic, these are: nodes moved at random (seeded), nodes moved onto the
rims of pads, elements halved. How much the answers of companions differ is what a mesh may err by.
Test: diagnosis/forward/test_mesh_errors.py
"""

from dataclasses import replace

import numpy as np

from arm_brachy.tissue.build import RIM
from arm_brachy.tissue.element import EDGES
from arm_brachy.tissue.mesh import FACE_EDGES, boundary_faces, with_midside
from arm_brachy.tissue.meshing import mean_ratio

LOOSE = 0.2             # of the shortest edge at a node: standard deviation of each of its motions
SHARP = np.radians(45.0)    # between faces: edges that are part of the shape; their nodes stay
STAY = 0.2              # mean ratio below which no element is pressed by a motion of its nodes
HALVINGS = 6            # of motions that would; then the nodes stay


def shaken(body, rng):
    """Return shifts (n, 3) [m] of the nodes of a SoftBody that leave it as good a mesh of it.

    rng : numpy.random.Generator
    Inner corners move anywhere, those of the surface along it and, by what its flat faces miss of
    the curved surface (sagitta, edge length times angle between faces / 8), across it. What is
    held stays but for motions across: rims of pads stay rims. Sharp edges stay.
    """
    mesh, step = body.mesh, LOOSE * _shortest(body.mesh)
    shift = step[:, None] * rng.normal(size=mesh.nodes.shape)
    normal, sagitta, sharp = _skin(mesh)
    outer = np.unique(boundary_faces(mesh))
    across = sagitta * rng.normal(size=len(mesh.nodes))
    along = shift[outer] - np.sum(shift[outer] * normal[outer], axis=1)[:, None] * normal[outer]
    along[np.isin(outer, [node for pad in body.pads for node in pad.nodes])] = 0.0
    shift[outer] = along + across[outer, None] * normal[outer]
    shift[sharp | np.isin(np.arange(len(shift)), body.fixed)] = 0.0
    return _harmless(mesh, shift)


def ragged(body, rng):
    """Return the SoftBody with other outlines of the pads where nodes do not follow their rims.

    rng : numpy.random.Generator. Of each such pad, an end of one edge that crosses the rim is let
    go if it was held and held if it was not: outlines as a mesh might as well have had them.
    """
    pads = []
    for pad in body.pads:
        crossing = _crossing(body, pad)
        if len(crossing):
            corners = np.intersect1d(pad.nodes, body.mesh.tets)
            corners = np.setxor1d(corners, [rng.choice(rng.choice(crossing))])
            pad = replace(pad, nodes=with_midside(body.mesh, corners))
        pads.append(pad)
    return replace(body, pads=tuple(pads))


def fitted(body):
    """Return the SoftBody with nodes moved onto the rims that edges cross, None if none does.

    The nearer end of an edge moves, along the radius, unless that would press an element flat.
    """
    shift = np.zeros_like(body.mesh.nodes)
    crossed = [pad for pad in body.pads if len(_crossing(body, pad))]
    for pad in crossed:
        edges = _crossing(body, pad)
        to_rim = _to_rim(body.mesh.nodes, pad)
        far = np.linalg.norm(to_rim, axis=1)
        nearer = np.unique(edges[np.arange(len(edges)), far[edges].argmin(axis=1)])
        shift[nearer] = to_rim[nearer]
    if not crossed:
        return None
    moved = with_nodes(body, _harmless(body.mesh, shift))
    return replace(moved, pads=tuple(_covering(body, moved.mesh, pad) for pad in body.pads))


def _held_else(body, pad):
    """Nodes that are fixed, or of another pad."""
    return np.concatenate([body.fixed, *(p.nodes for p in body.pads if p is not pad)])


def _covering(body, mesh, pad):
    """The Pad with those corners about its own nodes that lie under its disc in a mesh."""
    if pad.radius is None:
        return pad
    edges = boundary_faces(mesh)[:, FACE_EDGES].reshape(-1, 2)
    about = np.setdiff1d(edges[np.isin(edges, pad.nodes).any(axis=1)], _held_else(body, pad))
    off = np.linalg.norm(_across(mesh.nodes[about], pad), axis=1)
    return replace(pad, nodes=with_midside(mesh, about[off <= RIM * pad.radius]))


def _across(points, pad):
    """Offsets (k, 3) [m] of points from the axis of a Pad."""
    offset = points - pad.centre
    return offset - np.outer(offset @ pad.direction, pad.direction)


def _to_rim(points, pad):
    across = _across(points, pad)
    radius = np.maximum(np.linalg.norm(across, axis=1), 1e-9)
    return across * (pad.radius / radius - 1.0)[:, None]


def _crossing(body, pad):
    """Edges (e, 2) of the surface, corner to corner, that cross the rim of a Pad.

    Those to a node that something else holds are left out.
    """
    if pad.radius is None:
        return np.zeros((0, 2), dtype=np.int64)
    edges = boundary_faces(body.mesh)[:, FACE_EDGES].reshape(-1, 2)
    edges = edges[np.isin(edges, pad.nodes).sum(axis=1) == 1]
    edges = edges[~np.isin(edges, _held_else(body, pad)).any(axis=1)]
    off = np.linalg.norm(_across(body.mesh.nodes, pad), axis=1)[edges] / pad.radius - 1.0
    return np.unique(np.sort(edges[(np.abs(off) > RIM - 1.0).all(axis=1)], axis=1), axis=0)


def with_nodes(body, shift):
    """Return the SoftBody with its corners moved by shift (n, 3) [m], middles between them."""
    def moved(nodes):
        nodes = nodes + shift
        if body.mesh.midside is not None:
            nodes[body.mesh.midside] = nodes[body.mesh.tets[:, EDGES]].mean(axis=2)
        return nodes
    places = None if body.scene_nodes is None else moved(body.scene_nodes)
    return replace(body, mesh=replace(body.mesh, nodes=moved(body.mesh.nodes)),
                   scene_nodes=places)


def edge_lengths(mesh):
    """Lengths (m, 6) [m] of the edges of every element, corner to corner, of a TetMesh."""
    ends = mesh.nodes[mesh.tets[:, EDGES]]
    return np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2)


def _shortest(mesh):
    """Shortest edge (n,) [m] at each corner, 0 at nodes between corners."""
    ends, length = mesh.tets[:, EDGES], edge_lengths(mesh)
    out = np.full(len(mesh.nodes), np.inf)
    for k in (0, 1):
        np.minimum.at(out, ends[..., k].ravel(), length.ravel())
    return np.where(np.isfinite(out), out, 0.0)


def _skin(mesh):
    """Normals (n, 3), sagittas (n,) [m] and sharpness (n,) at the corners of the surface."""
    faces, n = boundary_faces(mesh), len(mesh.nodes)
    corners = mesh.nodes[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = np.zeros((n, 3))
    np.add.at(normal, faces.ravel(), np.repeat(area, 3, axis=0))
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    edges = np.sort(faces[:, FACE_EDGES].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    edges, owner = edges[order][::2], np.repeat(np.arange(len(faces)), 3)[order].reshape(-1, 2)
    unit = area / np.linalg.norm(area, axis=1)[:, None]
    angle = np.arccos(np.clip(np.sum(unit[owner[:, 0]] * unit[owner[:, 1]], axis=1), -1.0, 1.0))
    depth = np.linalg.norm(mesh.nodes[edges[:, 0]] - mesh.nodes[edges[:, 1]], axis=1) * angle / 8.0
    sums, count = np.zeros(n), np.zeros(n)
    np.add.at(sums, edges.ravel(), np.repeat(depth, 2))
    np.add.at(count, edges.ravel(), 1.0)
    return normal, sums / np.maximum(count, 1.0), np.isin(np.arange(n), edges[angle > SHARP])


def _harmless(mesh, shift):
    """The shifts, halved again and again at elements that they would press flat."""
    corners = np.unique(mesh.tets)
    least = np.minimum(STAY, mean_ratio(mesh))
    for _ in range(HALVINGS):
        nodes = mesh.nodes.copy()
        nodes[corners] += shift[corners]
        flat = mean_ratio(replace(mesh, nodes=nodes)) < least
        if not flat.any():
            return shift
        shift = shift.copy()
        shift[np.unique(mesh.tets[flat])] *= 0.5
    shift[np.unique(mesh.tets[flat])] = 0.0
    return shift
