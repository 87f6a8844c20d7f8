"""Box-shaped tetrahedral meshes: for verification, and for beams that need no mesher."""

import itertools

import numpy as np

from arm_brachy.tissue.body import TetMesh
from arm_brachy.tissue.element import signed_volumes


def box_mesh(size, divisions, *, perturbation=0.0, rng=None):
    """Return a box [0, Lx] x [0, Ly] x [0, Lz] cut into 6 tetrahedra per cell (Kuhn).

    size : (3,) edge lengths [m];  divisions : (3,) cells along each edge
    perturbation : interior nodes move by up to this fraction of a cell (below 0.25 nothing
        inverts); needs rng : numpy.random.Generator
    Returns TetMesh with node sets x0, x1, y0, y1, z0, z1 (the faces).
    """
    size, divisions = np.asarray(size, dtype=float), np.asarray(divisions)
    grid = np.stack(np.meshgrid(*(np.arange(d + 1) for d in divisions), indexing='ij'), axis=-1)
    index = grid.reshape(-1, 3)
    nodes = index * (size / divisions)
    if perturbation:
        inside = np.all((index > 0) & (index < divisions), axis=1)
        step = rng.uniform(-perturbation, perturbation, (int(inside.sum()), 3))
        nodes[inside] += step * size / divisions
    sets = {f'{name}{side}': np.flatnonzero(index[:, axis] == side * divisions[axis])
            for axis, name in enumerate('xyz') for side in (0, 1)}
    return TetMesh(nodes, _kuhn_tets(nodes, divisions), sets)


def _kuhn_tets(nodes, divisions):
    """Six tetrahedra per cell, one for each order in which the three steps can be taken."""
    stride = np.array([(divisions[1] + 1) * (divisions[2] + 1), divisions[2] + 1, 1])
    cells = np.stack(np.meshgrid(*(np.arange(d) for d in divisions), indexing='ij'), axis=-1)
    corner = cells.reshape(-1, 3) @ stride
    tets = []
    for order in itertools.permutations(range(3)):
        path = np.concatenate([[0], np.cumsum(stride[list(order)])])
        tets.append(corner[:, None] + path)
    tets = np.concatenate(tets)
    flip = signed_volumes(nodes, tets) < 0.0
    tets[flip] = tets[flip][:, [0, 2, 1, 3]]
    return tets
