"""What is timed is the diagnosis, of the recordings and the scene that the row names."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.scene import load_scene
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.experiments import diagnosis_time as timing
from arm_brachy.experiments.diagnosis_cases import store
from arm_brachy.experiments.diagnosis_plan import SCENE, plan
from arm_brachy.experiments.diagnosis_recordings import observe
from arm_brachy.registry import parse_terms

BUSY = 0.3      # s


def busy(evidences, scene, *, seed):
    """Stands for the diagnosis: the CPU is busy for a while, half of the time after it sleeps."""
    end = time.process_time() + BUSY
    while time.process_time() < end:
        np.ones(1000).sum()
    time.sleep(BUSY)
    cause = SimpleNamespace(term='gravity')
    return SimpleNamespace(verdict='named', causes=(cause, cause))


def test_a_row_tells_cpu_time_apart_from_waiting(push, tmp_path, monkeypatch):
    file = tmp_path / 'one.npz'
    store(file, observe(plan()[0], push))
    monkeypatch.setattr(timing, 'absolute', busy)
    row = timing.answered(timing.Timed('pushed', (file, file), SCENE, 1.0))
    assert BUSY <= row['cpu_s'] < 1.5 * BUSY
    assert row['wall_s'] >= 2.0 * BUSY
    assert row['recordings'] == 2 and row['recorded_s'] == pytest.approx(2 * 9.8, abs=0.2)
    assert row['elements'] == len(specimen_of(load_scene(SCENE)).mesh.tets)
    assert (row['verdict'], row['causes']) == ('named', 'gravity')
    assert 100.0 < row['peak_MB'] < 24e3


@pytest.mark.parametrize('cpu, met', [(59.9, True), (60.1, False)])
def test_a_goal_is_missed_by_more_than_was_asked_for(cpu, met):
    goal = timing._goal({'case': 'nothing', 'cpu_s': cpu}, timing.SINGLES)
    assert goal.met is met and goal.value == cpu and goal.goal == '<= 60'


def test_what_is_planted_is_of_the_registry():
    planted = {case: [term.spec.name for term in parse_terms(terms, timing.NAME)]
               for case, (terms, _) in timing.PLANTED.items()}
    assert planted == {'nothing': [], 'one cause': ['strain_stiffening'],
                       'two causes': ['strain_stiffening', 'actuator_compliance']}
