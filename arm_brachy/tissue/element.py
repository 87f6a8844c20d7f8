"""Linear tetrahedron: shape gradients, quadrature, faces. All that depends on the element is here.

The kernels of `assembly` loop over elements, quadrature points and local nodes of an
`ElementGeometry`, whatever their numbers; another element is another function that returns one.
"""

from dataclasses import dataclass

import numpy as np

# Local nodes of the four faces, ordered so that the normal points out of a positive element.
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


@dataclass(frozen=True)
class ElementGeometry:
    """What integration over the reference configuration needs.

    connectivity : (m, a) node indices of each element
    gradients : (m, q, a, 3) [1/m] shape gradients dN/dX at the quadrature points
    weights : (m, q) [m^3] quadrature weight times Jacobian determinant; rows sum to the volume
    shape : (q, a) values of the shape functions at the quadrature points
    """

    connectivity: np.ndarray
    gradients: np.ndarray
    weights: np.ndarray
    shape: np.ndarray


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


def linear_tet(nodes, tets):
    """Return the ElementGeometry of constant-strain tetrahedra (one quadrature point).

    nodes : (n, 3) [m];  tets : (m, 4), positively oriented, none degenerate
    Valid for compressible material: near incompressibility (nu > 0.4) these elements lock.
    """
    edges = edge_matrices(nodes, tets)
    inverse = np.linalg.inv(edges)  # its rows are the gradients of nodes 1, 2, 3
    gradients = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
    volumes = np.linalg.det(edges) / 6.0
    return ElementGeometry(np.ascontiguousarray(tets, dtype=np.int64),
                           np.ascontiguousarray(gradients[:, None]), volumes[:, None],
                           np.full((1, 4), 0.25))
