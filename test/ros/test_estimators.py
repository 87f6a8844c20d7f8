"""The loop closed over a node that sees markers and encoders: graph, process and replay agree."""

import json

import numpy as np
import pytest

from arm_brachy import inprocess
from arm_brachy.offline import load_run, with_cell
from arm_brachy.recording.reader import BagReader, payload_hashes
from arm_brachy.scenario import load_cell

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture(scope='module')
def scenario(short_scenario, tmp_path_factory):
    """The short scenario on estimates of a POD with few modes, which is built soonest."""
    config = short_scenario.parents[2] / 'config'
    text = short_scenario.read_text().replace('../../config', str(config))
    path = tmp_path_factory.mktemp('scenario') / 'markers.yaml'
    path.write_text(text.replace('name: short', 'name: markers').replace(
        'duration_s: 5', 'duration_s: 3') + 'feedback: pod\npod: {modes: 8, pushes: 4}\n')
    return path


@pytest.fixture(scope='module')
def recorded(scenario, command_runner, tmp_path_factory):
    """Folder of a run."""
    folder = tmp_path_factory.mktemp('markers') / 'run'
    done = command_runner('run', scenario, '--out', folder)
    assert (folder / 'report_estimates.json').is_file(), done.stderr + done.stdout
    return folder


@pytest.fixture(scope='module')
def run(recorded, scenario):
    return with_cell(load_run(recorded / 'bag'), load_cell(scenario))


def test_there_is_no_sensor_in_the_tissue_and_the_task_is_done(run, recorded):
    with BagReader(recorded / 'bag') as bag:
        topics = set(bag.topics())
    assert not [name for name in topics if name.startswith('/em/')]
    assert {f'/estimate/pod/target_{i}' for i in range(1, 6)} <= topics
    assert len(run.tasks) == 1 and run.feedback == 'pod' and run.em == {}


def test_estimates_are_of_the_time_of_a_frame_and_carry_a_covariance(run):
    said, frames = run.estimates['pod']['target_1'], run.optical.t
    assert np.isin(np.round(said.t * 1e9), np.round(frames * 1e9)).all()
    assert np.all(np.diff(said.t) > 0.0) and len(said.t) > 20
    assert np.linalg.eigvalsh(said.covariance).min() > 0.0


def test_a_run_in_one_process_gives_the_same_estimates_and_commands(run, scenario):
    ours = inprocess.run(load_cell(scenario), sensors=inprocess.SENSORS)
    for target, theirs in run.estimates['pod'].items():
        mine = ours.estimates['pod'][target]
        for name in ('t', 'points', 'covariance'):
            assert getattr(mine, name).tobytes() == getattr(theirs, name).tobytes(), (target, name)
    assert ours.command_position.values.tobytes() == run.command_position.values.tobytes()


@pytest.mark.validate
def test_a_replay_to_the_live_node_says_the_same_and_is_evaluated(recorded, command_runner,
                                                                  tmp_path):
    done = command_runner('replay', recorded / 'bag', '--node', 'pod_estimator', '--out',
                          tmp_path / 'again', '--json', tmp_path / 'again.json')
    first, second = (payload_hashes(folder / 'bag') for folder in (recorded, tmp_path / 'again'))
    estimates = [name for name in first if name.startswith('/estimate/')]
    assert len(estimates) == 7, done.stderr
    assert all(first[name] == second[name] for name in estimates)
    rows = json.loads((tmp_path / 'again.json').read_text())['rows']
    assert len([row for row in rows if row.get('estimator') == 'pod']) == 5


def test_the_node_reports_registration_age_and_memory(recorded):
    said = {}
    with BagReader(recorded / 'bag') as bag:
        for _, msg in bag.messages(['/diagnostics']):
            for status in msg.status:
                if status.name.endswith('pod_estimator'):
                    said = {v.key: v.value for v in status.values}
    assert 0.0 < float(said['registration residual rms [mm]']) < 0.5
    assert 0.0 < float(said['age of the estimate [ms]']) < 100.0
    assert 'base_1' in said['registered to'] and int(said['markers used']) > 10
    last = (recorded / 'logs' / 'pod_estimator.log').read_text().strip().splitlines()[-1]
    assert 'estimates: median' in last and 'peak memory' in last
