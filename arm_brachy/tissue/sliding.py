"""Nodes of a mesh slid along its surface: the same body meshed so that a patch lies elsewhere."""

import igl
import numpy as np
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from arm_brachy.core.errors import MeshError
from arm_brachy.tissue.element import EDGES, signed_volumes
from arm_brachy.tissue.mesh import boundary_faces

STEPS = 4  # of the way along the surface, each by the midpoint rule
# Share of the way that nodes may end off the given surface, root mean square. On the meshes of the
# breast phantoms, rough as they are, it is 0.15 at most; a lid that slides over the edge of a
# block has 1 for one row of its nodes.
OFF_SURFACE = 0.2


def slide_patch(mesh, patch, centre, direction, offset, held, reach):
    """Return nodes (n, 3) [m] of the same body, same elements, a patch moved; and its new centre.

    mesh : TetMesh;  patch : (k,) nodes of its surface;  centre : (3,) [m] of the patch
    direction : (3,) unit vector into the body;  offset : (3,) [m] across it
    held : (h,) nodes that stay where they are, none of them in the patch
    reach : [m] how far around the patch nodes take part, less where a held one is nearer

    Every node of the patch moves by `offset` and along `direction` as the surface rises and falls,
    so that it stays under a disc that moves with it. The surface around takes a share that falls
    linearly to nothing; the nodes within follow harmonically, each by the mean of its neighbours.
    What rises and falls is the mean surface over `reach` (`SmoothSurface`): the roughness of a
    mesh goes with its nodes, or elements with all nodes on the surface would be flattened.
    Positions are smooth in `offset`. Edges are straight.
    Holds where the surface is smooth within `reach` of the patch: an edge of it is carried along.
    Raises MeshError if the patch leaves the surface or an element turns inside out.
    """
    surface, nodes, faces = SmoothSurface(mesh, reach), mesh.nodes.copy(), boundary_faces(mesh)
    outer, corners = np.unique(faces), np.unique(mesh.tets)
    share = _share(nodes[outer], nodes[np.intersect1d(patch, corners)], nodes[held], reach)
    moving, share = outer[share > 0.0], share[share > 0.0]
    start = np.vstack([nodes[moving], centre])
    share = np.append(share, 1.0)
    side = np.vstack([surface.node_normals[moving], -direction])
    goal = surface.follow(start, side, offset, share, direction)
    nodes[moving] = goal[:-1]
    _refuse_leaving(goal[:-1], mesh.nodes, faces, np.linalg.norm(offset))
    within = np.setdiff1d(corners, outer)
    nodes[within] += _harmonic(mesh.tets, within, nodes - mesh.nodes)
    if mesh.midside is not None:
        ends = nodes[mesh.tets[:, EDGES]]
        nodes[mesh.midside] = 0.5 * (ends[:, :, 0] + ends[:, :, 1])
    bad = np.flatnonzero(signed_volumes(nodes, mesh.tets) <= 0.0)
    if len(bad):
        raise MeshError(f'{len(bad)} of {len(mesh.tets)} elements turned inside out, first '
                        f'{bad[0]}; a patch moved by {1e3 * np.linalg.norm(offset):.3g} mm must '
                        'leave room for the elements beside it; move it less or refine the mesh')
    return nodes, goal[-1]


def _refuse_leaving(points, nodes, faces, way):
    squared, _, _ = igl.point_mesh_squared_distance(points, nodes, faces)
    off = np.sqrt(squared.mean())
    if off > OFF_SURFACE * way:
        raise MeshError(f'nodes that move by {1e3 * way:.3g} mm end {1e3 * off:.3g} mm off the '
                        f'surface (root mean square); must be at most {OFF_SURFACE} of the way; '
                        'the patch reaches an edge of the body; move it less or elsewhere')


class SmoothSurface:
    """The surface of a mesh as far as its normals, averaged over a neighbourhood, tell.

    mesh : TetMesh;  radius : [m] of the neighbourhood
    node_normals : (n, 3) outward, mean over the faces around each node by area, 0 inside

    The normal at a point is the mean over the faces by area, times the kernel (1 - s^2)^2 of their
    distance over the radius, times the cosine to the side that the point is on: what turns away
    by 90 deg is another side of the body. Exact on planes and, by symmetry, on spheres.
    """

    def __init__(self, mesh, radius):
        faces = boundary_faces(mesh)
        a, b, c = (mesh.nodes[faces[:, i]] for i in range(3))
        self.areas = 0.5 * np.cross(b - a, c - a)
        self._units = self.areas / np.linalg.norm(self.areas, axis=1, keepdims=True)
        self._middles, self._radius = cKDTree((a + b + c) / 3.0), radius
        total = np.zeros_like(mesh.nodes)
        np.add.at(total, faces, self.areas[:, None])
        length = np.linalg.norm(total, axis=1, keepdims=True)
        self.node_normals = np.divide(total, length, out=total, where=length > 0.0)

    def normals(self, points, side):
        """Return the mean outward unit normals (k, 3) near points (k, 3) of sides (k, 3).

        side : outward unit vectors that say which side of the body a point is on
        Raises MeshError for a point with no face in its neighbourhood.
        """
        near = cKDTree(points).sparse_distance_matrix(self._middles, self._radius,
                                                      output_type='coo_matrix')
        kernel = (1.0 - (near.data / self._radius) ** 2) ** 2
        facing = np.maximum(np.sum(side[near.row] * self._units[near.col], axis=1), 0.0)
        total = np.zeros_like(points)
        np.add.at(total, near.row, (kernel * facing)[:, None] * self.areas[near.col])
        length = np.linalg.norm(total, axis=1, keepdims=True)
        if not length.all():
            at = ', '.join(f'{1e3 * v:.1f}' for v in points[np.flatnonzero(length == 0.0)[0]])
            raise MeshError(f'no face of the surface lies within {1e3 * self._radius:.1f} mm of '
                            f'({at}) mm; must be finer than the patch and go on around it; '
                            'refine the mesh or move the patch less')
        return total / length

    def follow(self, points, side, offset, share, direction):
        """Return where points (k, 3) [m] get by their share (k,) of `offset` (3,) [m].

        side : as in `normals`
        A point keeps to the surface by going along `direction` (3,) as well if its share is 1,
        along the normal if it is 0, which works on steep flanks too, and between for one between.
        """
        offsets, share = np.outer(share, offset), share[:, None]

        def slope(at):
            n = self.normals(at, side)
            back = share * direction - (1.0 - share) * n
            rise = np.sum(offsets * n, axis=1, keepdims=True)
            return offsets - rise * back / np.sum(back * n, axis=1, keepdims=True)

        for _ in range(STEPS):
            points = points + slope(points + 0.5 * slope(points) / STEPS) / STEPS
        return points


def _share(points, patch, held, reach):
    """1 at the patch, 0 from `reach` on and at held nodes, linear in the distance between."""
    near, _ = cKDTree(patch).query(points)
    room = near + cKDTree(held).query(points)[0] if len(held) else np.inf
    return np.clip(1.0 - near / np.minimum(room, reach), 0.0, 1.0)


def _harmonic(tets, free, values):
    """Values (f, 3) at nodes `free` (f,), each the mean over its neighbours; others as given."""
    if not len(free):
        return np.zeros((0, 3))
    n = len(values)
    pairs = np.unique(np.sort(tets[:, EDGES].reshape(-1, 2), axis=1), axis=0)
    rows, cols = np.concatenate([pairs, pairs[:, ::-1]]).T
    adjacency = coo_array((np.ones(len(rows)), (rows, cols)), shape=(n, n)).tocsr()
    laplacian = (diags_array(adjacency.sum(axis=1)) - adjacency).tocsr()[free]
    known = values.copy()
    known[free] = 0.0
    return spsolve(laplacian[:, free].tocsc(), -(laplacian @ known)).reshape(-1, 3)
