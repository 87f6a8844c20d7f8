"""What a tetrahedral mesh must satisfy before anything is computed on it."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.element import FACES, edge_matrices, signed_volumes

SMALLEST_EXTENT = 1e-3  # m; below it a file in metres was read as millimetres
LARGEST_EXTENT = 5.0    # m; above it a file in millimetres was read as metres
# Volume over cubed longest edge; a regular tetrahedron has 0.118, a usable sliver 1e-4.
FLAT = 1e-7


def check_mesh(mesh, where):
    """Return `mesh` if it can carry a simulation; raise MeshError (one line) if not.

    mesh : body.TetMesh [m];  where : file name for the message
    Refuses, in this order: wrong shapes, NaN nodes, no tetrahedra, indices out of range (node
    sets too), implausible extent, repeated nodes in an element, flat or inverted elements,
    faces shared by more than two elements, nodes of no element, several components.
    """
    _check_arrays(mesh, where)
    _check_extent(mesh, where)
    _check_elements(mesh, where)
    _check_connection(mesh, where)
    return mesh


def _check_arrays(mesh, where):
    nodes, tets = mesh.nodes, mesh.tets
    if nodes.ndim != 2 or nodes.shape[1] != 3:
        raise MeshError(f'{where}: nodes have shape {nodes.shape}; must be (n, 3)')
    if tets.ndim != 2 or tets.shape[1] != 4 or not len(tets):
        raise MeshError(f'{where}: no tetrahedra (array of shape {tets.shape}); must hold 4-node '
                        'tetrahedra; a surface is meshed with `arm-brachy mesh`')
    bad = np.flatnonzero(~np.isfinite(nodes).all(axis=1))
    if len(bad):
        raise MeshError(f'{where}: node {bad[0]} is {nodes[bad[0]].tolist()} ({len(bad)} such); '
                        'coordinates must be finite; export the mesh again')
    bad = np.flatnonzero(((tets < 0) | (tets >= len(nodes))).any(axis=1))
    if len(bad):
        raise MeshError(f'{where}: element {bad[0]} names nodes {tets[bad[0]].tolist()} '
                        f'({len(bad)} such); must be 0 to {len(nodes) - 1} (counted from 0)')
    for name, members in mesh.node_sets.items():
        if len(members) and not (members.min() >= 0 and members.max() < len(nodes)):
            raise MeshError(f'{where}: node set {name!r} holds indices {members.min()} to '
                            f'{members.max()}; must be 0 to {len(nodes) - 1} (counted from 0)')


def _check_extent(mesh, where):
    extent = float(np.ptp(mesh.nodes, axis=0).max())
    if extent > LARGEST_EXTENT:
        raise MeshError(f'{where}: the mesh is {extent:.4g} m long; must be at most '
                        f'{LARGEST_EXTENT:g} m; is the file in mm? then set mesh unit: mm')
    if extent < SMALLEST_EXTENT:
        raise MeshError(f'{where}: the mesh is {extent:.4g} m long; must be at least '
                        f'{SMALLEST_EXTENT:g} m; is the file in m? then set mesh unit: m')


def _check_elements(mesh, where):
    tets = np.sort(mesh.tets, axis=1)
    bad = np.flatnonzero((np.diff(tets, axis=1) == 0).any(axis=1))
    if len(bad):
        raise MeshError(f'{where}: element {bad[0]} repeats a node, {mesh.tets[bad[0]].tolist()} '
                        f'({len(bad)} such); remove it')
    volumes = signed_volumes(mesh.nodes, mesh.tets)
    edges = np.linalg.norm(edge_matrices(mesh.nodes, mesh.tets), axis=1).max(axis=1)
    bad = np.flatnonzero(np.abs(volumes) < FLAT * edges ** 3)
    if len(bad):
        raise MeshError(f'{where}: element {bad[0]} is flat, volume {volumes[bad[0]]:.3g} m^3 '
                        f'({len(bad)} such); remesh, or collapse its shortest edge')
    bad = np.flatnonzero(volumes < 0.0)
    if len(bad):
        cure = ('the file orders nodes the other way: swap two columns of every element'
                if len(bad) == len(volumes) else 'untangle or remesh there')
        raise MeshError(f'{where}: element {bad[0]} is inverted, volume {volumes[bad[0]]:.3g} m^3 '
                        f'({len(bad)} of {len(volumes)}); {cure}')


def _check_connection(mesh, where):
    n, tets = len(mesh.nodes), mesh.tets
    unused = np.setdiff1d(np.arange(n), tets)
    if len(unused):
        raise MeshError(f'{where}: node {unused[0]} belongs to no element ({len(unused)} such); '
                        'remove such nodes (gmsh: Mesh.SaveAll = 0)')
    faces, count = np.unique(np.sort(tets[:, FACES].reshape(-1, 3), axis=1), axis=0,
                             return_counts=True)
    if count.max() > 2:
        raise MeshError(f'{where}: face {faces[count.argmax()].tolist()} belongs to {count.max()} '
                        'elements; must be 1 or 2; elements overlap or repeat: remesh')
    rows, cols = np.repeat(tets[:, 0], 3), tets[:, 1:].ravel()
    parts, label = connected_components(coo_array((np.ones(len(rows)), (rows, cols)), (n, n)),
                                        directed=False)
    if parts > 1:
        lonely = np.flatnonzero(label != np.bincount(label).argmax())
        raise MeshError(f'{where}: {parts} separate pieces (node {lonely[0]} is not joined to the '
                        'largest); must be one; merge duplicate nodes or keep one piece')
