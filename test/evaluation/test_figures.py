"""What the figures draw: right numbers, right faces, same bytes, every form of file."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.evaluation import (
    assess,
    body_view,
    comparison,
    figures,
    residual_figures,
    residuals,
)
from arm_brachy.evaluation.deformation import boundary_triangles
from arm_brachy.evaluation.thesis import TABLE_3_1, Manipulation
from arm_brachy.evaluation.timeseries import OpticalFrames, Series


def lines_of(axis):
    return {line.get_label(): line for line in axis.get_lines()}


def test_time_response_draws_displacement_in_millimetres(run):
    plate = figures.time_response(run, run.tasks[:2], 0.3e-3)
    axes = np.array(plate.figure.axes).reshape(5, 2)
    truth = lines_of(axes[0, 0])['truth']
    assert truth.get_xdata()[0] == 0.0
    assert truth.get_ydata()[[0, -1]] == pytest.approx([0.0, -5.0], abs=1e-3)
    assert lines_of(axes[0, 0])['goal'].get_ydata()[0] == pytest.approx(-5.0)
    assert 'goal' not in lines_of(axes[1, 0])   # free axis
    assert [text.get_text() for text in axes[1, 0].texts] == ['free']
    assert lines_of(axes[4, 0])['pad 3'].get_ydata()[-1] == pytest.approx(11.0, abs=0.02)
    assert plate.caption.endswith('.')


@pytest.mark.parametrize('way', [-1.0, 1.0])
def test_free_is_written_where_no_data_are(run, way):
    """A free axis that ends far up or far down."""
    series = run.truth['target 1']
    moved = series.values.copy()
    moved[:, 2] += way * 4e-3 * np.minimum(series.t / 5.0, 1.0)
    run = dataclasses.replace(run, truth={'target 1': Series(series.t, moved)}, em={})
    axis = np.array(figures.time_response(run, run.tasks[:1], 0.3e-3).figure.axes)[2]
    word, = axis.texts
    end = lines_of(axis)['truth'].get_ydata()[-1]
    low, high = axis.get_ylim()
    assert word.get_text() == 'free'
    assert abs(word.get_position()[1] - (end - low) / (high - low)) > 0.5


def test_axis_at_rest_is_not_blown_up(run):
    axes = np.array(figures.time_response(run, run.tasks, 0.3e-3).figure.axes).reshape(5, 3)
    low, high = axes[2, 0].get_ylim()
    assert high - low == pytest.approx(figures.LEAST_SPAN)


def test_streams_show_the_hole_as_silence(run):
    plate = figures.streams(run, assess.assess(run).streams)
    meshes = plate.figure.axes[0].collections
    optical = np.asarray(meshes[1].get_array()).ravel()
    assert optical.min() == 0.0
    assert np.asarray(meshes[0].get_array()).ravel() == pytest.approx(1.0, abs=0.06)
    texts = [text.get_text() for text in plate.figure.axes[0].texts]
    assert '97.1 Hz, 121 lost' in texts
    assert '3 messages' in texts


def test_bursts_of_a_slow_topic_are_no_alarm(run):
    """Seven nodes that speak once a second at the same instant, as /diagnostics in lockstep."""
    first, last = run.span()
    beats = np.repeat(np.arange(first, last, 1.0), 7)
    record = dataclasses.replace(run.topics[0], topic='/diagnostics', stamps=beats, published=None)
    run = dataclasses.replace(run, topics=(record,))
    axis = figures.streams(run, assess.assess(run).streams).figure.axes[0]
    assert not axis.collections and f'{len(beats)} messages' in [t.get_text() for t in axis.texts]


def test_markers_are_drawn_by_how_far_they_went(run):
    t = np.linspace(0.0, 1.0, 11)
    points = np.zeros((11, 2, 3))
    points[:, 1, 2] = -4e-3 * t
    visible = np.ones((11, 2), dtype=bool)
    visible[5, 1] = False
    run = dataclasses.replace(run, optical=OpticalFrames(t, ('still', 'falls'), points, visible))
    drawn = lines_of(figures.marker_travel(run).figure.axes[0])
    assert list(drawn) == ['falls', 'still'] and not drawn['still'].get_ydata().any()
    way = drawn['falls'].get_ydata()
    assert way[-1] == pytest.approx(4.0) and np.isnan(way[5])


def test_body_shows_the_faces_turned_to_the_eye(run):
    plate = body_view.body(run, 4)
    surface = plate.figure.axes[0].collections[0]
    tissue = run.tissue
    faces = boundary_triangles(tissue.tets)
    corners = tissue.positions[4][faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(surface.get_paths()) == np.count_nonzero(normal[:, 2] > 0)
    moved = np.linalg.norm(tissue.positions[4] - tissue.rest, axis=1) * 1e3
    assert surface.get_clim() == (0.0, pytest.approx(moved.max()))


def test_body_names_targets_where_there_is_room(run):
    other = Series(run.truth['target 1'].t, run.truth['target 1'].values + 0.01)
    run = dataclasses.replace(run, truth={**run.truth, 'target 2': other})
    above, side = body_view.body(run, 4).figure.axes[:2]
    named = [{text.get_text() for text in axis.texts} & {'target 1', 'target 2'}
             for axis in (above, side)]
    assert named == [{'target 1', 'target 2'}, {'target 1'}]


def test_comparison_places_every_row(tmp_path):
    ours = [Manipulation(r.target, r.task, r.open_loop_itae_mm_s2, r.closed_loop_itae_mm_s2 / 2,
                         r.open_loop_steady_state_error_mm, 0.1) for r in TABLE_3_1]
    plate = comparison.table_3_1(ours, 0.3)
    left, right = plate.figure.axes
    drawn = lines_of(left)
    assert drawn['thesis, open loop'].get_xdata().tolist() == [
        r.open_loop_itae_mm_s2 for r in TABLE_3_1]
    ratio = drawn['thesis, closed loop'].get_xdata() / drawn['ours, closed loop'].get_xdata()
    assert ratio == pytest.approx(2.0)
    assert lines_of(right)['ours, closed loop'].get_xdata() == pytest.approx(0.1)
    plate.save(tmp_path / 'table.png')
    assert (tmp_path / 'table.png').read_bytes().startswith(b'\x89PNG')


def test_residual_norms_and_arrow_scale(replay):
    r = residuals.residual(replay.measured, replay.predicted)
    plate = residual_figures.residual_norms(replay, r, np.full(6, 1e-4))
    curve = plate.figure.axes[0].get_lines()[0].get_ydata()
    assert np.nanmax(curve) == pytest.approx(1e3 * np.linalg.norm(r[:, 0], axis=1).max())
    assert 'release (1.00–2.50 s)' in plate.caption
    body = body_view.residual_body(replay, r, 116)
    assert '3 times its true length' in body.caption


def test_a_marker_never_seen_leaves_an_empty_panel(replay):
    r = residuals.residual(replay.measured, replay.predicted)
    r[:, 3] = np.nan
    plate = residual_figures.residual_axes(replay, r)
    assert len([axis for axis in plate.figure.axes if axis.get_visible()]) == 6


def test_same_data_same_bytes(run):
    first, second = (figures.pad_forces(run).data_uri() for _ in range(2))
    assert first == second
