"""Markers of a block are named where the eye sees the face under them."""

import numpy as np
import pytest

from arm_brachy.evaluation.body_place import Body
from arm_brachy.evaluation.scene_plate import SIDES, scene_plate
from arm_brachy.tissue.box import box_mesh

MARKERS = {'top': (0.03, 0.02, 0.0305), 'front': (0.03, -0.0005, 0.015),
           'back': (0.03, 0.0405, 0.015), 'end': (0.0605, 0.02, 0.015),
           'bottom': (0.03, 0.02, -0.0005), 'start': (-0.0005, 0.02, 0.015)}
SEEN = (['top'], ['front'], ['end'], ['bottom'], ['back'], ['start'])


@pytest.fixture(scope='module')
def axes():
    mesh = box_mesh((0.06, 0.04, 0.03), (6, 4, 3))
    body = Body(mesh.nodes, mesh.tets, (), {n: np.array(p) for n, p in MARKERS.items()})
    return scene_plate(body).figure.axes


@pytest.mark.parametrize('i', range(len(SIDES)))
def test_a_side_names_the_markers_on_it(axes, i):
    assert [text.get_text() for text in axes[i].texts] == SEEN[i]


def test_what_is_across_runs_to_the_right_as_the_eye_has_it(axes):
    """Right of the eye is forward x up."""
    for axis, view in zip(axes, SIDES, strict=True):
        right = np.cross(-np.array(view.toward), np.eye(3)[view.up])
        assert axis.xaxis_inverted() == (right[view.across] < 0.0)
