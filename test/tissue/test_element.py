"""The linear tetrahedron: exact for affine fields, volume by quadrature."""

import numpy as np

from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.element import linear_tet, signed_volumes


def test_gradients_are_exact_for_affine_fields_and_weights_sum_to_the_volume():
    size = (0.03, 0.02, 0.01)
    mesh = box_mesh(size, (3, 2, 2), perturbation=0.2, rng=np.random.default_rng(0))
    geometry = linear_tet(mesh.nodes, mesh.tets)
    A = np.random.default_rng(1).normal(size=(3, 3))
    field = (mesh.nodes @ A.T + 0.3)[geometry.connectivity]
    gradient = np.einsum('mai,mqak->mqik', field, geometry.gradients)
    np.testing.assert_allclose(gradient, np.broadcast_to(A, gradient.shape), atol=1e-10)
    np.testing.assert_allclose(geometry.gradients.sum(axis=2), 0.0, atol=1e-10)
    np.testing.assert_allclose(geometry.shape.sum(axis=1), 1.0)
    np.testing.assert_allclose(geometry.weights.sum(), np.prod(size))
    np.testing.assert_allclose(geometry.weights[:, 0], signed_volumes(mesh.nodes, mesh.tets))


def test_swapping_two_nodes_turns_the_volume_negative():
    mesh = box_mesh((0.01, 0.01, 0.01), (1, 1, 1))
    np.testing.assert_allclose(signed_volumes(mesh.nodes, mesh.tets[:, [0, 2, 1, 3]]),
                               -signed_volumes(mesh.nodes, mesh.tets))
