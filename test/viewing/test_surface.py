"""Surfaces with few triangles: how few, how near to the whole one, and that they follow it."""

import numpy as np
import pytest
import trimesh

from arm_brachy.viewing.surface import thinned

MOST = 300


@pytest.fixture(scope='module')
def ball():
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    return np.array(sphere.vertices), np.array(sphere.faces)


def test_it_has_at_most_as_many_triangles_as_asked_and_not_far_fewer(ball):
    thin = thinned(*ball, MOST)
    assert MOST / 2 < len(thin.triangles) <= MOST


def test_a_surface_with_few_is_drawn_as_it_is(ball):
    nodes, faces = ball
    thin = thinned(nodes, faces, len(faces))
    assert np.array_equal(thin.rest[thin.triangles], nodes[faces])


def test_corners_are_nodes_and_outward_stays_outward(ball):
    nodes, faces = ball
    thin = thinned(nodes, faces, MOST)
    assert np.array_equal(thin.rest, nodes[thin.nodes])
    corners = thin.rest[thin.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum('fi,fi->f', normal, corners.mean(axis=1)) > 0).all()


def test_it_encloses_nearly_the_volume_of_the_whole(ball):
    thin = thinned(*ball, MOST)
    coarse = trimesh.Trimesh(thin.rest, thin.triangles)
    assert coarse.is_watertight
    assert coarse.volume == pytest.approx(4 / 3 * np.pi * 0.05**3, rel=0.1)


def test_it_moves_with_the_nodes(ball):
    nodes, faces = ball
    thin = thinned(nodes, faces, MOST)
    corners, moved = thin.shape(nodes + [0.0, 0.003, 0.004])
    assert np.allclose(moved, 0.005) and np.allclose(corners - thin.rest, [0.0, 0.003, 0.004])


def test_a_sharp_rim_stays():
    """A flat base keeps its outline: of the nodes of a cell the one on the edge is drawn."""
    tin = trimesh.creation.cylinder(radius=0.05, height=0.04, sections=64)
    fine = tin.subdivide().subdivide()
    thin = thinned(np.array(fine.vertices), np.array(fine.faces), MOST)
    low = thin.rest[np.isclose(thin.rest[:, 2], -0.02)]
    rim = np.isclose(np.linalg.norm(low[:, :2], axis=1), 0.05, atol=1e-3)
    assert rim.sum() > 12
    assert trimesh.Trimesh(thin.rest, thin.triangles).volume == pytest.approx(tin.volume, rel=0.06)
