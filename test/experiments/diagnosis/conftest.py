"""What the tests of the study share: a label, a made-up answer, four seconds of truth."""

import json

import numpy as np
import pytest

from arm_brachy.diagnosis.diagnosis import Diagnosis, Provenance
from arm_brachy.diagnosis.statements import Place
from arm_brachy.experiments.diagnosis_cases import labels
from arm_brachy.experiments.diagnosis_plan import base_cell, plan
from arm_brachy.experiments.diagnosis_recordings import Motion


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
