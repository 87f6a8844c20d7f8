"""Signed distances of rigid bodies against sampled surfaces and finite differences."""

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.tissue.contact_poses import placed
from arm_brachy.tissue.contact_shapes import CurvedProbe, Disc, Plane, RoundedBox, Sphere

SHAPES = {
    'plane': Plane(),
    'sphere': Sphere(0.01),
    'disc': Disc(0.01, 0.002),
    'box': RoundedBox(0.04, 0.012, 0.003),
    'curved': CurvedProbe(0.03, 0.014, 0.002),
}


def around(shape, count=400, reach=0.03):
    """Points outside a body, or inside it but no deeper than 0.9 of `depth`."""
    y = np.random.default_rng(2).uniform(-reach, reach, (8 * count, 3))
    d = shape.signed_distance(y)[0]
    return y[d > -0.9 * min(shape.depth, reach)][:count]


@pytest.mark.parametrize('name', SHAPES)
def test_gradient_and_hessian_are_those_of_the_distance(name):
    shape, h = SHAPES[name], 1e-7
    y = around(shape)
    d, g, H = shape.signed_distance(y)
    np.testing.assert_allclose(np.linalg.norm(g, axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(H, np.swapaxes(H, 1, 2), atol=1e-9)
    for axis in range(3):
        ahead, back = (shape.signed_distance(y + s * h * np.eye(3)[axis]) for s in (1, -1))
        np.testing.assert_allclose((ahead[0] - back[0]) / (2 * h), g[:, axis], atol=1e-5)
        slope = (ahead[1] - back[1]) / (2 * h)
        off = np.abs(slope - H[:, axis]).max(axis=1)
        # The Hessian jumps where flat meets rounding: at most a point or two straddle that.
        assert np.count_nonzero(off > 1e-4 * (1.0 + np.abs(H).max())) <= 2


@pytest.mark.parametrize('name', SHAPES)
def test_stepping_back_by_the_distance_lands_on_the_surface(name):
    """y - d g is the foot of y: at distance zero, with the same normal."""
    shape = SHAPES[name]
    y = around(shape)
    d, g, _ = shape.signed_distance(y)
    foot_d, foot_g, _ = shape.signed_distance(y - d[:, None] * g)
    np.testing.assert_allclose(foot_d, 0.0, atol=1e-12)
    np.testing.assert_allclose(foot_g, g, atol=1e-6)


def test_disc_is_a_cylinder_with_a_rounded_edge():
    disc = SHAPES['disc']
    y = [[0.0, 0.0, 0.005], [0.007, 0.0, -0.001], [0.015, 0.0, -0.02], [0.008, 0.003, 0.001]]
    radial = np.hypot(0.008, 0.003) - 0.008
    expected = [0.005, -0.001, 0.005, np.hypot(radial, 0.003) - 0.002]
    np.testing.assert_allclose(disc.signed_distance(y)[0], expected, atol=1e-15)


def test_curved_probe_touches_the_plane_of_its_top_along_a_line():
    """Its top is the line x = z = 0; on it curvature 1 / radius across and none along."""
    probe = SHAPES['curved']
    y = np.array([[0.0, -0.004, 0.0], [0.0, 0.004, 0.0]])
    d, g, H = probe.signed_distance(y)
    np.testing.assert_allclose(d, 0.0, atol=1e-15)
    np.testing.assert_allclose(g, [[0, 0, 1], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(H, np.broadcast_to(np.diag([1 / 0.03, 0, 0]), (2, 3, 3)), atol=1e-9)


def test_a_box_as_narrow_as_its_rounding_is_a_rounded_rod():
    """Half-thickness = edge radius: distance to the segment of the core."""
    box = RoundedBox(0.04, 0.012, 0.006)
    y = np.random.default_rng(3).uniform(-0.03, 0.03, (100, 3)) + [0, 0, 0.04]
    on_segment = np.clip(y[:, 0], -0.014, 0.014)
    core = np.column_stack([on_segment, np.zeros(100), np.full(100, -0.006)])
    np.testing.assert_allclose(box.signed_distance(y)[0],
                               np.linalg.norm(y - core, axis=1) - 0.006, atol=1e-14)


def test_sphere_is_smooth_through_its_axis():
    d, g, H = SHAPES['sphere'].signed_distance([[0.0, 0.0, 0.012], [0.0, 0.0, -0.012]])
    np.testing.assert_allclose(d, 0.002)
    np.testing.assert_allclose(g, [[0, 0, 1], [0, 0, -1]])
    np.testing.assert_allclose(H, np.broadcast_to(np.diag([1, 1, 0]) / 0.012, (2, 3, 3)))


@pytest.mark.parametrize('direction', [[0, 0, -2.0], [1.0, 0, 0], [0.3, -0.5, 0.1]])
def test_placed_is_a_pose_with_z_along_the_direction(direction):
    X = placed([1.0, 2.0, 3.0], direction)
    np.testing.assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-15)
    assert np.linalg.det(X[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(X[:3, 2], direction / np.linalg.norm(direction))
    np.testing.assert_array_equal(X[:, 3], [1.0, 2.0, 3.0, 1.0])


@pytest.mark.parametrize('make', [lambda: Sphere(0.0), lambda: Disc(0.01, 0.0),
                                  lambda: Disc(0.01, 0.02), lambda: RoundedBox(0.04, 0.01, 0.006),
                                  lambda: CurvedProbe(0.03, 0.01, 0.006),
                                  lambda: placed([0, 0, 0], [0, 0, 0])])
def test_refuses_shapes_without_a_normal(make):
    with pytest.raises(ConfigError, match='must'):
        make()
