"""Every controller, closed and open loop, through one suite."""

import dataclasses

import numpy as np
import pytest

from arm_brachy.control.goal import task
from arm_brachy.control.loop import ManipulatorParams
from arm_brachy.control.manipulator import Manipulator
from arm_brachy.control.mpc import MpcParams
from arm_brachy.control.tissue_model import TissueModel
from arm_brachy.core import config
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene

CONTROLLERS = {
    'closed, push only': ManipulatorParams(),
    'closed, retraction': ManipulatorParams(mpc=MpcParams(retraction=True)),
    'open, push only': ManipulatorParams(loop='open'),
}


@pytest.fixture(scope='module')
def scene():
    breast = load_scene(config_dir() / 'scenes' / 'breast.yaml')
    return dataclasses.replace(breast, element='linear')


@pytest.fixture(params=CONTROLLERS, name='params')
def _params(request):
    return CONTROLLERS[request.param]


def build(scene, params):
    names = [p.name for p in scene.pads]
    return Manipulator(params, TissueModel(scene), [p.stroke for p in scene.pads], 5e-3, names)


def drive(loop, scene, steps=8, seed=0):
    """A few steps with ideal servos and a noisy tracker that sees the model's own motion."""
    rng = np.random.default_rng(seed)
    loop.set_goal(task(3, scene.targets[0].name))
    q, out = np.zeros(len(scene.pads)), []
    for k in range(1, steps + 1):
        y = loop.rest(loop.target) + 0.2 * np.array([q[2], q[3], 0.0])
        out.append(loop.step(0.1 * k, q, [(0.1 * k, y + 1e-4 * rng.normal(size=3))]))
        q = out[-1].command
    return out


def test_same_seed_same_bits(scene, params):
    first, second = (drive(build(scene, params), scene) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        for name in ('command', 'estimate', 'disturbance', 'jacobian', 'reference', 'error'):
            assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), name


def test_shapes_are_as_documented_and_everything_is_finite(scene, params):
    p = len(scene.pads)
    shapes = {'command': (p,), 'pending': (p,), 'jacobian': (3, p), 'reference': (3,),
              'estimate': (3,), 'disturbance': (3,), 'error': (3,), 'closest': (3,)}
    for step in drive(build(scene, params), scene):
        assert step.outcome is Outcome.OK
        for name, shape in shapes.items():
            value = getattr(step, name)
            assert value.shape == shape and np.all(np.isfinite(value)), name


def test_what_a_step_reports_cannot_be_used_to_disturb_the_controller(scene, params):
    for step in drive(build(scene, params), scene, steps=3):
        for name in ('command', 'pending', 'estimate', 'disturbance', 'jacobian', 'reference',
                     'error', 'closest'):
            with pytest.raises(ValueError, match='read-only'):
                getattr(step, name)[...] = 9.0


def test_inputs_are_neither_kept_nor_changed(scene, params):
    loop, twin = build(scene, params), build(scene, params)
    q, y = np.zeros(4), loop.rest(loop.target).copy()
    for k in range(1, 5):
        if k == 2:
            loop.set_goal(task(1, loop.target))
            twin.set_goal(task(1, loop.target))
        step = loop.step(0.1 * k, q, [(0.1 * k, y)])
        assert np.array_equal(q, np.zeros(4)) and np.array_equal(y, loop.rest(loop.target))
        q[:], y[:] = 7.0, 7.0        # a node reusing its buffers
        clean = twin.step(0.1 * k, np.zeros(4), [(0.1 * k, twin.rest(twin.target))])
        assert np.array_equal(step.command, clean.command)
        q[:], y[:] = 0.0, loop.rest(loop.target)


def test_commands_keep_stroke_and_speed(scene, params):
    commands = np.array([s.command for s in drive(build(scene, params), scene, steps=12)])
    push = np.diff(commands, axis=0, prepend=0.0)
    assert np.abs(push).max() <= 5e-4 * (1 + 1e-9)
    if not params.mpc.retraction:
        assert push.min() >= 0.0
    assert commands.min() >= 0.0 and np.all(commands <= [p.stroke for p in scene.pads])


def test_model_jacobian_is_the_slope_of_its_position(scene):
    model, q, h = TissueModel(scene), np.array([4e-3, 1e-3, 0.0, 2e-3]), 1e-5
    target = scene.targets[1].name
    J = model.evaluate(q, target).jacobian
    for i in range(4):
        ahead, behind = (model.evaluate(q + s * h * np.eye(4)[i], target).position
                         for s in (1, -1))
        assert np.allclose((ahead - behind) / (2 * h), J[:, i], atol=1e-5)


@pytest.mark.parametrize(('key', 'value'), [
    ('tolerance_mm', -1.0), ('loop', 'ajar'), ('stale_after_s', 'soon'), ('patience', 3)])
def test_bad_configuration_is_refused_by_name(key, value):
    with pytest.raises(ConfigError, match=key):
        config.from_mapping(ManipulatorParams, {key: value}, 'scenario.yaml')


def test_parameters_survive_a_round_trip(params):
    written = config.to_mapping(params)
    assert config.from_mapping(ManipulatorParams, written, 'x') == params
    assert dataclasses.is_dataclass(params)
