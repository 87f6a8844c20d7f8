"""The study of the inside in little: one plant, two experiments, two seeds, a coarse mesh."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.errors import NotConverged
from arm_brachy.core.outcome import Outcome
from arm_brachy.estimation.estimate import Estimate
from arm_brachy.experiments import (
    inside_estimators,
    inside_measurements,
    inside_plants,
    inside_study,
    table_4_1,
)
from arm_brachy.experiments.inside_estimators import Entry

SEEDS = 2


@pytest.fixture(scope='module')
def scene():
    """A plant on the model's mesh: quick, and still with its term, modulus and element."""
    return replace(inside_plants.plant_scene(), mesh=inside_plants.model_scene().mesh)


@pytest.fixture(scope='module')
def pushes(scene):
    return (inside_plants.solve('inclusion', ('pad_1',), scene, (3e-3, 6e-3)),)


@pytest.fixture(scope='module')
def done(pushes):
    return {(name, count, 'inclusion'): inside_study.score(name, count, 'inclusion', pushes, SEEDS)
            for name in ('open_loop', 'rigid') for count in inside_study.MARKER_SETS}


def test_the_experiments_are_those_of_the_thesis():
    rows = [(e.number, e.pads, round(1e3 * e.depth)) for e in inside_plants.EXPERIMENTS]
    assert len(rows) == 16
    assert rows[0] == (1, ('pad_1',), 5) and rows[7] == (8, ('pad_2',), 20)
    assert rows[10] == (11, ('pad_1', 'pad_2'), 15) and rows[12] == (13, ('pad_3', 'pad_4'), 5)
    markers = inside_plants.tissue_markers(inside_plants.model_scene())
    assert {n: len(markers[keep]) for n, keep in inside_study.MARKER_SETS.items()} == {
        19: 19, 10: 10}


def test_no_plant_is_the_model():
    model, plant = inside_plants.model_scene(), inside_plants.plant_scene()
    assert plant.mesh != model.mesh and plant.material.E != model.material.E
    assert {entry['name'] for entry in inside_plants.PLANTS.values()} == {
        'inclusion', 'compressibility', 'anisotropy', 'pad_misplacement', 'base_compliance'}


def test_estimators_receive_encoders_and_markers_and_nothing_of_the_targets(scene, pushes):
    """What is built and stepped: the model's scene without terms, and surfaces without targets."""
    given = []

    class Spy:
        def __init__(self, scene, terms, targets, markers, params):
            given.append((scene, terms, targets, markers))
            self.targets = targets

        def reset(self):
            pass

        def step(self, surface):
            given.append(surface)
            return Estimate.failed(surface.t, self.targets, Outcome.REJECTED)

    entry = Entry('spy', Spy)
    original = inside_estimators.ESTIMATORS
    inside_estimators.ESTIMATORS = (*original, entry)
    try:
        scores = inside_study.score('spy', 10, 'inclusion', pushes, 1)
    finally:
        inside_estimators.ESTIMATORS = original
    assert given[0][0] == inside_plants.model_scene() and given[0][1] == ()
    truth = np.concatenate(pushes[0].targets)
    for surface in given[1:]:
        assert vars(surface).keys() == {'t', 'q', 'markers', 'frame_covariance', 'loads'}
        assert surface.loads == ()
        assert surface.markers.shape == (10, 3)
        near = np.linalg.norm(surface.markers[:, None] - truth, axis=2)
        assert np.nanmin(near) > 5e-3     # no marker is where a target is or was
    assert np.isnan(scores.error).all()
    assert inside_study.summary([scores]).failed == 1.0


def test_measured_markers_are_off_by_what_the_tracker_declares(scene, pushes):
    """Per marker: calibration and noise by the tracker, registration by its own covariance."""
    names = inside_plants.tissue_markers(scene)
    off, sizes = [], []
    for k in range(40):
        seen = inside_measurements.session(scene, pushes[0], names, 5, str(k))
        assert len(seen.surfaces) == (inside_measurements.REST_FRAMES
                                      + 2 * inside_measurements.HOLD_FRAMES)
        for end, true in zip(seen.ends, pushes[0].markers[1:], strict=True):
            off.append(seen.surfaces[end].markers - true)
        sizes.append(seen.surfaces[0].frame_covariance)
    tracker = inside_measurements.TRACKER
    about = pushes[0].markers[0].mean(axis=0)
    J = np.array([np.hstack([-inside_measurements._cross(p - about), np.eye(3)])
                  for p in pushes[0].markers[0]])
    frame = np.einsum('kia,ab,kib->k', J, sizes[0], J).mean()
    expected = np.sqrt(tracker.calibration_error**2 + tracker.noise**2 + frame)
    rms = np.sqrt(np.nanmean(np.sum(np.square(off), axis=2)))
    assert rms == pytest.approx(expected, rel=0.1)   # 40 x 19 draws of a calibration error


def test_same_seed_same_surfaces_and_another_seed_others(scene, pushes):
    names = inside_plants.tissue_markers(scene)[:4]
    one, again, other = (inside_measurements.session(scene, pushes[0], names, seed, 'x')
                         for seed in (1, 1, 2))
    assert all(np.array_equal(a.markers, b.markers, equal_nan=True)
               for a, b in zip(one.surfaces, again.surfaces, strict=True))
    assert not np.array_equal(one.surfaces[0].markers, other.surfaces[0].markers)


def test_the_smaller_set_sees_the_same_noise(scene, pushes):
    names = inside_plants.tissue_markers(scene)
    few = names[inside_study.MARKER_SETS[10]]
    params = dict(scene=scene, push=pushes[0], seed=3, name='x')
    # the frame's error turns about the markers that are known, by microradians' difference
    all_, some = (inside_measurements.session(names=n, **params) for n in (names, few))
    shift = some.surfaces[-1].markers - all_.surfaces[-1].markers[inside_study.MARKER_SETS[10]]
    assert np.nanmax(np.linalg.norm(shift, axis=1)) < 0.2e-3


def test_open_loop_is_blind_to_markers_and_beats_no_mechanics(done):
    loop = [done['open_loop', n, 'inclusion'].error for n in (19, 10)]
    np.testing.assert_array_equal(*loop)
    assert loop[0].shape == (2, SEEDS, 5)
    assert loop[0].mean() < done['rigid', 19, 'inclusion'].error.mean()


def test_table_has_rows_of_cases_and_of_plants(done):
    rows = table_4_1.summary_rows(done)
    assert [(r['estimator'], r['markers']) for r in rows] == [
        ('open_loop', 0), ('rigid', 19), ('rigid', 10)]
    assert rows[0]['thesis_mean_error_mm'] == 1.7 and rows[0]['below_open_loop_percent'] == 0.0
    assert rows[1]['mean_error_mm'] == pytest.approx(
        1e3 * done['rigid', 19, 'inclusion'].error.mean())
    assert np.isnan(rows[0]['in_95_ellipsoid_percent'])   # a baseline claims no covariance
    assert [r['plant_inclusion_mm'] for r in table_4_1.plant_rows(done)] == [
        r['mean_error_mm'] for r in rows]
    assert table_4_1.draw(done).axes[0].get_xlabel() == 'target error [mm]'


def test_coverage_of_a_gaussian_is_95_percent_and_its_interval_is_wilsons():
    """Seeds of one push count once: the interval is that of experiments times targets."""
    rng = np.random.default_rng(0)
    distance = np.sum(rng.standard_normal((40, 50, 5, 3)) ** 2, axis=3)
    share, low, high = inside_study.coverage(distance)
    assert share == pytest.approx(0.95, abs=0.01) and low < 0.95 < high
    assert high - low == pytest.approx(2 * 1.96 * np.sqrt(0.95 * 0.05 / 200), rel=0.1)
    # Agresti & Coull 1998, Am Stat 52:119: 0 of 10 gives 0 to 0.278
    assert inside_study.wilson(0.0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)


def test_distance_is_mahalanobis():
    estimate = Estimate(0.0, ('a',), np.array([[2e-3, 0.0, 0.0]]), 4e-6 * np.eye(3)[None])
    error, squared = inside_study.compare(estimate, np.zeros((1, 3)))
    assert error[0] == pytest.approx(2e-3) and squared[0] == pytest.approx(1.0)


def test_solved_plants_are_read_again(tmp_path, monkeypatch, pushes):
    """No process is started where the file of the same plant is there."""
    monkeypatch.setattr(inside_plants, 'GROUPS', (('pad_1',),))
    monkeypatch.setattr(inside_plants, 'process_pool', None)
    np.savez(inside_plants._file(tmp_path, 'inclusion', ('pad_1',)), q=pushes[0].q,
             markers=pushes[0].markers, targets=pushes[0].targets)
    read = inside_plants.plants(tmp_path, ('inclusion',))['inclusion'][0]
    np.testing.assert_array_equal(read.targets, pushes[0].targets)
    monkeypatch.setattr(inside_plants, 'PLANT_E', 1e4)
    with pytest.raises(TypeError):    # another plant: would be solved anew, in the absent pool
        inside_plants.plants(tmp_path, ('inclusion',))


class _Stiff:
    """A body whose solver manages steps of 0.3 mm, and nothing beyond 4 mm."""

    def __init__(self):
        self.at, self.refused = 0.0, 0

    def step(self, t, q):
        ok = abs(q.max() - self.at) <= 0.3e-3 and q.max() <= 4e-3
        self.refused += not ok
        self.at = q.max() if ok else self.at
        return SimpleNamespace(outcome=Outcome.OK if ok else Outcome.NOT_CONVERGED, q=q)


def test_a_plant_is_walked_in_shorter_steps_and_says_how_far_it_could_be_pushed():
    body = _Stiff()
    walk = inside_plants.Walk(body, 'stiff')
    walk.to(np.zeros(4))
    q = np.array([0.0, 3e-3, 0.0, 3e-3])
    np.testing.assert_array_equal(walk.to(q).q, q)
    assert body.refused > 0
    with pytest.raises(NotConverged, match=r'plant stiff on the way to 4.\d\d mm'):
        walk.to(2.0 * q)


def test_frames_between_are_left_out_where_an_estimate_needs_its_own_alone(pushes):
    """Of open loop, which has no memory, the errors agree and there are as many steps as ends."""
    original = inside_estimators.ESTIMATORS
    along = replace(inside_estimators.OPEN_LOOP, name='along', memory=True)
    inside_estimators.ESTIMATORS = (*original, along)
    try:
        every, ends = (inside_study.score(name, 10, 'inclusion', pushes, 1)
                       for name in ('along', 'open_loop'))
    finally:
        inside_estimators.ESTIMATORS = original
    assert np.allclose(every.error, ends.error, rtol=0.0, atol=1e-8)    # the solver's tolerance
    assert len(ends.cpu) == len(pushes[0].q) - 1 < len(every.cpu)
