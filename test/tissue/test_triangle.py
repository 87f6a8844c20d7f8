"""Nearest points of triangles against trimesh, and of those without area."""

import numpy as np
import pytest
from trimesh.triangles import closest_point

from arm_brachy.tissue.triangle import closest_points


@pytest.mark.parametrize('scale', [1e-3, 1.0])
def test_the_bits_of_trimesh_in_every_region(scale):
    """Ten thousand triangles: the nearest is in the face of some, else on a side, at a corner."""
    rng = np.random.default_rng(1)
    triangles = scale * rng.normal(size=(10_000, 3, 3))
    points = 1.5 * scale * rng.normal(size=(10_000, 3))
    found = closest_points(triangles, points)
    np.testing.assert_array_equal(found, closest_point(triangles, points))
    sides = np.roll(triangles, -1, axis=1) - triangles
    across = np.linalg.norm(np.cross(sides, found[:, None] - triangles), axis=2)
    away = (across / np.linalg.norm(sides, axis=2)).min(axis=1)
    corner = np.linalg.norm(triangles - found[:, None], axis=2).min(axis=1) == 0.0
    inside = away > 1e-9 * scale
    assert min(corner.mean(), inside.mean(), (~corner & ~inside).mean()) > 0.05


def test_one_point_for_all():
    triangles = np.random.default_rng(2).normal(size=(50, 3, 3))
    point = np.array([0.1, 0.2, -0.3])
    np.testing.assert_array_equal(closest_points(triangles, point),
                                  closest_points(triangles, np.tile(point, (50, 1))))


def test_triangles_without_area_are_segments_or_points():
    line = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    short = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    found = closest_points(np.array([line, short, np.ones((3, 3))]), np.array([1.5, 3.0, 0.0]))
    np.testing.assert_allclose(found, [[1.5, 0.0, 0.0], [1.5, 0.0, 0.0], [1.0, 1.0, 1.0]])
