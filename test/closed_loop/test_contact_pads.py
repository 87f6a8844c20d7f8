"""The whole cell in one process: pads that only touch in the plant, bonded ones in the model."""

import dataclasses

import numpy as np
import pytest

from arm_brachy import inprocess
from arm_brachy.core import config
from arm_brachy.core.paths import config_dir
from arm_brachy.scenario import Scenario, resolve

PATH = config_dir() / 'scenarios' / 'in_process.yaml'  # no such file; scenes are found from there
SETTLE, DURATION = 0.5, 5.0
LIMIT = 0.3e-3   # the goal of every closed loop, evaluation.assess.Goals
GOAL = -2e-3     # m along x


def make():
    """Target 1 by 2 mm; plant with linear elements too, for time: contact is what is asked."""
    task = {'name': 'task_1', 'target': 'target_1', 'axes': ['x'], 'displacement_mm': [-2, 0, 0],
            'duration_s': DURATION}
    given = {'name': 'in_process', 'seed': 4, 'scene': '../scenes/breast.yaml',
             'settle_s': SETTLE, 'model': {'element': 'linear'},
             'plant': {'element': 'linear', 'nu': 0.47}, 'tasks': [task]}
    cell = resolve(config.from_mapping(Scenario, given, 'in_process'), PATH)
    pads = tuple(dataclasses.replace(pad, contact='touching') for pad in cell.plant.pads)
    return dataclasses.replace(cell, plant=dataclasses.replace(cell.plant, pads=pads))


@pytest.fixture(scope='module')
def ran():
    """(RunData, axial force (ticks, p) [N] the tissue presses each pad back with)."""
    loop, pressed = inprocess.InProcess(make(), ('em', 'force')), []
    step = loop.body.step

    def watched(t, q):
        reading = step(t, q)
        assert reading.outcome.ok
        pressed.append(-np.sum(reading.pad_force * loop._directions, axis=1))
        return reading

    loop.body.step = watched
    while not loop.finished:
        loop.tick()
    return loop.data(), np.array(pressed)


def test_the_goal_is_reached_and_held(ran):
    data, _ = ran
    window, = data.tasks
    truth = data.truth['target_1'].between(window.t_end - 2.0, window.t_end).values[:, 0]
    start = data.truth['target_1'].values[0, 0]
    np.testing.assert_allclose(truth - start, GOAL, rtol=0.0, atol=LIMIT)


def test_pads_push_and_never_pull(ran):
    _, pressed = ran
    assert pressed.max() > 0.1
    assert pressed.min() >= 0.0


def test_pads_that_are_home_feel_nothing(ran):
    """Nothing but rounding at zero travel, within a micrometre of it less than a sensor feels."""
    data, pressed = ran
    travel = np.max(data.pad_displacement.values, axis=1)
    assert travel[0] == 0.0 and travel[-1] < 1e-6
    assert pressed[travel <= 0.0].max() < 1e-20
    assert pressed[-1].max() < 1e-3 * make().scenario.force.noise
