"""Loads of probe and needle: force, place and moment are those that are measured."""

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.estimation.known_load import (
    beside,
    instrument_loads,
    needle_loads,
    nodal_forces,
    probe_load,
)
from arm_brachy.robot.reference import rotation
from arm_brachy.tissue.probe_face import ProbeFace

FACE = ProbeFace()
R = rotation(np.array([2.5, 0.4, -0.3]))
P = np.array([0.01, -0.02, 0.05])


def grid():
    """Nodes (n, 3) [m], 3 mm apart, around P, and what each stands for."""
    axis = np.arange(-0.06, 0.0601, 0.003)
    x = np.stack(np.meshgrid(axis, axis, axis, indexing='ij'), axis=-1).reshape(-1, 3) + P
    return x, np.ones(len(x))


def felt(force, at):
    """(6,) wrench about the middle of the face of a force (3,) that acts at (3,), its axes."""
    return np.concatenate([force, np.cross(at, force)])


@pytest.mark.parametrize('at', [(0.0, 0.0, 0.0), (0.012, 0.002, 0.0), (-0.006, -0.004, 0.0)])
def test_force_and_moment_of_a_probe_act_on_the_nodes(at):
    """On 50 mm of nodes, about the middle of the face: within what a face of 10 mm is cut by."""
    force = np.array([0.2, -0.1, -3.0])
    load = probe_load(R, P, felt(force, np.array(at)), FACE.width, FACE.thickness)
    x, volume = grid()
    f = nodal_forces((load,), x, volume)
    assert np.allclose(f.sum(axis=0), -R @ force, atol=1e-12)
    moment = R.T @ np.cross(x - P, f).sum(axis=0)
    assert np.allclose(moment[:2], -np.cross(at, force)[:2], atol=1e-3)     # 3 N at 0.3 mm


def test_a_centre_of_pressure_beyond_the_face_is_at_its_edge_and_a_touch_has_none():
    for wrench, place in ((felt(np.array([0.0, 0.0, -2.0]), np.array([0.05, 0.0, 0.0])),
                           P + R[:, 0] * 0.5 * FACE.width),
                          (np.array([0.0, 0.0, -0.01, 0.1, 0.1, 0.0]), P)):
        load = probe_load(R, P, wrench, FACE.width, FACE.thickness)
        assert np.allclose(load.place, place)


def test_a_needle_drags_along_its_axis_by_what_holds_it_back():
    tip, shaft = needle_loads(R, P, 0.8, 0.06)
    x, volume = grid()
    f = nodal_forces((tip, shaft), x, volume)
    assert np.allclose(f.sum(axis=0), 0.8 * R[:, 2])
    assert np.allclose(tip.place, P) and np.allclose(shaft.place, P - 0.03 * R[:, 2])
    along = (x - P) @ R[:, 2]
    assert f[along > 0.015].sum(axis=0) @ R[:, 2] < 0.01       # nothing far before the tip


def test_instruments_that_touch_nothing_are_no_load():
    assert instrument_loads(None, None, FACE) == ()
    assert len(instrument_loads((R, P, np.zeros(6)), (R, P, 0.5, 0.05), FACE)) == 3
    assert instrument_loads(None, (R, P, 0.5, 0.008), FACE, skin=0.01) == ()    # still in air
    _, shaft = instrument_loads(None, (R, P, 0.5, 0.05), FACE, skin=0.01)
    assert np.allclose(shaft.place, P - 0.02 * R[:, 2])


@pytest.mark.parametrize(('probe', 'needle'), [
    ((R, P, np.full(6, np.nan)), None), (None, (R, P, np.inf, 0.05)),
    ((np.full((3, 3), np.nan), P, np.zeros(6)), None)])
def test_what_is_no_number_is_refused(probe, needle):
    with pytest.raises(InputError, match='no number'):
        instrument_loads(probe, needle, FACE)


def test_a_point_under_a_face_is_told_from_one_beside_it():
    load = probe_load(R, P, felt(np.array([0.0, 0.0, -3.0]), np.zeros(3)), FACE.width,
                      FACE.thickness)
    points = P + np.array([[0.0, 0.0], [0.015, 0.0], [0.0, 0.02], [0.035, 0.0]]) @ R[:, :2].T
    assert beside((load,), points).tolist() == [False, False, True, True]
    assert beside((), points).all()
