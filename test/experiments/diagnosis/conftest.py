"""What the tests of the study share: a label, a made-up answer, four seconds of truth."""

import json

import numpy as np
import pytest

from arm_brachy.core.random import stream
from arm_brachy.diagnosis.report.answer import Diagnosis, Provenance
from arm_brachy.diagnosis.results.parts import Place
from arm_brachy.experiments.diagnosis_cases import labels
from arm_brachy.experiments.diagnosis_plan import base_cell, plan
from arm_brachy.experiments.diagnosis_recordings import Motion

MM = 1e-3


@pytest.fixture(scope='session')
def named():
    """Function: name, size -> the Case in which that term is planted at that size."""
    faults = {(c.planted.term.spec.name, c.planted.size): c for c in plan() if c.planted}
    return lambda name, size=1.0: faults[name, size]


@pytest.fixture(scope='session')
def label(named):
    """Function: name of a term or None, size -> label of its case."""
    null = plan()[0]
    return lambda name, size=1.0: labels(null if name is None else named(name, size), 'case.npz')


@pytest.fixture(scope='session')
def answer():
    """Function: verdict, causes, other statements -> Diagnosis as JSON."""
    def made_up(verdict, *causes, **more):
        source = Provenance('made up', 1, 'unknown', 'none', 'breast.yaml', ())
        if verdict == 'unexplained':
            more = {'where': (Place(stream='optical'),), **more}
        return json.loads(Diagnosis(verdict, source, causes, **more).to_json())

    return made_up


@pytest.fixture(scope='session')
def motion():
    """Four seconds without any motion."""
    scene = base_cell().scene
    rest = np.array([p.position for p in (*scene.markers, *scene.targets)])
    t = 0.05 * np.arange(1, 81)
    force = np.zeros((80, 4, 3))
    force[:, :, 2] = 1.0
    return Motion(t, np.zeros((80, 4)), np.tile(rest, (80, 1, 1)), np.zeros((80, 4, 3)),
                        force)


@pytest.fixture
def push():
    """Motion of a pad that moved alone."""
    rng, t = stream(1, 'test'), np.linspace(0.1, 9.9, 200)
    scene = base_cell().scene
    motion = Motion(t, *(np.zeros(shape) for shape in (
        (200, 4), (200, 31, 3), (200, 4, 3), (200, 4, 3))))
    motion.points[:] = [p.position for p in (*scene.markers, *scene.targets)]
    motion.encoder[60:120, 0] = 5 * MM
    motion.points[60:120, 19, 0] -= 5 * MM      # the marker on pad_1
    motion.force[:] = rng.normal(0.0, 0.01, motion.force.shape)
    return motion
