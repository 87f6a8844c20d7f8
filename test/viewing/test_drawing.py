"""What is drawn where: forces at their pads, ellipsoids of covariances, truth by its own name."""

import numpy as np
import pytest
from scipy.stats import chi2

from arm_brachy.viewing import drawing
from arm_brachy.viewing.drawing import Pad, Seen, Stage, Truth, draw, draw_truth, ellipsoid
from arm_brachy.viewing.shapes import Kind
from arm_brachy.viewing.surface import thinned

PAD = Pad('pad_1', np.array([0.06, 0.0, 0.03]), np.array([-1.0, 0.0, 0.0]), 0.02)
STAGE = Stage(pads=(PAD,), full_colour=0.01, arrow=0.005)
TETRA = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array(
    [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def only(shapes, kind):
    found, = (s for s in shapes if s.kind is kind)
    return found


def test_the_face_of_a_pad_is_where_its_encoder_says():
    disc = only(draw(STAGE, Seen(travel={'pad_1': 0.01})), Kind.DISC)
    face = disc.points[0] + 0.5 * disc.scale[2] * disc.axes[:, 2]
    assert np.allclose(face, [0.05, 0.0, 0.03]) and np.allclose(disc.axes[:, 2], PAD.direction)
    assert disc.scale[0] == pytest.approx(0.04)


def test_a_force_begins_at_its_displaced_pad_and_is_as_long_as_the_scale_says():
    arrow = only(draw(STAGE, Seen(travel={'pad_1': 0.01}, forces={'pad_1': [2.0, 0.0, 1.0]})),
                 Kind.ARROW)
    assert np.allclose(arrow.points, [[0.05, 0.0, 0.03], [0.06, 0.0, 0.035]])


def test_noise_of_the_sensor_is_no_arrow():
    assert not [s for s in draw(STAGE, Seen(forces={'pad_1': [0.01, 0.0, 0.0]}))
                if s.kind is Kind.ARROW]


def test_the_ellipsoid_holds_95_percent_of_a_gaussian():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3)) * 1e-3
    axes, diameters = ellipsoid(root @ root.T)
    draws = rng.normal(size=(200_000, 3)) @ root.T
    inside = (((draws @ axes) / (diameters / 2)) ** 2).sum(axis=1) <= 1.0
    assert inside.mean() == pytest.approx(0.95, abs=0.002)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert pytest.approx(chi2.ppf(0.95, 3), abs=1e-3) == drawing.CHI2_95


def test_colour_of_the_tissue_is_its_displacement():
    nodes, faces = TETRA
    moved = nodes + np.array([[0.0, 0, 0], [0.005, 0, 0], [0, 0, 0], [0, 0.01, 0]])
    shape = only(draw(STAGE, Seen(surface=(thinned(nodes, faces, 9), moved),
                                  surface_from='map')), Kind.TRIANGLES)
    assert shape.layer == 'tissue by map' and np.array_equal(shape.triangles, faces)
    assert np.allclose(shape.points, moved) and np.allclose(shape.shades, [0.0, 0.5, 0.0, 1.0])


def test_only_what_is_called_true_is_true():
    nodes, faces = TETRA
    truth = Truth((thinned(nodes, faces, 9), nodes), {'target_1': np.zeros(3)}, np.eye(3))
    assert {s.layer.split()[0] for s in draw_truth(STAGE, truth)} == {'true'}
    seen = Seen(travel={'pad_1': 0.0}, tools={'target_1': np.zeros(3)},
                goal=(np.zeros(3), 'target_1'), estimates={
                    ('map', 'target_1'): (np.zeros(3), np.eye(3) * 1e-6)})
    assert not [s for s in draw(STAGE, seen) if 'true' in s.layer]


def test_needle_probe_and_image_stand_where_their_poses_are():
    R = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])   # the probe looks down
    stage = Stage(image=(0.04, 0.05))
    shapes = draw(stage, Seen(probe=(R, np.array([0, 0, 0.06])), tip=(np.eye(3), np.zeros(3)),
                              needle_depth=0.03))
    needle, plane = only(shapes, Kind.LINE), only(shapes, Kind.TRIANGLES)
    assert np.allclose(needle.points, [[0, 0, -0.03], [0, 0, 0]])
    assert np.allclose(plane.points.min(axis=0), [-0.02, 0, 0.01])
    assert np.allclose(plane.points.max(axis=0), [0.02, 0, 0.06])
    head = only(shapes, Kind.BOX)
    assert head.points[0, 2] - 0.06 == pytest.approx(head.scale[2] / 2)   # above the face
