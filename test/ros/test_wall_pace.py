"""The same graph paced by the wall clock: no lockstep, the goal is reached all the same."""

import numpy as np
import pytest

from arm_brachy import graph
from arm_brachy.offline import load_run
from arm_brachy.recording.reader import BagReader

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.wall]


@pytest.fixture(scope='module')
def wall_run(command_runner, short_scenario, tmp_path_factory):
    folder = tmp_path_factory.mktemp('wall')
    text = short_scenario.read_text().replace('../../config',
                                              str(short_scenario.parents[2] / 'config'))
    # Within 5 s one run of four left 0.54 of the 0.3 mm allowed, beside other work; cause unknown.
    text = text.replace('duration_s: 5', 'duration_s: 10')
    scenario = folder / 'wall.yaml'
    scenario.write_text(text + 'pace: wall\nlimits: {silence_s: 10}\n')
    done = command_runner('run', scenario, '--out', folder / 'run')
    assert done.returncode == 0, done.stderr + done.stdout
    return load_run(folder / 'run' / 'bag'), folder / 'run' / 'bag'


def test_the_goal_is_reached_in_real_time(wall_run):
    run, bag = wall_run
    window, = run.tasks
    truth = run.truth['target_1'].between(window.t_start, window.t_end)
    assert np.abs(truth.values[-1] - window.goal)[window.axes].max() < 0.3e-3
    with BagReader(bag) as reader:
        first, last = reader.span_ns
    assert first > 1e18  # stamps are dates, not simulated seconds
    assert 5.0 < (last - first) * 1e-9 < 40.0


def test_every_node_says_how_much_it_published(wall_run):
    run, _ = wall_run
    wanted = {f'/cell/done/{n}' for n in graph.CELL if n not in ('cell_clock', 'recorder')}
    assert wanted <= {t.topic for t in run.topics}
    lost = {t.topic: t.published - len(t.stamps) for t in run.topics if t.published is not None}
    assert lost['/actuators/state'] >= 0
    assert max(lost.values()) <= 0, lost


def test_streams_keep_their_rates(wall_run):
    run, _ = wall_run
    stamps = {topic.topic: topic.stamps for topic in run.topics}

    def rate(name):
        return (len(stamps[name]) - 1) / (stamps[name][-1] - stamps[name][0])

    assert rate('/em/target_1/status') == pytest.approx(40.0, rel=0.02)
    assert rate('/optical/markers') == pytest.approx(50.0, rel=0.02)
    assert rate('/actuators/state') == pytest.approx(20.0, rel=0.1)
