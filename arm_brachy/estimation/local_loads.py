"""Loads and pad faces that a scene does not tell: where a model of the surface may be wrong."""

import numpy as np
from scipy.spatial.distance import cdist

from arm_brachy.tissue.contact_poses import placed
from arm_brachy.tissue.free_dofs import held_nodes
from arm_brachy.tissue.mesh import boundary_faces

AROUND = 5           # Fourier terms around a pad: 1, cos, sin, cos 2, sin 2
TO_THE_RIM = 3       # power of the distance from a pad's middle with which its face falls short
WIDTH = 12e-3        # m, sd of the Gaussian over which a local load is spread


def face_motion(nodes, pad):
    """Return (k, 3, 5): motion of a pad's nodes per metre by which its face falls short.

    nodes : (n, 3) [m];  pad : tissue.body.Pad
    A pad that is bonded to less or more than its disc, or whose outline on another mesh is
    jagged, carries the tissue at its rim less or more far than its middle:
    (r / R)^3 (1, cos, sin, cos 2, sin 2) along the push, zero in the middle.
    """
    up, side = placed(pad.centre, pad.direction)[:3, :2].T
    across = nodes[pad.nodes] - pad.centre
    u, v = across @ up, across @ side
    r, turn = np.hypot(u, v), np.arctan2(v, u)
    terms = np.stack([np.ones_like(turn), np.cos(turn), np.sin(turn), np.cos(2 * turn),
                      np.sin(2 * turn)], axis=1)
    shape = (r / r.max())[:, None]**TO_THE_RIM * terms
    return shape[:, None, :] * pad.direction[:, None]


def local_loads(body, volume, count):
    """Return nodal loads (3n, 3 count): 1 N in x, y and z around places all over the free skin.

    body : SoftBody;  volume : (n,) [m^3] of the nodes;  count : of places
    Places are nodes as far from each other as can be; a load falls off with the distance from
    its place as a Gaussian of sd WIDTH. Stands for whatever touches the tissue.
    """
    nodes = body.mesh.nodes
    skin = np.setdiff1d(np.unique(boundary_faces(body.mesh)), held_nodes(body))
    places = nodes[skin[far_apart(nodes[skin], count)]]
    weight = volume[:, None] * np.exp(-cdist(nodes, places, 'sqeuclidean') / (2.0 * WIDTH**2))
    weight /= weight.sum(axis=0)
    return np.einsum('nk,ij->nikj', weight, np.eye(3)).reshape(nodes.size, -1)


def node_volumes(body):
    """Return (n,) [m^3] of each node of a SoftBody, the magnitude of its share."""
    geometry = body.geometry
    share = (geometry.weights[:, :, None] * geometry.shape).sum(axis=1)
    return np.abs(np.bincount(geometry.connectivity.ravel(), share.ravel(),
                              minlength=len(body.mesh.nodes)))


def far_apart(points, count):
    """Indices of `count` points (n, 3), each the farthest from those before; the first is 0."""
    chosen, near = [], np.full(len(points), np.inf)
    for _ in range(min(count, len(points))):
        chosen.append(int(near.argmax()))
        near = np.minimum(near, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return chosen
