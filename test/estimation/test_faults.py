"""Faults of the markers on the estimators as they are: named, withheld or wide, never sure."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from arm_brachy.cell import Body
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.scene import Marker
from arm_brachy.estimation import kf_admm, pod
from arm_brachy.estimation import map as map_estimator
from arm_brachy.estimation.live import EstimationParams, LiveEstimator
from arm_brachy.estimation.map import MapParams
from arm_brachy.estimation.marker_motion import MarkerMotion
from arm_brachy.estimation.pod_params import PodParams
from arm_brachy.estimation.unknowns import PriorParams

PERIOD, PUSH = 0.1, np.array([0.003, 0.0])
SMALL = {'modulus_modes': 8, 'force_modes': 4}
BUILDERS = {
    'kf_admm': lambda *a: kf_admm.build(*a),
    'pod': lambda *a: pod.build(*a, PodParams(prior=PriorParams(
        faces=0.0, load_places=0, **SMALL))),
    'map': lambda *a: map_estimator.build(*a, MapParams(prior=PriorParams(
        load_places=6, **SMALL)))}
CHANCE = 1e-4   # of a truth outside the ellipsoid; the plant is the model


@pytest.fixture(scope='module')
def scene(block):
    base = tuple(Marker(f'base_{i}', place, 'base') for i, place in enumerate(
        ((-0.03, -0.03, 0.0), (0.09, -0.03, 0.0), (0.09, 0.11, 0.0), (-0.03, 0.11, 0.01))))
    return block.replace(block.scene, markers=(*block.scene.markers, *base))


@pytest.fixture(scope='module')
def plant(scene):
    """Names and (20, m + 2, 3) [m] points of a push within a second and a hold of another."""
    body = Body(scene, ())
    q = np.minimum(PERIOD * np.arange(20), 1.0)[:, None] * PUSH
    return SimpleNamespace(names=body.point_names, q=q, points=np.array(
        [body.step(PERIOD * k, at).points for k, at in enumerate(q)]))


@pytest.fixture(scope='module', params=list(BUILDERS))
def estimator(request, scene, block):
    return BUILDERS[request.param](scene, (), block.targets, block.markers)


@pytest.fixture
def live(scene, estimator):
    estimator.reset()
    return LiveEstimator(estimator, MarkerMotion(scene, ()), EstimationParams(), (2e-5, 9e-5))


def run(live, plant, fault=None, start=12, silent=False):
    """Steps of the session; from frame `start` on, frames are what `fault(points)` makes of them.

    Returns (steps before the fault, steps under it).
    """
    steps, rng = [], np.random.default_rng(4)
    markers = len(plant.names) - 2
    for k, (q, points) in enumerate(zip(plant.q, plant.points, strict=True)):
        points = points[:markers] + 2e-5 * rng.standard_normal((markers, 3))
        if k >= start and fault is not None:
            points = fault(points)
        live.feel(PERIOD * k, q)
        if not (silent and k >= start):
            live.see(PERIOD * k, plant.names[:markers], points)
        steps.append(live.step(PERIOD * k))
    return ([s for s in steps[:start] if s is not None], [s for s in steps[start:]
                                                          if s is not None])


def holds(step, plant, k):
    """True if the ellipsoids of a step hold the targets of frame k."""
    off = step.estimate.points - plant.points[k, -2:]
    squared = [o @ np.linalg.solve(P, o) for o, P in zip(off, step.estimate.covariance,
                                                         strict=True)]
    return max(squared) < chi2.ppf(1.0 - CHANCE, 3)


def volume(step):
    return np.linalg.det(step.estimate.covariance)


def test_without_a_fault_nothing_is_named(live, plant):
    _, steps = run(live, plant)
    assert {s.outcome for s in steps} == {Outcome.OK}
    assert all(holds(s, plant, 12 + k) for k, s in enumerate(steps))


def test_two_markers_are_too_few(live, plant):
    def occluded(points):
        points[:4] = np.nan
        return points

    before, steps = run(live, plant, occluded)
    assert before[-1].outcome is Outcome.OK
    assert {s.outcome for s in steps} == {Outcome.TOO_FEW_MARKERS}
    assert all(s.estimate is None for s in steps)


def test_hidden_markers_make_no_ellipse_smaller(live, plant):
    def occluded(points):
        points[:3] = np.nan
        return points

    before, steps = run(live, plant, occluded)
    assert all(holds(s, plant, 12 + k) for k, s in enumerate(steps))
    assert (volume(steps[-1]) > 0.9 * volume(before[-1])).all()


def test_swapped_labels_are_put_right(live, plant):
    def swapped(points):
        points[[0, 5]] = points[[5, 0]]
        return points

    _, steps = run(live, plant, swapped)
    assert Outcome.MARKERS_SWAPPED in {s.outcome for s in steps}
    assert all(holds(s, plant, 12 + k) for k, s in enumerate(steps))


def test_a_marker_off_by_20_mm_is_left_out(live, plant):
    def off(points):
        points[2] += [0.0, 0.0, 20e-3]
        return points

    before, steps = run(live, plant, off)
    assert {s.outcome for s in steps} == {Outcome.MARKERS_REJECTED}
    assert all('m10' in s.message for s in steps)
    assert all(holds(s, plant, 12 + k) for k, s in enumerate(steps))
    assert (volume(steps[-1]) > 0.9 * volume(before[-1])).all()


def test_silence_is_named_and_nothing_is_said(live, plant):
    _, steps = run(live, plant, silent=True)
    assert steps[-1].outcome is Outcome.STALE_INPUT
    assert all(s.estimate is None for s in steps)


def test_another_scene_is_named(live, plant):
    before, steps = run(live, plant, lambda points: 1.3 * points, start=0)
    assert steps[-1].outcome in (Outcome.WRONG_SCENE, Outcome.LOST_REGISTRATION)
    assert all(s.estimate is None for s in steps)
