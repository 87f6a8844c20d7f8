"""A coarse breast and a short path of its pads, for tests of forward models."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.diagnosis.model.specimen import specimen_of
from arm_brachy.diagnosis.signals.motion import Path

SCENES = config_dir() / 'scenes'


@pytest.fixture(scope='session')
def coarse_scene():
    """Function from the kind of element to the scene on its coarse mesh."""
    scene = with_mesh(load_scene(SCENES / 'breast.yaml'), SCENES / 'breast' / 'breast_600.msh')
    return lambda element='quadratic': replace(scene, element=element)


@pytest.fixture(scope='session')
def linear(coarse_scene):
    """Specimen with linear elements, for what is no question of accuracy."""
    return specimen_of(coarse_scene('linear'))


@pytest.fixture(scope='session')
def quadratic(coarse_scene):
    return specimen_of(coarse_scene('quadratic'))


@pytest.fixture(scope='session')
def encoder():
    """Path at 50 Hz for 9.6 s: pad 1 to 6 mm, back to 2, to 8; pad 2 to 5 and back to 3."""
    t = np.arange(481) * 0.02
    first = np.interp(t, [0.0, 1.0, 1.6, 3.0, 3.6, 5.0, 6.0],
                      [0.0, 0.0, 6e-3, 6e-3, 2e-3, 2e-3, 8e-3])
    second = np.interp(t, [7.0, 7.8, 8.2, 8.6], [0.0, 5e-3, 5e-3, 3e-3])
    return Path(t, np.stack([first, second, 0.0 * t, 0.0 * t], axis=1))
