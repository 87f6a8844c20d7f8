"""Holes, and where the picture shows them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import InputError
from arm_brachy.robot.template import (
    ImageGeometry,
    Template,
    TemplateParams,
    base_to_image,
    pixels,
)

IMAGE = ImageGeometry(640, 300, (640 / 0.038, 300 / 0.050))
PROBE = Rotation.from_euler('xyz', [95.0, 8.0, -12.0], degrees=True).as_matrix()
FACE = np.array([0.012, -0.008, 0.055])
TEMPLATE = Template(TemplateParams(), Rotation.from_euler('x', -90, degrees=True).as_matrix(),
                    np.array([0.0, -0.10, 0.03]))


def test_the_middle_of_the_face_is_in_the_middle_of_the_first_row():
    u, v, off = pixels(base_to_image(PROBE, FACE, IMAGE), FACE)[0]
    assert np.allclose([u, v, off], [(640 - 1) / 2, 0.0, 0.0])


def test_millimetres_across_and_deep_become_their_pixels():
    point = FACE + PROBE @ [0.003, 0.0007, 0.02]
    u, v, off = pixels(base_to_image(PROBE, FACE, IMAGE), point)[0]
    assert np.allclose([u, v], [319.5 + 0.003 * 640 / 0.038, 0.02 * 300 / 0.05])
    assert np.isclose(off, 0.0007)


def test_scaling_before_turning_as_printed_would_miss():
    """With unequal scales A B C and S B A differ by many pixels: what the correction is about."""
    point = FACE + PROBE @ [0.01, 0.0, 0.02]
    stretched = np.diag([*IMAGE.scale, 1.0])[[0, 2, 1]]
    printed = PROBE.T @ (stretched @ (point - FACE))
    u, v, _ = pixels(base_to_image(PROBE, FACE, IMAGE), point)[0]
    assert np.hypot(printed[0] + 319.5 - u, printed[2] - v) > 10.0


def test_holes_are_a_pitch_apart_across_the_axis():
    step = TEMPLATE.hole(7, 6) - TEMPLATE.hole(6, 6)
    assert np.isclose(np.linalg.norm(step), 5e-3)
    assert np.isclose(step @ TEMPLATE.axis, 0.0, atol=1e-15)


def test_pierced_points_lie_on_the_holes_axes_and_in_the_plane():
    shown = TEMPLATE.in_image(PROBE, FACE, IMAGE)
    for column, row in ((0, 0), (6, 6), (12, 4)):
        u, v = shown[column, row]
        local = [(u - 319.5) / IMAGE.scale[0], 0.0, v / IMAGE.scale[1]]
        offset = FACE + PROBE @ local - TEMPLATE.hole(column, row)
        assert np.allclose(np.cross(offset, TEMPLATE.axis), 0.0, atol=1e-12)


def test_what_cannot_be_shown_is_refused():
    along = np.column_stack([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])   # normal across the needles
    with pytest.raises(InputError, match='run along the image plane'):
        TEMPLATE.in_image(along, FACE, IMAGE)
    with pytest.raises(InputError, match='column = 13; must be 0 to 12'):
        TEMPLATE.hole(13, 0)


def test_placed_stands_where_its_params_say_rows_going_up():
    template = Template.placed(TemplateParams())
    assert template.axis == pytest.approx(np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0))
    assert template.hole(6, 6) == pytest.approx([-0.0495, -0.0495, 0.027])
    assert template.hole(6, 7) - template.hole(6, 6) == pytest.approx([0.0, 0.0, 0.005])
    assert np.linalg.det(template.R) == pytest.approx(1.0)


def test_a_template_whose_up_is_along_its_needles_is_refused():
    with pytest.raises(InputError, match='must be two directions that differ'):
        Template.placed(TemplateParams(axis=(0.0, 0.0, 2.0)))
