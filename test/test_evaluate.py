"""A recording beside a prediction: streams, registration, regimes, pages."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy import evaluate
from arm_brachy.core.random import stream
from arm_brachy.core.scene import Marker, Material, MeshFile, Region, Scene, Target
from arm_brachy.evaluate import comparisons
from arm_brachy.evaluation import residual_report
from arm_brachy.evaluation.estimates import estimate_metrics
from arm_brachy.evaluation.timeseries import (
    EmSamples,
    OpticalFrames,
    PadMark,
    RunData,
    Series,
    TargetEstimates,
)
from arm_brachy.offline import Prediction

T = np.arange(0.0, 8.0, 0.01)
RNG_SEED = 3
NOISE = 0.05e-3     # m, per axis
MARKERS = {'a': (0.0, 0.0, 0.05), 'b': (0.03, 0.0, 0.04), 'c': (0.0, 0.03, 0.04),
           'd': (-0.03, -0.02, 0.03)}
TARGETS = {'e': (0.0, 0.0, 0.02)}
PUSH = np.interp(T, [0, 1, 2, 4, 5, 8], [0, 0, 5e-3, 5e-3, 0, 0])
WAY = np.array([0.0, 0.2, -0.6])


def cell(release=None):
    scene = Scene('dome', MeshFile('none.msh'), Region('box'), Material(),
                  markers=tuple(Marker(n, p) for n, p in MARKERS.items()),
                  targets=tuple(Target(n, p) for n, p in TARGETS.items()))
    return SimpleNamespace(scene=scene, model=scene,
                           scenario=SimpleNamespace(release=release, seed=1))


def prediction(motion):
    rest = np.array([*MARKERS.values(), *TARGETS.values()])
    force = motion[:, None, None] * np.array([[-400.0, 0.0, 0.0]])
    return Prediction(T, (*MARKERS, *TARGETS), rest + motion[:, None, None] * WAY, ('press',),
                      force)


def taken(predicted, *, X=None, gain=1.0, force_gain=1.0):
    """What instruments see if the truth moves `gain` times as much, in a frame that X moved."""
    rng = stream(RNG_SEED, 'taken')
    rest = predicted.points[0]
    points = rest + gain * (predicted.points - rest)
    if X is not None:
        points = X[0].apply(points.reshape(-1, 3)).reshape(points.shape) + X[1]
    points = points + NOISE * rng.standard_normal(points.shape)
    visible = np.ones((len(T), 4), dtype=bool)
    visible[300:320, 1] = False
    em = EmSamples(T[::4], points[::4, 4], np.full(len(T[::4]), np.nan), np.zeros(len(T[::4])))
    force = force_gain * predicted.force + 0.02 * rng.standard_normal(predicted.force.shape)
    return RunData('taken', '', 1, '', '', encoder=Series(T, PUSH[:, None]),
                   optical=OpticalFrames(T, tuple(MARKERS), points[:, :4], visible),
                   em={'e': em}, force=Series(T, force), force_pads=('press',),
                   pads=(PadMark('press', np.zeros(3), np.array([1.0, 0, 0])),))


def test_perfect_model_leaves_the_noise_in_every_stream():
    predicted = prediction(PUSH)
    streams = comparisons(taken(predicted), cell(), predicted)
    assert list(streams) == ['optical', 'em', 'force']
    for name, expected in (('optical', NOISE), ('em', NOISE), ('force', 0.02)):
        data = streams[name]
        for row in residual_report.residuals.marker_residuals(data):
            if row.regime == 'all':
                assert row.rms == pytest.approx(np.sqrt(3) * expected, rel=0.08)
        floor = residual_report.floor_of(data)
        assert floor == pytest.approx(np.sqrt(3) * expected, rel=0.2)


def test_departures_go_to_the_report_of_their_stream(tmp_path):
    predicted = prediction(PUSH)
    found = ((3.2, 'optical a is off its prediction by 0.2 mm along z since 3.00 s'),
             (4.0, 'force press is off its prediction by 0.5 N along its push since 3.50 s'))
    data = comparisons(replace(taken(predicted), departures=found), cell(), predicted)
    assert [data[name].departures for name in ('optical', 'em', 'force')] == [
        found[:1], (), found[1:]]
    page = residual_report.write_residual_report(data['force'], tmp_path / 'page.html').read_text()
    assert 'Departures found while it ran' in page and 'along its push since 3.50 s' in page
    assert 'optical a is off' not in page


def test_registration_takes_out_a_rigid_motion_and_no_more():
    predicted = prediction(PUSH)
    X = Rotation.from_rotvec(np.radians(0.3) * np.array([0, 0.6, 0.8])), [2e-4, -1e-4, 3e-4]
    data = comparisons(taken(predicted, X=X, gain=0.8), cell(), predicted)['optical']
    rows = {(row.marker, row.regime): row
            for row in residual_report.residuals.marker_residuals(data, np.full(4, NOISE))}
    for marker in MARKERS:
        assert np.linalg.norm(rows[marker, 'rest'].bias) < 3e-5
        assert rows[marker, 'all'].gain == pytest.approx(0.8, abs=0.01)
        # A fifth of the motion at 5 mm push stays, registration or not.
        assert np.linalg.norm(rows[marker, 'hold'].bias) == pytest.approx(
            0.2 * 5e-3 * np.linalg.norm(WAY), rel=0.05)
    assert 'Registered over the first' in data.statement
    assert np.nanmax(data.registration) < 3e-5


def test_em_sensors_are_shifted_only():
    predicted = prediction(PUSH)
    X = Rotation.identity(), [5e-4, 0.0, 0.0]
    data = comparisons(taken(predicted, X=X), cell(), predicted)['em']
    assert np.nanmean(data.measured[:, 0] - data.predicted[:, 0], axis=0) == pytest.approx(
        np.zeros(3), abs=2e-5)


def test_regimes_follow_the_pads():
    predicted = prediction(PUSH)
    data = comparisons(taken(predicted), cell(), predicted)['optical']
    assert [g.name for g in data.regimes] == ['rest', 'load', 'hold', 'unload', 'rest']
    starts = [g.t_start for g in data.regimes]
    assert starts == pytest.approx([0.0, 1.0, 2.0, 4.0, 5.0], abs=0.12)


def test_force_rows_are_per_pad_and_component_in_newton():
    predicted = prediction(PUSH)
    data = comparisons(taken(predicted, force_gain=0.5), cell(), predicted)['force']
    result = residual_report.to_result(data)
    hold = next(row for row in result.rows if row['regime'] == 'hold')
    assert hold['pad'] == 'press'
    assert hold['bias_x_N'] == pytest.approx(0.5 * 400.0 * 5e-3, rel=0.06)
    assert hold['rms_y_N'] == pytest.approx(0.02, rel=0.2)


@pytest.mark.parametrize('others', [0.0, np.nan])
def test_cells_of_one_axis_are_compared_along_the_push(others):
    """The model's force has a part across that such a cell does not see."""
    told = prediction(PUSH)
    predicted = replace(told, force=told.force + PUSH[:, None, None] * [[0.0, 150.0, -90.0]])
    seen = taken(predicted, force_gain=0.8)
    line = np.array([seen.pads[0].direction])
    along = (seen.force.values @ line[0])[..., None] * line
    run = replace(seen, force=Series(T, np.where(line == 0.0, others, along)))
    data = comparisons(run, cell(), predicted)['force']
    assert 'press have one axis' in data.statement and 'one axis' not in comparisons(
        seen, cell(), predicted)['force'].statement
    whole = next(row for row in residual_report.to_result(data).rows if row['regime'] == 'all')
    assert whole['gain'] == pytest.approx(0.8, abs=0.01)
    assert whole['rms_y_N'] == whole['rms_z_N'] == 0.0


def test_release_splits_into_held_ringing_settled_and_gives_the_mode(tmp_path):
    release, f, zeta = 1.0, 4.0, 0.05
    since = np.maximum(T - release, 0.0)
    w = 2 * np.pi * f
    fall = 10e-3 * (1 - np.exp(-zeta * w * since) * np.cos(w * since))
    stiff = 6e-3 * (1 - np.cos(2 * np.pi * 5.5 * since))
    predicted = prediction(stiff)
    truth = prediction(fall)
    run = taken(truth)
    run = RunData('taken', 'seed: 1', 1, '', '', optical=run.optical)
    data = comparisons(run, cell(release), predicted)['optical']
    assert [g.name for g in data.regimes] == ['held', 'ringing', 'settled']
    # The envelope then sinks into the noise (three rms norms), to within a period.
    left = 3.0 * np.sqrt(3.0) * NOISE / (10e-3 * np.linalg.norm(WAY))
    assert data.regimes[2].t_start == pytest.approx(release - np.log(left) / (zeta * w), abs=1 / f)
    result = residual_report.to_result(data)
    free = [row for row in result.rows if row['regime'] == 'free vibration']
    assert [row['marker'] for row in free] == list(MARKERS)
    for row in free:
        assert row['frequency_measured_Hz'] == pytest.approx(f, rel=0.01)
        assert row['damping_ratio_measured'] == pytest.approx(zeta, rel=0.1)
        assert row['frequency_model_Hz'] == pytest.approx(5.5, rel=0.01)
        assert row['damping_ratio_model'] == pytest.approx(0.0, abs=1e-3)
        assert row['sag_z_measured_mm'] == pytest.approx(-6.0, abs=0.1)
    page = residual_report.write_residual_report(data, tmp_path / 'page.html')
    text = page.read_text(encoding='utf-8')
    assert 'Free vibration' in text
    assert 'No parameter was fitted.' in text
    json.loads(result.to_json())


def test_streams_the_model_knows_nothing_of_are_left_out():
    predicted = prediction(PUSH)
    bare = Prediction(T, ('other',), predicted.points[:, :1], (), np.zeros((len(T), 0, 3)))
    assert comparisons(taken(predicted), cell(), bare) == {}
    assert comparisons(taken(predicted), cell(), None) == {}


def em_recording(tools, turn=0.2):
    """A run without truth: estimates exact, EM the same in a frame that is turned and moved."""
    t = np.arange(0.0, 5.0, 0.1)
    rest = np.array([[0, 0, 27], [15, 7, 27], [-9, 15, 27], [-14, -10, 30]]) * 1e-3
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    said, em = {}, {}
    for i in range(tools):
        points = rest[i] + np.outer(np.maximum(t - 2.0, 0.0), [2e-3, 0.5e-3, 0.0])
        said[f't{i}'] = TargetEstimates(t, points, np.tile(1e-8 * np.eye(3), (len(t), 1, 1)))
        em[f't{i}'] = EmSamples(t, points @ R + [0.1, 0.2, -0.3], np.zeros(len(t)),
                                np.zeros(len(t), dtype=int))
    return RunData('em', '', 0, '', '', em=em, estimates={'map': said})


@pytest.mark.parametrize(('tools', 'turn'), [(4, 0.2), (1, 0.0)])
def test_without_truth_estimates_are_compared_with_em_sensors_registered_to_them(tools, turn):
    run = evaluate.with_em_registered(em_recording(tools, turn))
    assert run.reference_name == 'EM sensor' and len(run.reference) == tools
    for one in estimate_metrics(run):
        assert one.largest < 1e-9 and one.coverage == 1.0


def test_two_sensors_register_by_a_shift_alone_and_the_turn_stays_as_error():
    worst = max(one.largest for one in estimate_metrics(evaluate.with_em_registered(
        em_recording(2))))
    assert 1e-3 < worst < 5e-3
