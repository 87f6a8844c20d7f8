"""Body: what a term changes about the tissue at rest, markers, targets and pads take part in."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.cell import Body
from arm_brachy.control.tissue_model import TissueModel
from arm_brachy.core.errors import NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.tissue.terms.breathing import Breathing
from arm_brachy.tissue.terms.pad_misplacement import PadMisplacement
from arm_brachy.tissue.terms.reference_shape import ReferenceShape

TALLER = ReferenceShape(height=0.03)


@pytest.fixture(scope='module')
def scene():
    """The breast with linear elements: what rides on it does not depend on their order."""
    given = load_scene(share_dir() / 'config' / 'scenes' / 'breast.yaml')
    return dataclasses.replace(given, element='linear')


def rest_points(scene, *terms):
    """Names and positions (k, 3) [m] of markers and targets with the pads at zero."""
    reading = Body(scene, terms).step(0.0, np.zeros(len(scene.pads)))
    return reading.names, reading.points


def test_points_sit_on_the_true_shape(scene):
    """Three per cent more height at rest for the tissue; the base plate stays.

    A pad is pushed level at the side of a dome: what is taller reaches out to it, and its actuator
    is mounted no higher than it was.
    """
    (names, plain), (_, taller) = rest_points(scene), rest_points(scene, TALLER)
    carriers = {m.name: m.body for m in scene.markers}
    direction = {p.name: np.array(p.direction) for p in scene.pads}
    for name, before, after in zip(names, plain, taller, strict=True):
        carrier = carriers.get(name, 'tissue')
        expected = before * [1.0, 1.0, 1.03] if carrier == 'tissue' else before
        if carrier in direction:
            nearer = (before - after) @ direction[carrier]
            assert 1e-4 < nearer < 0.03 * before[2]  # all of it were the dome's side at 45 degrees
            expected = before - nearer * direction[carrier]
        # the mesh's base is plane to 1e-3, and so is its normal: 3 % of that at 60 mm
        np.testing.assert_allclose(after, expected, rtol=0.0, atol=2e-6, err_msg=name)


def test_model_and_plant_of_one_shape_agree_on_targets(scene):
    model, (names, points) = TissueModel(scene, (TALLER,)), rest_points(scene, TALLER)
    for target in scene.targets:
        np.testing.assert_allclose(model.rest(target.name), points[names.index(target.name)],
                                   rtol=0.0, atol=1e-8)


def test_a_misplaced_pad_takes_its_marker_along_and_leaves_the_tissue(scene):
    moved = PadMisplacement(up=1e-3, side=2e-3, pads=('pad_1',))
    (names, plain), (_, after) = rest_points(scene), rest_points(scene, moved)
    for name, here, there in zip(names, plain, after, strict=True):
        if name == 'pad_1':  # on +x, pushing along -x: up is z, side is y
            np.testing.assert_allclose((there - here)[1:], [2e-3, 1e-3], atol=1e-12)
            assert abs(there[0] - here[0]) < 1e-3  # along the slope of the surface
        else:
            np.testing.assert_allclose(there, here, rtol=0.0, atol=1e-9, err_msg=name)


def test_a_tilted_pad_is_pushed_along_its_own_direction(scene):
    body = Body(scene, (PadMisplacement(tilt_up=0.1, pads=('pad_1',)),))
    start, pushed = body.step(0.0, np.zeros(4)), body.step(1.0, np.array([2e-3, 0.0, 0.0, 0.0]))
    way = 2e-3 * np.array([-np.cos(0.1), 0.0, np.sin(0.1)])
    np.testing.assert_allclose(pushed.pad_displacement[0], way, atol=1e-12)
    at = start.names.index('pad_1')
    np.testing.assert_allclose(pushed.points[at] - start.points[at], way, atol=1e-12)


def test_a_tilted_pad_swings_its_marker_about_its_centre(scene):
    """A marker L behind the pad on -d goes to L behind it on the new -d: down where d goes up."""
    centre, at = np.array(scene.pads[0].centre), [m.name for m in scene.markers].index('pad_1')
    behind = dataclasses.replace(scene.markers[at], position=tuple(centre + [0.012, 0.0, 0.0]))
    scene = dataclasses.replace(scene, markers=(*scene.markers[:at], behind,
                                                *scene.markers[at + 1:]))
    _, points = rest_points(scene, PadMisplacement(tilt_up=0.1, pads=('pad_1',)))
    way = 0.012 * np.array([np.cos(0.1), 0.0, -np.sin(0.1)])
    np.testing.assert_allclose(points[at] - centre, way, atol=1e-12)


def test_model_and_plant_of_a_misplaced_pad_agree_on_targets(scene):
    terms = (PadMisplacement(up=2e-3, tilt_side=0.05, pads=('pad_2',)),)
    model, body, q = TissueModel(scene, terms), Body(scene, terms), np.array([0.0, 3e-3, 0.0, 0.0])
    body.step(0.0, np.zeros(4))
    reading = body.step(1.0, q)
    for target in scene.targets:
        np.testing.assert_allclose(model.evaluate(q, target.name).position,
                                   reading.points[reading.names.index(target.name)],
                                   rtol=0.0, atol=1e-7)


def test_base_markers_breathe_and_pad_markers_do_not(scene):
    breath = Breathing(amplitude=2e-3, frequency=0.25, direction=(0.0, 1.0, 0.0))
    body = Body(scene, (breath,))
    carriers = {m.name: m.body for m in scene.markers}
    start = body.step(0.0, np.zeros(4))
    crest = body.step(1.0, np.zeros(4))
    assert crest.outcome.ok
    way = dict(zip(crest.names, crest.points - start.points, strict=True))
    for name, carrier in carriers.items():
        if carrier == 'base':
            np.testing.assert_allclose(way[name], [0.0, 2e-3, 0.0], atol=1e-12)
        elif carrier != 'tissue':
            np.testing.assert_array_equal(way[name], np.zeros(3))
    low = [way[m.name][1] for m in scene.markers if m.body == 'tissue' and m.position[2] < 0.015]
    assert 0.0 < np.mean(low) < 2e-3  # held by the pads, drawn along by the base


def test_an_equilibrium_that_is_not_there_is_looked_for_ever_less_often(scene, monkeypatch):
    """Pads driven into each other: four tries, then after 1, 2, 4, 8; at once as pads return."""
    body, crushed, tries = Body(scene, ()), np.full(len(scene.pads), 0.06), []
    body.step(0.0, 0.0 * crushed)
    simulator = body._simulator

    def in_vain(t, *_):
        tries.append(round(t / 0.05))
        return dataclasses.replace(simulator.state, t=t, outcome=Outcome.NOT_CONVERGED)

    monkeypatch.setattr(simulator, 'step', in_vain)
    readings = [body.step(0.05 * k, crushed) for k in range(1, 21)]
    assert tries == [1, 2, 3, 4, 5, 7, 11, 19]
    assert all(r.outcome is Outcome.NOT_CONVERGED for r in readings)
    assert [r.t for r in readings] == [0.05 * k for k in range(1, 21)]
    monkeypatch.undo()
    assert body.step(1.05, 0.01 * crushed).outcome.ok


def test_a_body_without_an_equilibrium_stands_still_and_is_refused_once_it_has_for_long(scene):
    """Pads driven into each other; once they are back, the body moves again."""
    body, crushed = Body(scene, ()), np.full(len(scene.pads), 0.06)
    first = body.step(0.0, 0.0 * crushed)
    for t in (0.5, 2.0):
        stuck = body.step(t, crushed)
        assert not stuck.outcome.ok and np.array_equal(stuck.points[-1], first.points[-1])
    assert body.step(2.1, 0.01 * crushed).outcome.ok
    assert not body.step(4.0, crushed).outcome.ok
    with pytest.raises(NotConverged, match=r'no equilibrium since 2\.10 s \(\w+\), with pads at '
                                           r'60\.0, 60\.0, 60\.0, 60\.0 mm; must be'):
        body.step(4.2, crushed)
