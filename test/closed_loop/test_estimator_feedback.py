"""The loop closed over an estimator, and what goes wrong with markers: named, held, over again.

The estimator is a stand-in, so that these tests are of everything around it: the model linearised
at rest, moved by the mean misfit of the markers, with a standard deviation of 0.5 mm.
"""

import dataclasses
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy import cell as cells
from arm_brachy import inprocess
from arm_brachy.control.tissue_model import TissueModel
from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir
from arm_brachy.core.random import stream
from arm_brachy.estimation.estimate import Estimate
from arm_brachy.estimation.marker_motion import MarkerMotion
from arm_brachy.evaluation.assess import assess
from arm_brachy.scenario import Scenario, resolve

PATH = config_dir() / 'scenarios' / 'in_process.yaml'  # no such file; scenes are found from there
SETTLE, DURATION, SD = 0.5, 4.0, 0.5e-3
TILT = 0.4      # rad, of the optical tracker about y, and 1 m away


class StandIn:
    """See the top of the file."""

    def __init__(self, scene, terms, targets, markers):
        self.targets = targets
        model, self._motion = TissueModel(scene, terms), MarkerMotion(scene, terms)
        self._rows = [self._motion.names.index(m) for m in markers]
        states = [model.evaluate(np.zeros(len(scene.pads)), t) for t in targets]
        self._rest = np.array([s.position for s in states])
        self._jacobian = np.array([s.jacobian for s in states])

    def step(self, surface):
        misfit = np.nanmean(surface.markers - self._motion.at(surface.q)[self._rows], axis=0)
        points = self._rest + self._jacobian @ surface.q
        return Estimate(surface.t, self.targets, points + misfit,
                        np.tile(SD**2 * np.eye(3), (len(points), 1, 1)))


@pytest.fixture(scope='module', autouse=True)
def stand_in():
    """Every run of this file builds it as estimator 'pod'."""
    module = SimpleNamespace(build=lambda *args: StandIn(*args[:4]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, 'stand_in_estimator', module)
        patch.setitem(cells.ESTIMATORS, 'pod', 'stand_in_estimator')
        yield


def make(**changes):
    """Task 1 on target 1 without EM tracker; a plant with an inclusion and play."""
    mesh = {'file': '../scenes/breast/breast_600.msh'}
    task = {'name': 'task_1', 'target': 'target_1', 'axes': ['x'], 'displacement_mm': [-3, 0, 0],
            'duration_s': DURATION}
    given = {'name': 'markers', 'seed': 11, 'scene': '../scenes/breast.yaml', 'settle_s': SETTLE,
             'feedback': 'pod', 'model': {'mesh': mesh, 'element': 'linear'},
             'plant': {'mesh': mesh, 'element': 'linear', 'terms': [
                 {'name': 'inclusion', 'centre_mm': [20, -12, 30], 'radius_mm': 9, 'ratio': 3},
                 {'name': 'backlash', 'width_mm': 0.3}]},
             'tasks': [task], **changes}
    return resolve(config.from_mapping(Scenario, given, 'markers'), PATH)


class Watched:
    """An InProcess whose optical frames pass through `fault(ids, points)`; keeps what is said."""

    def __init__(self, cell):
        self.loop, self.fault, self.silent = inprocess.InProcess(cell), None, False
        self.said, self.held, self.steps = [], [], []
        advance = self.loop.optical.advance
        self.loop.optical.advance = lambda *args: self._through(advance(*args))
        live, note = self.loop.estimators['pod'], self.loop._log.note
        step = live.step
        live.step = lambda t: self._keep(step(t))
        self.live, self._note = live, note

    def _through(self, frames):
        if self.silent:
            return []
        if self.fault is None:
            return frames
        out = []
        for f in frames:
            ids, points = self.fault(list(f.ids), f.points.copy())
            out.append(dataclasses.replace(f, ids=tuple(ids), points=points,
                                           visible=np.isfinite(points).all(axis=1)))
        return out

    def _keep(self, step):
        if step is not None:
            self.steps.append(step)
        return step

    def upto(self, t):
        """Run until t [s]; returns what the estimator and the manipulator said since."""
        first, outcomes, commands = len(self.steps), [], []
        while self.loop.t < t - 1e-9:
            before = self.loop.step
            self.loop.tick()
            if self.loop.step is not before:
                outcomes.append(self.loop.step.outcome)
                commands.append(self.loop.step.command)
        return SimpleNamespace(estimator=self.steps[first:], manipulator=outcomes,
                               commands=np.array(commands))


def outcomes(said):
    """Outcomes of the estimator without the first, when frames may be on the way."""
    return {s.outcome for s in said.estimator[1:]}


@pytest.fixture
def under_way():
    watched = Watched(make())
    said = watched.upto(SETTLE + 0.9)
    assert said.manipulator[-1] is Outcome.OK and said.estimator[-1].outcome is Outcome.OK
    return watched


def goes_on(watched, t):
    """True once the loop pursues its goal again and every marker counts."""
    said = watched.upto(watched.loop.t + t)
    return (said.estimator[-1].outcome is Outcome.OK and said.estimator[-1].seen >= 18
            and said.manipulator[-1] is Outcome.OK)


def test_the_loop_closes_without_a_sensor_in_the_tissue():
    run = inprocess.run(make(), go_home=False)
    task, = assess(run).tasks
    assert run.em == {} and run.feedback == 'pod'
    moved = np.ptp(run.truth['target_1'].values[:, 0])
    assert moved > 2.5e-3
    # by no more than the stand-in is wrong at the end of the task
    said = run.estimates['pod']['target_1']
    truth = np.interp(said.t, run.truth['target_1'].t, run.truth['target_1'].values[:, 0])
    wrong = np.abs(said.points[-20:, 0] - truth[-20:]).mean()
    assert task.steady_truth.mean_abs < wrong + 0.3e-3


def test_same_seed_same_bits():
    first, second = (Watched(make()) for _ in range(2))
    for one in (first, second):
        one.upto(SETTLE + 0.8)
    said = [one.loop.data().estimates['pod']['target_1'] for one in (first, second)]
    assert said[0].points.tobytes() == said[1].points.tobytes() and len(said[0].t) > 5


def test_all_but_two_markers_occluded_is_named_and_the_cell_holds(under_way):
    tissue = np.flatnonzero([n.startswith('tissue') for n in cells.marker_names(make())])

    def occluded(ids, points):
        points[np.delete(np.arange(len(ids)), tissue[[3, 9]])] = np.nan
        return ids, points

    under_way.fault = occluded
    said = under_way.upto(under_way.loop.t + 1.8)
    assert outcomes(said) == {Outcome.TOO_FEW_MARKERS}
    assert '2 markers on tissue' in said.estimator[-1].message
    assert all(s.estimate is None for s in said.estimator[1:])
    held(said)
    under_way.fault = None
    assert goes_on(under_way, 1.0)


def held(said):
    """The manipulator says that nothing fresh comes, and its command stays."""
    stale = [i for i, o in enumerate(said.manipulator) if o is Outcome.STALE_INPUT]
    assert len(stale) > 10 and stale[-1] == len(said.manipulator) - 1
    assert np.array_equal(said.commands[stale[0]], said.commands[-1])


def test_silence_for_two_seconds_is_named_and_the_cell_holds(under_way):
    under_way.silent = True
    said = under_way.upto(under_way.loop.t + 2.0)
    assert said.estimator[-1].outcome is Outcome.STALE_INPUT
    assert all(s.estimate is None for s in said.estimator[1:])
    held(said)
    under_way.silent = False
    assert goes_on(under_way, 1.0)


def test_a_swapped_pair_is_put_right_and_named(under_way):
    def swapped(ids, points):
        ids[2], ids[10] = ids[10], ids[2]
        return ids, points

    before = under_way.steps[-1].estimate
    under_way.fault = swapped
    said = under_way.upto(under_way.loop.t + 0.5)
    assert Outcome.MARKERS_SWAPPED in outcomes(said) and outcomes(said) <= {
        Outcome.MARKERS_SWAPPED, Outcome.OK}        # OK where one of the two is hidden
    assert said.estimator[-1].message.endswith('tissue_3, tissue_11')
    assert np.abs(said.estimator[-1].estimate.points - before.points).max() < 1.5e-3
    assert said.manipulator[-1] is Outcome.OK
    under_way.fault = None
    assert goes_on(under_way, 0.5)


def test_one_marker_off_by_20_mm_is_left_out_by_name(under_way):
    def off(ids, points):
        points[6] += [0.0, 0.0, 20e-3]
        return ids, points

    before = under_way.steps[-1].estimate
    under_way.fault = off
    said = under_way.upto(under_way.loop.t + 1.0)
    assert outcomes(said) == {Outcome.MARKERS_REJECTED}
    assert said.estimator[-1].message.endswith(': tissue_7')
    assert np.abs(said.estimator[-1].estimate.points - before.points).max() < 1.5e-3
    assert said.manipulator[-1] is Outcome.OK
    under_way.fault = None
    assert goes_on(under_way, 0.5)


@pytest.mark.parametrize('wrong', ['names', 'size'])
def test_another_scene_is_named_from_the_start_and_nothing_moves(wrong):
    def foreign(ids, points):
        if wrong == 'names':
            return [f'beam_{i}' for i in range(len(ids))], points
        return ids, 1.3 * points

    watched = Watched(make())
    watched.fault = foreign
    said = watched.upto(SETTLE + 0.8)
    assert said.estimator[-1].outcome is Outcome.WRONG_SCENE
    assert all(s.estimate is None for s in said.estimator)
    assert not np.any(watched.loop.data().encoder.values > 1e-9)
    refused = [o for o in watched.loop.data().outcomes if o.node == 'operator']
    assert refused and 'has not been seen yet' in refused[0].message


def test_the_tracker_may_stand_anywhere(under_way):
    """Registered by base and pads: turned and a metre away the estimates are the same."""
    turn = np.array([[np.cos(TILT), 0, np.sin(TILT)], [0, 1, 0], [-np.sin(TILT), 0, np.cos(TILT)]])
    watched = Watched(make())
    watched.fault = lambda ids, points: (ids, points @ turn + [0.3, -0.2, 1.0])
    watched.upto(under_way.loop.t)
    for a, b in zip(under_way.steps, watched.steps, strict=True):
        assert a.outcome is b.outcome
        if a.estimate is not None:
            np.testing.assert_allclose(a.estimate.points, b.estimate.points, atol=1e-9)


def test_a_tracker_that_is_pushed_is_registered_anew(under_way):
    under_way.fault = lambda ids, points: (ids, points + [0.0, 0.05, 0.0])
    said = under_way.upto(under_way.loop.t + 1.0)
    assert Outcome.LOST_REGISTRATION in outcomes(said)
    assert said.estimator[-1].outcome is Outcome.OK
    assert under_way.live.registration.p_WM[1] == pytest.approx(-0.05, abs=1e-3)


def test_a_covariance_that_is_not_positive_withholds_the_estimate(under_way):
    estimator = under_way.live._estimator
    sound = estimator.step
    estimator.step = lambda surface: dataclasses.replace(
        sound(surface), covariance=np.tile(np.diag([1.0, 1.0, -1e-9]), (5, 1, 1)))
    said = under_way.upto(under_way.loop.t + 0.5)
    assert outcomes(said) == {Outcome.NOT_POSITIVE_DEFINITE}
    assert 'target_1' in said.estimator[-1].message
    assert all(s.estimate is None for s in said.estimator)
    estimator.step = sound
    assert goes_on(under_way, 0.5)


def test_the_registration_found_is_as_sure_as_it_says():
    """Over constant errors of the tracker's markers: the frame's translation within its sd."""
    off, claimed = [], []
    cell = make()
    live, sd = cells.build_estimator(cell, 'pod'), (
        cell.scenario.optical.calibration_error / np.sqrt(3.0))
    motion = live._motion
    for seed in range(60):
        live._calibration.reset()
        points = motion.rest + sd * stream(seed, 'markers').standard_normal(motion.rest.shape)
        for i in range(30):
            live._calibration.take(0.01 * i, points, motion.at(np.zeros(4)))
        fit = live.registration
        off.append(fit.apply(fit.centre) - fit.centre)
        claimed.append(np.trace(fit.covariance[3:, 3:]))
    rms = np.mean(np.sum(np.square(off), axis=1))
    assert 0.2 * np.mean(claimed) < rms < 1.2 * np.mean(claimed)   # placement is exact here


@pytest.mark.parametrize('markers', [[], [{'name': 'base_1', 'position_mm': [80, 0, 0],
                                           'body': 'base'}]])
def test_a_scene_without_markers_is_refused(markers):
    cell = make()
    scene = dataclasses.replace(cell.model, markers=tuple(
        m for m in cell.model.markers if m.body == 'base' and markers))
    with pytest.raises(ConfigError, match='markers'):
        cells.build_estimator(dataclasses.replace(cell, model=scene), 'pod')
