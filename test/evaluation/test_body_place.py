"""Regions, pads and markers on the body: in their place, to scale, pointed out by name."""

import numpy as np
import pytest
from matplotlib.patches import Circle

from arm_brachy.evaluation.body_place import Body, Spot, body_place
from arm_brachy.evaluation.style import GOAL
from arm_brachy.evaluation.timeseries import PadMark

REST = np.array([[0.0, 0, 0], [0.05, 0, 0], [0, 0.05, 0], [0, 0, 0.05]])
TETS = np.array([[0, 1, 2, 3]])
PADS = (PadMark('left', np.array([-0.01, 0.01, 0.01]), np.array([1.0, 0.0, 0.0])),
        PadMark('front', np.array([0.01, -0.01, 0.01]), np.array([0.0, 1.0, 0.0])))


def texts(axis, colour):
    return {text.get_text() for text in axis.texts if text.get_color() == colour}


def test_a_region_is_a_circle_of_its_size_in_both_views():
    spot = Spot(np.array([0.010, 0.005, 0.020]), 0.004, 'here')
    above, side = body_place(Body(REST, TETS), (spot,)).figure.axes
    for axis, centre in ((above, (10.0, 5.0)), (side, (10.0, 20.0))):
        [circle] = [patch for patch in axis.patches if isinstance(patch, Circle)]
        assert circle.center == pytest.approx(centre) and circle.radius == pytest.approx(4.0)
        assert axis.get_aspect() == 1.0
        assert texts(axis, GOAL) == {'here'}


def test_a_doubtful_region_is_dashed():
    lines = [body_place(Body(REST, TETS), (Spot(REST[0], 0.01, 'x', sure),)).figure.axes[0]
             .patches[0].get_linestyle() for sure in (True, False)]
    assert lines == ['-', '--']


def test_only_what_is_named_is_pointed_out():
    body = Body(REST, TETS, PADS, {'m1': REST[1], 'm2': REST[2]})
    for axis in body_place(body, (), ('left',), ('m2',)).figure.axes:
        assert texts(axis, GOAL) == {'left', 'm2'}
    for axis in body_place(body).figure.axes:
        assert not texts(axis, GOAL)
        assert {text.get_text() for text in axis.texts} >= {'left', 'front'}


def test_a_pad_that_points_away_is_a_cross():
    _, side = body_place(Body(REST, TETS, PADS)).figure.axes
    [cross] = [line for line in side.get_lines() if line.get_marker() == 'X']
    assert (cross.get_xdata()[0], cross.get_ydata()[0]) == pytest.approx((10.0, 10.0))
