"""Open loop and rigid: what baselines know and do not know."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.control.tissue_model import TissueModel
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.estimation import open_loop, rigid
from arm_brachy.estimation.estimate import Surface

NAMES = ('target_1', 'target_5')


@pytest.fixture(scope='module')
def scene():
    folder = config_dir() / 'scenes'
    return with_mesh(load_scene(folder / 'breast.yaml'), folder / 'breast' / 'breast_600.msh')


@pytest.fixture(scope='module')
def markers(scene):
    return tuple(m.name for m in scene.markers if m.body == 'tissue')


def test_open_loop_is_the_controllers_model(scene, markers):
    q = np.array([4e-3, 0.0, 2e-3, 0.0])
    said = open_loop.build(scene, (), NAMES, markers).step(
        Surface(0.0, q, np.full((19, 3), np.nan)))
    model = TissueModel(scene)
    for name, point in zip(NAMES, said.points, strict=True):
        np.testing.assert_allclose(point, model.evaluate(q, name).position, atol=1e-8)
    assert said.outcome is Outcome.OK and np.isnan(said.covariance).all()


def test_open_loop_says_when_it_has_no_equilibrium_and_goes_on_after(scene, markers, monkeypatch):
    one, blind = open_loop.build(scene, (), NAMES, markers), np.full((19, 3), np.nan)
    q = np.array([2e-3, 0.0, 0.0, 0.0])
    with monkeypatch.context() as patch:
        patch.setattr(one._solver, 'solve', lambda x, pads: SimpleNamespace(
            outcome=Outcome.NOT_CONVERGED))
        said = one.step(Surface(0.0, q, blind))
        assert said.outcome is Outcome.NOT_CONVERGED and np.isnan(said.points).all()
    assert one.step(Surface(0.1, q, blind)).outcome is Outcome.OK


def test_rigid_carries_targets_through_a_rigid_motion(scene, markers):
    one = rigid.build(scene, (), NAMES, markers)
    R, p = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix(), np.array([3e-3, -1e-3, 2e-3])
    rest = np.array([m.position for m in scene.markers if m.name in markers])
    where = rest @ R.T + p
    where[4] = np.nan
    said = one.step(Surface(0.0, np.zeros(4), where))
    goal = np.array([t.position for t in scene.targets if t.name in NAMES]) @ R.T + p
    np.testing.assert_allclose(said.points, goal, atol=1e-12)


def test_rigid_refuses_markers_on_a_line(scene, markers):
    one, where = rigid.build(scene, (), NAMES, markers), np.full((19, 3), np.nan)
    where[:2] = np.eye(3)[:2]
    said = one.step(Surface(0.0, np.zeros(4), where))
    assert said.outcome is Outcome.REJECTED and '2 markers seen' in said.message
    assert np.isnan(said.points).all()


def test_names_that_the_scene_lacks_and_markers_on_pads_are_refused(scene):
    with pytest.raises(ConfigError, match="no target 'target_9'"):
        rigid.build(scene, (), ('target_9',), ())
    with pytest.raises(ConfigError, match='marker pad_1 is on pad_1'):
        rigid.build(scene, (), NAMES, ('pad_1',))
