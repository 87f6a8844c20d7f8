"""Tetrahedra: shape functions, quadrature, mass, faces. All that depends on the element is here.

Kernels loop over elements, quadrature points and local nodes of an `ElementGeometry`, whatever
their numbers; another element is another function that returns one. Two are here:

linear     4 nodes, one quadrature point. The thesis' element. It locks: near nu = 0.5 every one
           must keep its volume, which leaves too few ways to deform.
quadratic  4 corners and 6 mid-edge nodes, 4 quadrature points (exact to degree 2). Its volume is
           checked at 4 points, as many constraints as unknowns in a fine mesh: on a solution that
           does not change with nu its error grows by 1.06 from nu = 0.3 to 0.49, by 1.4 to 0.499
           and by 2.6 to 0.4999, where the order falls by up to one (verification/test_elements).
           Edges are straight at rest: curved surfaces are met to second order.
"""

from dataclasses import dataclass

import numpy as np

# Local nodes of the four faces, ordered so that the normal points out of a positive element.
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])

# d L / d (barycentric coordinates 1..3): rows for the four barycentric coordinates
_SLOPE = np.vstack([-np.ones(3), np.eye(3)])
# Four points of degree 2: Hammer, Marlowe & Stroud 1956, Math. Tables Aids Comput. 10:130.
_NEAR, _FAR = (5.0 + 3.0 * np.sqrt(5.0)) / 20.0, (5.0 - np.sqrt(5.0)) / 20.0
_POINTS = np.full((4, 4), _FAR) + (_NEAR - _FAR) * np.eye(4)


@dataclass(frozen=True)
class ElementGeometry:
    """What integration over the reference configuration needs.

    connectivity : (m, a) node indices of each element
    gradients : (m, q, a, 3) [1/m] shape gradients dN/dX at the quadrature points
    weights : (m, q) [m^3] quadrature weight times Jacobian determinant; rows sum to the volume
    shape : (q, a) values of the shape functions at the quadrature points
    mass : (a, a) mean of N_a N_b over an element: consistent mass per unit of element mass
    """

    connectivity: np.ndarray
    gradients: np.ndarray
    weights: np.ndarray
    shape: np.ndarray
    mass: np.ndarray

    @property
    def lumping(self):
        """(a,) shares of an element's mass: the diagonal of `mass`, scaled to a sum of 1.

        Source: Hinton, Rock & Zienkiewicz 1976, Earthq Eng Struct Dyn 4:245. Row sums would give
        the corners of quadratic tetrahedra negative mass.
        """
        return np.diag(self.mass) / np.trace(self.mass)


def edge_matrices(nodes, tets):
    """Return D (m, 3, 3) with columns X1 - X0, X2 - X0, X3 - X0 [m].

    nodes : (n, 3) [m];  tets : (m, 4). Equals N_X of (3.16) up to the node taken as origin.
    """
    return np.swapaxes(nodes[tets[:, 1:]] - nodes[tets[:, :1]], 1, 2)


def signed_volumes(nodes, tets):
    """Return (m,) [m^3], negative where the node order is left-handed.

    nodes : (n, 3) [m];  tets : (m, 4)
    """
    return np.linalg.det(edge_matrices(nodes, tets)) / 6.0


def element_geometry(mesh):
    """Return the ElementGeometry of a TetMesh, quadratic if it has midside nodes."""
    if mesh.midside is None:
        return linear_tet(mesh.nodes, mesh.tets)
    return quadratic_tet(mesh.nodes, mesh.connectivity)


def linear_tet(nodes, tets):
    """Return the ElementGeometry of constant-strain tetrahedra (one quadrature point).

    nodes : (n, 3) [m];  tets : (m, 4), positively oriented, none degenerate
    Valid for compressible material: near incompressibility (nu > 0.4) these elements lock.
    """
    return _geometry(nodes, tets, np.full((1, 4), 0.25), (1.0 + np.eye(4)) / 20.0)


def quadratic_tet(nodes, tets):
    """Return the ElementGeometry of quadratic tetrahedra (four quadrature points).

    nodes : (n, 3) [m];  tets : (m, 10), corners then the middles of EDGES, edges straight at rest
    """
    return _geometry(nodes, tets, _POINTS, _quadratic_mass())


def _geometry(nodes, tets, points, mass):
    inverse = np.linalg.inv(edge_matrices(nodes, tets[:, :4]))
    slopes = shape_slopes(points, tets.shape[1])
    gradients = np.einsum('qak,mkj->mqaj', slopes, inverse)
    volumes = signed_volumes(nodes, tets[:, :4])
    weights = np.repeat(volumes[:, None] / len(points), len(points), axis=1)
    return ElementGeometry(np.ascontiguousarray(tets, dtype=np.int64),
                           np.ascontiguousarray(gradients), weights,
                           shape_values(points, tets.shape[1]), mass)


def shape_values(L, a):
    """Return the shape functions (k, a) at barycentric coordinates L (k, 4); a is 4 or 10."""
    if a == 4:
        return np.array(L)
    i, j = EDGES.T
    return np.hstack([L * (2.0 * L - 1.0), 4.0 * L[:, i] * L[:, j]])


def shape_slopes(L, a):
    """Return dN/dL (k, a, 3) at L (k, 4), L1..L3 independent and L0 = 1 - L1 - L2 - L3.

    dN/dX follows by the inverse of `edge_matrices`.
    """
    if a == 4:
        return np.broadcast_to(_SLOPE, (len(L), 4, 3))
    i, j = EDGES.T
    corners = (4.0 * L - 1.0)[:, :, None] * _SLOPE
    middles = 4.0 * (L[:, i, None] * _SLOPE[j] + L[:, j, None] * _SLOPE[i])
    return np.concatenate([corners, middles], axis=1)


def _quadratic_mass():
    """Integrals of products of shape functions over the volume, exact, for straight edges.

    Corner and corner 6 (same), 1; corner and middle -4 (edge at the corner), -6 (not); middle and
    middle 32 (same), 16 (edges that meet), 8 (opposite), all over 420.
    """
    touches = (EDGES[:, :, None] == np.arange(4)).any(axis=1)  # (6, 4) edge ends at corner
    meet = touches.astype(int) @ touches.T.astype(int)         # corners that two edges share
    corners = 1.0 + 5.0 * np.eye(4)
    mixed = np.where(touches, -4.0, -6.0)
    middles = np.array([8.0, 16.0, 32.0])[meet]
    return np.block([[corners, mixed.T], [mixed, middles]]) / 420.0
