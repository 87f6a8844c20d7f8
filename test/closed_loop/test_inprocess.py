"""The whole cell in one process: tissue, devices, controller, against a plant that is no model."""

import dataclasses

import numpy as np
import pytest

from arm_brachy import inprocess
from arm_brachy.control.safety import Permission
from arm_brachy.control.sequencer import HOME
from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir
from arm_brachy.evaluation.assess import assess
from arm_brachy.scenario import Scenario, resolve

PATH = config_dir() / 'scenarios' / 'in_process.yaml'  # no such file; scenes are found from there
SETTLE, DURATION = 0.5, 7.0
LIMIT = 0.3e-3   # the goal of every closed loop, evaluation.assess.Goals


def make(loop='closed', seed=4, **changes):
    """Task 1 on target 1. The plant is softer in volume change and has an inclusion and play."""
    coarse = {'file': '../scenes/breast/breast_600.msh'}
    plant = {'mesh': coarse, 'nu': 0.47, 'terms': [
        {'name': 'inclusion', 'centre_mm': [20, -12, 30], 'radius_mm': 9, 'ratio': 5},
        {'name': 'backlash', 'width_mm': 0.3}]}
    task = {'name': 'task_1', 'target': 'target_1', 'axes': ['x'], 'displacement_mm': [-5, 0, 0],
            'duration_s': DURATION}
    given = {'name': 'in_process', 'seed': seed, 'scene': '../scenes/breast.yaml',
             'settle_s': SETTLE, 'model': {'element': 'linear'}, 'plant': plant,
             'control': {'loop': loop}, 'tasks': [task],
             **changes}
    return resolve(config.from_mapping(Scenario, given, 'in_process'), PATH)


def upto(loop, t):
    """Tick an InProcess until t [s]; returns it."""
    while loop.t < t - 1e-9:
        loop.tick()
    return loop


@pytest.fixture(scope='module')
def closed():
    return inprocess.run(make(), sensors=inprocess.SENSORS)


@pytest.fixture(scope='module')
def opened():
    return inprocess.run(make('open'), go_home=False)


def test_closed_loop_reaches_its_goal_and_stays(closed):
    task, = assess(closed).tasks
    assert task.mode == 'closed_loop' and task.response_from == 'truth'
    assert task.steady_truth.mean_abs < LIMIT
    assert task.settling_time < 0.6 * DURATION


def test_open_loop_keeps_the_error_of_its_model(closed, opened):
    task, = assess(opened).tasks
    assert task.mode == 'open_loop'
    assert task.steady_truth.mean_abs > LIMIT
    assert task.itae_truth > 2.0 * assess(closed).tasks[0].itae_truth


def test_pads_only_push_while_a_goal_is_pursued(closed):
    window, = closed.tasks
    command = closed.command_position.between(window.t_start, window.t_end).values
    assert len(command) > 50 and np.all(np.diff(command, axis=0) >= 0.0)
    pads = closed.pad_displacement.between(window.t_start, window.t_end).values
    assert np.all(np.diff(pads, axis=0) >= -1e-12)


def test_pads_are_home_at_the_end(closed):
    assert np.all(closed.encoder.values[-1] < HOME)


def test_streams_come_at_the_rates_of_their_devices(closed):
    scenario = make().scenario
    watched = closed.encoder.t[-1] - scenario.tick   # from the first reading of the body on
    assert np.allclose(np.diff(closed.encoder.t), scenario.tick)
    for stream, device in ((closed.em['target_1'], scenario.em), (closed.force, scenario.force),
                           (closed.optical, scenario.optical)):
        expected = device.rate * (watched - device.latency)
        assert len(stream.t) == pytest.approx(expected, abs=1.01)
    assert closed.force.values.shape[1:] == (4, 3)


def test_em_noise_is_that_of_the_tracker(closed):
    """Against truth at the same instants; 0.14 mm rms length (Hummel et al. 2005)."""
    samples, truth = closed.em['target_1'].tracked(), closed.truth['target_1']
    seen = np.stack([np.interp(samples.t, truth.t, c) for c in truth.values.T], axis=1)
    rest = samples.t < closed.tasks[0].t_start
    rest |= samples.t > closed.tasks[0].t_end - 3.0
    rest &= samples.t <= closed.tasks[0].t_end
    rms = np.sqrt(np.mean(np.sum((samples.values - seen)[rest]**2, axis=1)))
    assert rms == pytest.approx(0.14e-3, rel=0.2)


def test_same_seed_same_bits_other_seed_other_noise(closed):
    again = upto(inprocess.InProcess(make(), inprocess.SENSORS), 1.5).data()
    other = upto(inprocess.InProcess(make(seed=5), inprocess.SENSORS), 1.5).data()
    n, m = len(again.encoder), len(again.em['target_1'].t)
    for name in ('encoder', 'pad_displacement'):
        first, second = getattr(closed, name), getattr(again, name)
        assert first.values[:n].tobytes() == second.values.tobytes()
    truth = closed.truth['target_1'].values[:n]
    assert truth.tobytes() == again.truth['target_1'].values.tobytes()
    first = closed.em['target_1'].position[:m]
    assert first.tobytes() == again.em['target_1'].position.tobytes()
    assert not np.any(first == other.em['target_1'].position)


def test_sensors_that_are_left_out_change_nothing_for_the_others(closed):
    bare = upto(inprocess.InProcess(make()), 1.5).data()
    assert bare.force is None and bare.optical is None and bare.force_pads == ()
    m = len(bare.em['target_1'].t)
    assert closed.em['target_1'].position[:m].tobytes() == bare.em['target_1'].position.tobytes()


def test_pushing_stops_while_the_em_tool_is_missing():
    loop = upto(inprocess.InProcess(make()), SETTLE + 0.6)
    present = loop.tracker.params
    loop.tracker.params = dataclasses.replace(present, dropout_probability=1.0)
    outcomes, commands = [], []
    while loop.t < SETTLE + 1.6:
        before = loop.step
        loop.tick()
        if loop.step is not before:
            outcomes.append(loop.step.outcome)
            commands.append(loop.step.command)
    stale = [i for i, o in enumerate(outcomes) if o is Outcome.STALE_INPUT]
    # 0.5 s of patience (stale_after) out of 1 s, and one frame of latency
    assert 4 <= len(stale) <= 6 and stale[-1] == len(outcomes) - 1
    assert all(np.array_equal(commands[i], commands[stale[0]]) for i in stale)
    loop.tracker.params = present
    upto(loop, SETTLE + 2.0)
    assert loop.step.outcome is Outcome.OK
    assert np.any(loop.step.command > commands[-1])


@pytest.fixture
def under_way():
    return upto(inprocess.InProcess(make()), SETTLE + 0.6)


def test_an_emergency_stop_freezes_the_pads_and_drops_the_goal(under_way):
    loop = under_way
    loop.safety.stop('test')
    loop.tick()
    where = loop.data().encoder.values[-1]
    upto(loop, loop.t + 0.5)
    data = loop.data()
    assert np.array_equal(data.encoder.values[-1], where)
    assert not loop.control.active
    assert data.command_position.t[-1] <= SETTLE + 0.6 + 1e-9
    said = {(o.node, o.outcome): o.message for o in data.outcomes}
    assert 'emergency stop' in said['actuator_driver', 'HELD']


def test_after_a_reset_nothing_moves_until_a_new_goal(under_way):
    loop = under_way
    loop.safety.stop('test')
    upto(loop, loop.t + 0.2)
    assert loop.safety.reset()[0] and loop.safety.permission is Permission.RUN
    loop.driver.release()
    upto(loop, loop.t + 0.1)
    where = loop.data().encoder.values[-1]
    upto(loop, loop.t + 0.4)
    assert np.array_equal(loop.data().encoder.values[-1], where)


def test_a_hold_brakes_within_the_acceleration_limit(under_way):
    loop, params = under_way, make().scenario.actuators
    before = loop.data().encoder.values
    speed = (before[-1] - before[-2]).max() / 0.05
    loop.safety.hold('test')
    upto(loop, loop.t + 0.5)
    q = loop.data().encoder.values
    longest = params.max_speed**2 / (2.0 * params.max_acceleration) + 0.05 * params.max_speed
    assert speed > 1e-3
    assert np.all(q[-1] - before[-1] <= longest)
    assert np.array_equal(q[-1], q[-4])


def test_the_controllers_own_hold_keeps_command_and_goal(under_way):
    loop = under_way
    loop.control.hold()
    upto(loop, loop.t + 0.3)
    command = loop.step.command
    upto(loop, loop.t + 0.4)
    assert loop.step.outcome is Outcome.HELD and np.array_equal(loop.step.command, command)
    assert loop.control.active


def test_too_much_force_is_an_emergency_stop():
    cell = make(limits={'pad_force_N': 0.5})
    loop = upto(inprocess.InProcess(cell, ('em', 'force')), SETTLE + 2.0)
    assert loop.safety.permission is Permission.STOP and 'pad_1' in loop.safety.reason
    assert not loop.control.active
    force = np.linalg.norm(loop.data().force.values, axis=2)
    assert force.max() < 2.0   # it stopped where it was noticed, not where the task would end


def test_without_tasks_it_is_over_after_the_rest():
    loop = inprocess.InProcess(make(tasks=[]))
    while not loop.finished:
        loop.tick()
    assert loop.work_over and loop.data().tasks == ()
    assert loop.t == pytest.approx(SETTLE, abs=0.11)


def test_a_refused_goal_is_a_task_that_was_not_done():
    cell = make()
    loop = inprocess.InProcess(cell)
    loop.tracker.params = dataclasses.replace(loop.tracker.params, dropout_probability=1.0)
    data = upto(loop, SETTLE + 0.5).data()
    assert not loop.control.active and data.tasks == () and data.tasks_planned == 1
    assert [(o.node, o.count) for o in data.outcomes if o.outcome == 'REJECTED'] == [
        ('operator', 1)]
    goals = {goal.name: goal.met for goal in assess(data).targets}
    assert goals['tasks done'] is False


def test_an_unknown_sensor_is_refused():
    with pytest.raises(ConfigError, match="sensor 'radar'; must be among em, optical, force"):
        inprocess.run(make(), sensors=('em', 'radar'))
