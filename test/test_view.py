"""`arm-brachy view`: what it says of bags, and the curves beside the film."""

import numpy as np
import pytest

from arm_brachy import view
from arm_brachy.cli.view import view as command
from arm_brachy.core.errors import InputError, RecordingError
from arm_brachy.evaluation.timeseries import PadMark, RunData, Series, TaskWindow
from arm_brachy.recording.writer import BagWriter


def run_of(**given):
    return RunData('a run', '', 1, 'x', 'y', **given)


def test_a_bag_with_nothing_to_draw_is_refused_in_one_line(tmp_path):
    with BagWriter(tmp_path / 'bag'):
        pass
    with pytest.raises(RecordingError, match='holds nothing to draw'):
        view.bag_pages(tmp_path / 'bag')


def test_what_is_no_bag_is_refused(tmp_path):
    with pytest.raises(RecordingError, match='no such bag'):
        command.callback(bag=str(tmp_path / 'none'), live=False, port=0, browser=False)


def test_a_bag_or_the_live_cell(tmp_path):
    with pytest.raises(InputError, match='got neither of BAG and --live'):
        command.callback(bag=None, live=False, port=0, browser=False)
    with pytest.raises(InputError, match='no session key.*a cell that is running'):
        command.callback(bag=str(tmp_path / 'bag'), live=True, port=0, browser=False)


def test_the_error_is_of_the_controlled_axes_in_mm():
    t = np.linspace(0.0, 10.0, 101)
    place = np.column_stack([t * 1e-3, 0 * t, 5e-3 + 0 * t])
    task = TaskWindow('push', 'target_1', 2.0, 8.0, np.zeros(3), np.array([8e-3, 0, 0]),
                      np.array([True, False, False]))
    plot, = view.plots(run_of(tasks=(task,), truth={'target_1': Series(t, place)}))
    line, = plot['lines']
    assert line['name'] == 'push (true)' and (line['t'][0], line['t'][-1]) == (2.0, 8.0)
    assert line['y'][0] == pytest.approx(6.0) and line['y'][-1] == pytest.approx(0.0)


def test_curves_are_thinned_and_gaps_stay():
    t = np.arange(10_000) * 1e-3
    values = np.where(t < 5.0, t, np.nan)[:, None, None] * [0.0, 3.0, 4.0]
    force, = view.plots(run_of(force=Series(t, values), pads=(
        PadMark('pad_1', np.zeros(3), np.array([1.0, 0, 0])),)))
    line, = force['lines']
    assert len(line['t']) <= view.CURVE and line['y'][-1] is None
    assert line['y'][100] == pytest.approx(5.0 * line['t'][100], abs=1e-3)
