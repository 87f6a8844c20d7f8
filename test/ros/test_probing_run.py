"""Prescribed moves through the whole graph, watched: the same bits as in one process; report,
replay.
"""

from pathlib import Path

import numpy as np
import pytest

from arm_brachy import graph, inprocess, offline
from arm_brachy.offline import load_run, with_cell
from arm_brachy.scenario import load_cell

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SCENARIO = Path(__file__).with_name('probe_short.yaml')


@pytest.fixture(scope='module')
def probed(command_runner, tmp_path_factory):
    """Folder of a finished run with model and monitor beside it, and what the command printed."""
    folder = tmp_path_factory.mktemp('probed') / 'run'
    done = command_runner('run', SCENARIO, '--watch', '--out', folder)
    assert done.returncode == 0, done.stderr + done.stdout
    return folder, done.stdout


def of_the_monitor(outcomes):
    return [o for o in outcomes if o.node == 'mismatch_monitor']


def test_a_run_in_one_process_equals_the_recording_of_the_graph(probed):
    """Nobody watches in the one process, and the monitor's word is all that differs."""
    cell = load_cell(SCENARIO)
    theirs = with_cell(load_run(probed[0] / 'bag'), cell)
    ours = inprocess.run(cell, sensors=inprocess.SENSORS)
    assert len(theirs.command_position) > 30 and len(theirs.moves) == 2
    for name in ('encoder', 'command_position', 'pad_displacement', 'force'):
        a, b = getattr(ours, name), getattr(theirs, name)
        assert a.t.tobytes() == b.t.tobytes() and a.values.tobytes() == b.values.tobytes(), name
    assert set(ours.em) == set(theirs.em) == {'target_1', 'target_3'}
    for tool, samples in theirs.em.items():
        assert ours.em[tool].position.tobytes() == samples.position.tobytes()
    assert ours.optical.points.tobytes() == theirs.optical.points.tobytes()
    assert ours.moves == theirs.moves and ours.moves_planned == theirs.moves_planned == 2
    watchers = of_the_monitor(theirs.outcomes)
    assert list(ours.outcomes) == [o for o in theirs.outcomes if o not in watchers]


def test_nodes_of_the_closed_loop_take_no_part_and_nothing_is_lost(probed):
    run = load_run(probed[0] / 'bag')
    answered = {t.topic for t in run.topics if t.topic.startswith('/cell/done/')}
    watched = (*graph.PROBING_CELL, *(n.name for n in graph.COMPARISON))
    assert answered == {f'/cell/done/{n}' for n in watched if n not in ('cell_clock', 'recorder')}
    assert [(t.topic, len(t.stamps)) for t in run.topics if t.published is not None] == [
        (t.topic, t.published) for t in run.topics if t.published is not None]


def test_the_monitor_says_what_departs(probed):
    """The plant has an inclusion and 0.3 mm of backlash that the model does not have."""
    said = {o.outcome for o in of_the_monitor(load_run(probed[0] / 'bag').outcomes)}
    assert 'DEPARTED' in said
    assert offline.recorded_prediction(probed[0] / 'bag') is not None


def test_the_command_says_what_was_made(probed):
    folder, printed = probed
    assert 'moves made' in printed and 'real time' in printed
    assert (folder / 'report.html').stat().st_size > 10_000
    text = (folder / 'report.json').read_text()
    assert '"move": "pair"' in text and '"met": true' in text


def test_a_recorded_protocol_is_replayed_to_the_model(probed, command_runner, tmp_path):
    done = command_runner('replay', probed[0] / 'bag', '--out', tmp_path / 'replayed')
    assert done.returncode == 0, done.stderr + done.stdout
    assert {p.stem for p in (tmp_path / 'replayed').glob('report*.html')} == {
        'report', 'report_optical', 'report_em', 'report_force'}
    taken, again = (load_run(f / 'bag') for f in (probed[0], tmp_path / 'replayed'))
    assert again.moves == taken.moves
    assert np.array_equal(again.command_position.values, taken.command_position.values)
