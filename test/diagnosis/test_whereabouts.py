"""Places that are told: around markers that move as nothing explains."""

import numpy as np
import pytest

from arm_brachy.core.scene import Marker, MeshFile, Region, Scene
from arm_brachy.diagnosis.report.localisation import marker_place

SCENE = Scene('three', MeshFile('none.msh'), Region('half_space'), markers=(
    Marker('a', (0.0, 0.0, 0.0)), Marker('b', (0.03, 0.0, 0.0)), Marker('c', (0.0, 0.04, 0.0))))


def test_a_place_lies_among_the_markers_that_move_most():
    place = marker_place(SCENE, {'a': 1.0, 'b': 1.0, 'c': 0.0})
    assert place.position == pytest.approx((0.015, 0.0, 0.0))
    assert place.radius == pytest.approx(0.015)


def test_around_one_marker_alone_it_reaches_to_the_next():
    place = marker_place(SCENE, {'b': 2.0})
    assert place.position == pytest.approx((0.03, 0.0, 0.0)) and np.isfinite(place.radius)
    assert place.radius == pytest.approx(0.03)


def test_of_a_single_marker_nothing_is_known_around_it():
    assert marker_place(SCENE, {}) is None
    alone = Scene('one', MeshFile('none.msh'), Region('half_space'), markers=SCENE.markers[:1])
    assert marker_place(alone, {'a': 1.0}) is None
