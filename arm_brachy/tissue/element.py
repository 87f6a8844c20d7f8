"""Tetrahedra: shape functions, quadrature, mass, faces. All that depends on the element is here.

Kernels loop over elements, quadrature points and local nodes of an `ElementGeometry`, whatever
their numbers; another element is another function that returns one. Two are here:

linear     4 nodes, one quadrature point. The thesis' element. It locks: near nu = 0.5 every one
           must keep its volume, which leaves too few ways to deform.
quadratic  4 corners and 6 mid-edge nodes, 4 quadrature points (exact to degree 2). Of the bulk
           modulus, SPREAD mu acts at all of them; what it has beyond that, and without limit near
           nu = 0.5, on the volume change at the centre alone: one constraint an element, so that
           it does not lock (selective reduced integration, equivalent to one pressure an element:
           Malkus & Hughes 1978, Comput Methods Appl Mech Eng 15:63). Edges are straight at rest:
           curved surfaces are met to second order.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

# kappa / mu at nu = 0.3: up to there the quadratic element is integrated in full. More would bring
# locking back (reaction of a pushed dome, nu = 0.49: +4 %; kappa / mu at 0.4: +6 %; all of it:
# +13 %), less would bend too easily (cantilever, two cells across: +1.1 %; 2/3: +2.4 %).
SPREAD = 13.0 / 6.0
# Local nodes of the four faces, ordered so that the normal points out of a positive element.
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])

# d L / d (barycentric coordinates 1..3): rows for the four barycentric coordinates
_SLOPE = np.vstack([-np.ones(3), np.eye(3)])
# Four points of degree 2: Hammer, Marlowe & Stroud 1956, Math. Tables Aids Comput. 10:130.
_NEAR, _FAR = (5.0 + 3.0 * np.sqrt(5.0)) / 20.0, (5.0 - np.sqrt(5.0)) / 20.0
_CENTRE = np.full((1, 4), 0.25)
_POINTS = np.full((4, 4), _FAR) + (_NEAR - _FAR) * np.eye(4)


@dataclass(frozen=True)
class ElementGeometry:
    """What integration over the reference configuration needs.

    connectivity : (m, a) node indices of each element
    gradients : (m, q, a, 3) [1/m] shape gradients dN/dX at the quadrature points
    weights : (m, q) [m^3] quadrature weight times Jacobian determinant; rows sum to the volume,
        zero at points that carry volume change only
    point_weights : (m, q) [m^3] the same, for what such points carry too
    spread : (m,) share of the bulk modulus that acts at all points with a share in `weights`; the
        rest acts where there is none
    shape : (q, a) values of the shape functions at the quadrature points
    mass : (a, a) mean of N_a N_b over an element: consistent mass per unit of element mass
    """

    connectivity: np.ndarray
    gradients: np.ndarray
    weights: np.ndarray
    point_weights: np.ndarray
    spread: np.ndarray
    shape: np.ndarray
    mass: np.ndarray

    @cached_property
    def shear(self):
        """(q,) 1 where a point carries the isochoric energy, else 0."""
        return (self.weights[0] > 0.0).astype(float)

    @property
    def lumping(self):
        """(a,) shares of an element's mass: the diagonal of `mass`, scaled to a sum of 1.

        Source: Hinton, Rock & Zienkiewicz 1976, Earthq Eng Struct Dyn 4:245. Row sums would give
        the corners of quadratic tetrahedra negative mass.
        """
        return np.diag(self.mass) / np.trace(self.mass)


def point_moduli(geometry, fields):
    """Return (mu, kappa), each (m, q) [Pa]: the moduli with which each point acts.

    geometry : ElementGeometry;  fields : StepFields. Linear in the moduli of the fields.
    """
    at_all = geometry.spread * fields.kappa
    return (np.outer(fields.mu, geometry.shear),
            np.outer(at_all, geometry.shear) + np.outer(fields.kappa - at_all,
                                                        1.0 - geometry.shear))


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


def element_geometry(mesh, mu, kappa, *, in_full=False):
    """Return the ElementGeometry of a TetMesh, quadratic if it has midside nodes.

    mu, kappa : (m,) [Pa], for how much of the bulk modulus is not spread
    in_full : spread all of it
    """
    if mesh.midside is None:
        return linear_tet(mesh.nodes, mesh.tets)
    spread = np.ones(len(mu)) if in_full else np.minimum(1.0, SPREAD * mu / kappa)
    return quadratic_tet(mesh.nodes, mesh.connectivity, spread)


def linear_tet(nodes, tets):
    """Return the ElementGeometry of constant-strain tetrahedra (one quadrature point for all).

    nodes : (n, 3) [m];  tets : (m, 4), positively oriented, none degenerate
    Valid for compressible material: near incompressibility (nu > 0.4) these elements lock.
    """
    return _geometry(nodes, tets, _CENTRE, np.ones(1), np.ones(len(tets)),
                     (1.0 + np.eye(4)) / 20.0)


def quadratic_tet(nodes, tets, spread):
    """Return the ElementGeometry of quadratic tetrahedra (four quadrature points and the centre).

    nodes : (n, 3) [m];  tets : (m, 10), corners then the middles of EDGES, edges straight at rest
    spread : (m,) as in ElementGeometry; ones integrate everything in full
    """
    return _geometry(nodes, tets, np.vstack([_POINTS, _CENTRE]), np.array([0.25] * 4 + [0.0]),
                     spread, _quadratic_mass())


def _geometry(nodes, tets, points, share, spread, mass):
    """ElementGeometry with points (q, 4) that carry these shares (q,) of an element's volume."""
    inverse = np.linalg.inv(edge_matrices(nodes, tets[:, :4]))
    slopes = shape_slopes(points, tets.shape[1])
    gradients = np.einsum('qak,mkj->mqaj', slopes, inverse)
    volumes = signed_volumes(nodes, tets[:, :4])
    return ElementGeometry(np.ascontiguousarray(tets, dtype=np.int64),
                           np.ascontiguousarray(gradients), np.outer(volumes, share),
                           np.outer(volumes, np.where(share > 0.0, share, 1.0)), spread,
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
