"""Markers of a block are named where the eye sees the face under them."""

import numpy as np
import pytest
from matplotlib.colors import to_hex

from arm_brachy.evaluation.scene_plate import HELD, SIDES, WRONG, SceneBody, scene_plate
from arm_brachy.evaluation.timeseries import PadMark
from arm_brachy.tissue.box import box_mesh

MARKERS = {'top': (0.03, 0.02, 0.0305), 'front': (0.03, -0.0005, 0.015),
           'back': (0.03, 0.0405, 0.015), 'end': (0.0605, 0.02, 0.015),
           'bottom': (0.03, 0.02, -0.0005), 'start': (-0.0005, 0.02, 0.015)}
SEEN = (['top'], ['front'], ['end'], ['bottom'], ['back'], ['start'])


@pytest.fixture(scope='module')
def axes():
    mesh = box_mesh((0.06, 0.04, 0.03), (6, 4, 3))
    body = SceneBody(mesh.nodes, mesh.tets, (), {n: np.array(p) for n, p in MARKERS.items()})
    return scene_plate(body).figure.axes


@pytest.mark.parametrize('i', range(len(SIDES)))
def test_a_side_names_the_markers_on_it(axes, i):
    assert [text.get_text() for text in axes[i].texts] == SEEN[i]


def test_what_is_across_runs_to_the_right_as_the_eye_has_it(axes):
    """Right of the eye is forward x up."""
    for axis, view in zip(axes, SIDES, strict=True):
        right = np.cross(-np.array(view.toward), np.eye(3)[view.up])
        assert axis.xaxis_inverted() == (right[view.across] < 0.0)


def test_what_is_held_pads_targets_and_what_is_wrong_are_drawn():
    """Held below z = 1 mm; a pad of 8 mm on the end, seen as a circle of that size end on."""
    mesh = box_mesh((0.06, 0.04, 0.03), (6, 4, 3))
    pad = PadMark('east', np.array([0.06, 0.02, 0.015]), np.array([-1.0, 0.0, 0.0]))
    body = SceneBody(mesh.nodes, mesh.tets, (pad,), {'deep': np.array([0.03, 0.02, 0.015])},
                     held=np.flatnonzero(mesh.nodes[:, 2] < 1e-3), radii={'east': 8e-3},
                     targets={'lump': np.array([0.02, 0.02, 0.01])})
    above, side, end, below, *_ = scene_plate(body, ['deep']).figure.axes
    held = [c for c in below.collections if len(c.get_facecolor()) == 1
            and to_hex(c.get_facecolor()[0]) == HELD]
    assert len(held) == 1 and len(held[0].get_paths()) == 2 * 6 * 4
    rim = max((line.get_xydata() for line in end.lines), key=len)
    assert np.ptp(rim, axis=0) == pytest.approx([16.0, 16.0], rel=1e-2)
    assert rim.mean(axis=0) == pytest.approx([20.0, 15.0], abs=0.3)
    red = [line.get_xydata()[0] for line in above.lines if line.get_color() == WRONG]
    assert red and red[0] == pytest.approx([30.0, 20.0])
    assert 'lump' in [t.get_text() for t in above.texts]
    assert 'lump' not in [t.get_text() for t in side.texts]
