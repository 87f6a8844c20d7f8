"""Displacement and stretch against affine fields, for which linear tetrahedra are exact."""

import itertools

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.evaluation import deformation as d
from arm_brachy.evaluation.timeseries import Tissue


@pytest.fixture(scope='module')
def box():
    """A box of 1 x 2 x 3 cm, six tetrahedra per cell, nodes denser at one end."""
    axes = [0.01 * np.linspace(0, 1, 4) ** 2, np.linspace(0, 0.02, 4), np.linspace(0, 0.03, 5)]
    shape = [len(a) for a in axes]
    nodes = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 3)
    tets = []
    for i, j, k in itertools.product(*[range(n - 1) for n in shape]):
        for order in itertools.permutations(range(3)):
            path = [np.array([i, j, k])]
            for step in order:
                path.append(path[-1] + np.eye(3, dtype=int)[step])
            corner = [np.ravel_multi_index(p, shape) for p in path]
            odd = np.linalg.det(np.eye(3)[list(order)]) < 0
            tets.append([corner[0], corner[2], corner[1], corner[3]] if odd else corner)
    return nodes, np.array(tets)


def test_volumes_and_boundary_of_a_box(box):
    nodes, tets = box
    assert (d.tet_volumes(nodes, tets) > 0).all()
    assert d.tet_volumes(nodes, tets).sum() == pytest.approx(6e-6)
    a, b, c = (nodes[d.boundary_triangles(tets)[:, i]] for i in range(3))
    area = 0.5 * np.cross(b - a, c - a)
    assert np.linalg.norm(area, axis=1).sum() == pytest.approx(22e-4)
    # divergence theorem: outward faces give plus the volume
    assert np.sum((a + b + c) / 3 * area) / 3 == pytest.approx(6e-6)


def test_stretches_of_an_affine_map_are_the_singular_values(box):
    nodes, tets = box
    F = np.eye(3) + 0.3 * stream(3, 'affine').standard_normal((3, 3))
    expected = np.sort(np.linalg.svd(F, compute_uv=False))
    found = d.principal_stretches(nodes, nodes @ F.T, tets)
    assert found == pytest.approx(np.tile(expected, (len(tets), 1)), rel=1e-9)


def test_rigid_motion_moves_but_does_not_stretch(box):
    nodes, tets = box
    angle = 0.7
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0],
                  [0, 0, 1]])
    turned = d.deformation(nodes, nodes @ R.T, tets)
    assert turned.max_stretch == pytest.approx(1.0, abs=1e-12)
    shifted = d.deformation(nodes, nodes + [3e-3, 0, 4e-3], tets)
    sizes = (shifted.mean_displacement, shifted.max_displacement, shifted.volume_mean_displacement)
    assert sizes == pytest.approx([5e-3] * 3)


def test_volume_mean_does_not_depend_on_where_nodes_are_dense(box):
    nodes, tets = box
    u = np.zeros_like(nodes)
    u[:, 0] = 0.1 * nodes[:, 0]
    shape = d.deformation(nodes, nodes + u, tets)
    assert shape.volume_mean_displacement == pytest.approx(0.1 * 0.005)
    assert shape.mean_displacement != pytest.approx(0.1 * 0.005, rel=0.05)
    assert shape.max_stretch == pytest.approx(1.1)


def test_largest_deformation_finds_its_snapshot(box):
    nodes, tets = box
    positions = np.stack([nodes * s for s in (1.0, 1.2, 1.1)])
    index, shape = d.largest_deformation(Tissue(np.arange(3.0), positions, nodes, tets))
    assert index == 1
    assert shape.max_stretch == pytest.approx(1.2)
