"""The bench of the model verification, on a plant that is the model: nothing may be left over."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.paths import config_dir
from arm_brachy.experiments import model_verification as experiment
from arm_brachy.scenario import Overlay, load_cell, resolve


@pytest.fixture(scope='module')
def cell():
    """No term, the model's own mesh and material; encoders without counts."""
    whole = load_cell(config_dir() / 'scenarios' / experiment.SCENARIO)
    ideal = replace(whole.scenario.actuators, encoder_resolution=0.0)
    same = Overlay(element='linear')  # any element will do, this one is quick
    return resolve(replace(whole.scenario, tasks=(), plant=same, model=same, actuators=ideal),
                   whole.path)


@pytest.fixture(scope='module')
def pushes(cell):
    return list(experiment.pushes(cell, 1))


def test_every_target_carries_a_sensor(cell, pushes):
    assert cell.em_tools == tuple(f'target_{i}' for i in range(1, 6))
    assert [(p.pad, p.step) for p in pushes] == [('pad_2', s) for s in experiment.STEPS]


def test_a_model_that_is_the_plant_has_no_error(pushes):
    """What is left is the servo's last nanometres and two Newton tolerances."""
    for push in pushes:
        for target, true in push.true.items():
            assert push.modelled[target] == pytest.approx(true, abs=1e-7)


def test_measured_and_true_differ_by_averaged_noise(pushes):
    """0.14 mm rms length over 40 samples, twice: 0.031 mm rms; 15 displacements."""
    misses = [np.linalg.norm(p.measured[n] - p.true[n]) for p in pushes for n in p.true]
    assert np.sqrt(np.mean(np.square(misses))) == pytest.approx(0.031e-3, rel=0.5)


def test_targets_go_along_the_push_and_further_the_further_it_is(pushes):
    for target in pushes[0].true:
        way = np.array([-push.true[target][1] for push in pushes])  # pad_2 pushes along -y
        assert np.all(way > 0.0) and np.all(np.diff(way) > 0.0)
        assert np.all(way < experiment.STEPS)
