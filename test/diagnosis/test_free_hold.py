"""A hand on a block that is glued by one end: shapes it is held in, and markers beside them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.scene import Marker, Material, MeshFile, PointLoad, Region, Scene
from arm_brachy.diagnosis.free_vibration.initial_shape import hold_shapes, seen_held
from arm_brachy.diagnosis.free_vibration.model import FreeModel, free_specimen
from arm_brachy.diagnosis.free_vibration.observation import FreePriors
from arm_brachy.tissue.box import box_mesh

SIZE = (0.08, 0.02, 0.02)       # m, glued at x = 0
PLACES = {f'{x:g}_{k}': (0.02 * x, y, z) for x in (1, 2, 3, 4)
          for k, (y, z) in enumerate(((0.002, 0.02), (0.018, 0.02), (0.02, 0.004)))}
BASE = {'b0': (-0.01, -0.03, 0.0), 'b1': (-0.01, 0.05, 0.0), 'b2': (-0.01, 0.0, 0.04)}
USUAL, PRIORS = 0.1e-3, FreePriors()


@pytest.fixture(scope='module')
def scene(tmp_path_factory):
    mesh = box_mesh(SIZE, (6, 2, 2))
    path = tmp_path_factory.mktemp('hold') / 'block.npz'
    np.savez(path, nodes=mesh.nodes, tets=mesh.tets)
    return Scene('block', MeshFile(str(path)),
                 Region('half_space', point=(1e-6, 0.0, 0.0), normal=(-1.0, 0.0, 0.0)),
                 material=Material(100e3, 0.48, 1000.0), dynamics='implicit',
                 markers=tuple(Marker(n, p) for n, p in PLACES.items()))


@pytest.fixture(scope='module')
def shapes(scene):
    return np.array([one.points for one in hold_shapes(free_specimen(scene), 0.05)])


def bent(scene, place, way):
    """(k, 3) [m] of all markers by a static force of 0.02 N at `place` along `way`."""
    load = PointLoad('hand', place, 0.02)
    light = replace(scene.material, density=1.0)
    specimen = free_specimen(replace(scene, material=light, loads=(load,), gravity=way))
    return FreeModel(specimen).swing(np.array([1.0])).moved[-1]


def test_the_first_is_a_bend_of_a_twentieth_of_the_length(shapes):
    """Its standard deviation; a cantilever's second bend is 6.3 times as fast, a sixth as far."""
    far = np.linalg.norm(shapes, axis=2)
    assert far[0].max() == pytest.approx(0.05 * 0.08, rel=0.03)
    bends = [k for k in range(len(far)) if far[k].max() < 0.3 * far[0].max()]
    assert bends and (np.diff(far.max(axis=1)) < 1e-4).all()


@pytest.mark.parametrize('place', [(0.08, 0.01, 0.0), (0.04, 0.01, 0.02), (0.08, 0.02, 0.01)],
                         ids=['tip', 'half way', 'tip, aside'])
def test_what_a_finger_does_is_among_them(scene, shapes, place):
    """Anywhere, up or aside: to 2 % of it, statics against vibrations."""
    for way in ((0.0, 0.0, 1.0), (0.0, 1.0, 0.3)):
        held = bent(scene, place, way)
        A = shapes.reshape(len(shapes), -1).T
        left = held.ravel() - A @ np.linalg.lstsq(A, held.ravel(), rcond=None)[0]
        assert np.linalg.norm(held) > 1e-4
        assert np.linalg.norm(left) < 0.02 * np.linalg.norm(held)


def test_a_twist_that_points_on_the_axis_hardly_show_is_none_of_them(scene):
    """It would be a whole turn where these move by a millimetre."""
    axis = tuple(Marker(f'axis_{x}', (0.02 * x, 0.01, 0.01)) for x in (1, 2, 3, 4))
    found = hold_shapes(free_specimen(replace(scene, markers=axis)), 0.05)
    assert len(found) >= 4
    for one in found:
        assert np.abs(one.nodes).max() < 10.0 * np.linalg.norm(one.points, axis=1).max()


def low(scene):
    """(12, 3) [m] of markers on the tissue: held by its end, 3 mm too low."""
    way = bent(scene, (0.08, 0.01, 0.0), (0.0, 0.0, -1.0))
    return 3e-3 / np.abs(way).max() * way


def held(scene, off=0.0):
    """A release held too low, in a frame that is turned by 2 degrees; markers off their places."""
    rng = np.random.default_rng(3)
    points = np.vstack([list(PLACES.values()), list(BASE.values())])
    there = np.cross([0.01, -0.02, 0.02], points) + np.array([1e-3, 2e-3, -1e-3])
    there += rng.normal(0.0, off, there.shape)
    there[:len(PLACES)] += low(scene)
    return SimpleNamespace(names=tuple(PLACES), held=there[:len(PLACES)], base_names=tuple(BASE),
                           base_rest=points[len(PLACES):], base_held=there[len(PLACES):])


def test_how_it_was_held_is_told_from_how_the_tracker_stands(scene):
    """By the markers on the base, whose places are known to a tenth of a millimetre."""
    found = seen_held(held(scene), free_specimen(scene), PRIORS, USUAL)
    assert found.placement == pytest.approx(USUAL, rel=0.01)
    assert found.bent.points == pytest.approx(low(scene), abs=0.15e-3)
    doubt = np.sqrt(np.sum(found.doubt ** 2, axis=0))
    assert np.abs(found.bent.points - low(scene)).max() < 3.0 * doubt.max() < 1e-3


def test_what_neither_hand_nor_frame_does_is_an_error_of_places(scene):
    """45 numbers, 14 of them taken by hand and frame: to 13 % of a standard deviation."""
    found = seen_held(held(scene, off=1e-3), free_specimen(scene), PRIORS, USUAL)
    assert found.placement == pytest.approx(1e-3, rel=0.3)
