"""How far a body with pads may swing, against integration in time."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.diagnosis.likelihood.inertia_bound import inertia_of, said, with_lag, with_swing
from arm_brachy.diagnosis.likelihood.observation import KINDS, Measured, channels_of
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.specimen import attach, specimen_of
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.diagnosis.signals.motion import Motion, Path
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.tissue.dynamics import DynamicOptions
from arm_brachy.tissue.simulator import TissueSimulator

TICK = 0.01
CORNERS = np.array([0.0, 0.2, 0.45, 1.6, 1.8, 2.4])     # s: two ramps and their stands
PUSH = np.array([0.0, 0.0, 5e-3, 5e-3, 2e-3, 2e-3])
CENTRES = np.array([0.325, 0.51, 0.56, 0.7, 0.9, 1.2, 1.5, 1.7, 1.86, 2.1, 2.3])
WIDTH = 0.04


@pytest.fixture(scope='module')
def soft(coarse_scene):
    """Specimen of 1 kPa, whose modes begin at 5 Hz; its damping ratio there is 0.04."""
    scene = coarse_scene('linear')
    return specimen_of(replace(scene, dynamics='implicit', rayleigh_alpha=2.0,
                               rayleigh_beta=5e-4, material=replace(scene.material, E=1e3)))


@pytest.fixture(scope='module')
def motion(soft):
    q = np.zeros((len(CORNERS), len(soft.pads)))
    q[:, 0] = PUSH
    return Motion(CORNERS, q, 1e-5, 1e-4)


@pytest.fixture(scope='module')
def states(motion):
    v = np.zeros((len(CENTRES), motion.q.shape[1]))
    v[:, 0] = np.interp(CENTRES + 1e-6, *_steps(motion.t, motion.velocity[:, 0]))
    return SimpleNamespace(t=CENTRES, width=np.full(len(CENTRES), WIDTH), velocity=v)


def _steps(t, values):
    """A staircase as np.interp takes it."""
    return np.repeat(t, 2)[1:-1] + np.tile([0.0, -1e-9], len(values)), np.repeat(values, 2)


@pytest.fixture(scope='module')
def off(soft, motion):
    """kind -> (m, c, 3) by which window means of a plant with inertia are off equilibria."""
    t = TICK * np.arange(1, round(CORNERS[-1] / TICK) + 1)
    q = Path(motion.t, motion.q).at(t)
    plant = TissueSimulator(soft.body, (), dynamics='implicit',
                            options=DynamicOptions(max_step=0.5 * TICK))
    plant.reset(0.0)
    attached, markers = attach(soft, soft.body), len(soft.markers)
    pads = q[..., None] * soft.directions
    seen = {kind: [] for kind in KINDS}
    for now, there in zip(t, pads, strict=True):
        state = plant.step(now, there)
        points = attached.points(state.x, there, np.zeros(3))
        seen[OPTICAL].append(points[:markers])
        seen[EM].append(points[markers:])
        seen[FORCE].append(state.pad_force)
    found = ForwardModel(soft).predict(Path(t, q), t)
    assert found.valid.all()
    error = {kind: np.array(seen[kind]) - found.get(kind) for kind in KINDS}
    inside = [np.abs(t - centre) <= 0.5 * WIDTH + 1e-9 for centre in CENTRES]
    return {kind: np.stack([one[some].mean(axis=0) for some in inside])
            for kind, one in error.items()}


@pytest.mark.parametrize('kind', KINDS)
def test_what_inertia_adds_is_about_what_is_allowed_for_it(soft, motion, states, off, kind):
    """Root mean squares; modes that meet in one reading may add up to more than theirs."""
    swing = inertia_of(soft).swing(motion, states)[kind]
    tissue = [i for i, name in enumerate(channels_of(soft)[kind]) if kind != OPTICAL
              or soft.carriers[soft.markers.index(name)] == 'tissue']
    real, allowed = np.linalg.norm(off[kind], axis=2)[:, tissue], swing[:, tissue]
    assert (real < 1.5 * allowed).all()
    assert 1.0 < np.sqrt(np.mean(allowed ** 2) / np.mean(real ** 2)) < 4.0


def test_before_the_first_push_and_long_after_the_last_nothing_swings(soft, motion):
    late = SimpleNamespace(t=np.array([0.1, 0.5, 30.0]), width=np.full(3, WIDTH),
                           velocity=np.zeros((3, motion.q.shape[1])))
    swing = inertia_of(soft).swing(motion, late)
    for one in swing.values():
        assert not one[0].any() and one[2].max() < 1e-6 * one[1].max()


def test_a_quasi_static_scene_has_none_and_no_note(linear):
    assert inertia_of(linear) is None and said([SimpleNamespace(swing={})], None) == ()
    given = Calibration(clock=1.0)
    assert with_lag(given, linear.scene) is given and with_lag(None, linear.scene) is None


def test_what_swings_comes_late_by_a_radian_of_its_slowest_mode(soft):
    lag = inertia_of(soft).lag
    assert with_lag(None, soft.scene).clock == pytest.approx(np.hypot(Calibration().clock, lag))
    assert with_lag(Calibration(gain=0.5), soft.scene).gain == 0.5
    stiff = replace(soft.scene, material=replace(soft.scene.material, E=4e3))
    assert inertia_of(specimen_of(stiff)).lag == pytest.approx(0.5 * lag, rel=1e-6)


def test_states_have_it_beside_what_a_model_may_be_wrong_by():
    stream = Measured(FORCE, ('b',), np.zeros((2, 1, 3)), np.ones((2, 1), bool),
                      np.ones((2, 1, 3)), np.eye(2), own=3.0)
    wide, = with_swing([stream], {FORCE: np.array([[9.0, 4.0], [9.0, 0.0]])}, {FORCE: 'ab'})
    np.testing.assert_allclose(wide.own[:, 0, 0], [5.0, 3.0])
    swing = {OPTICAL: np.array([[2e-5]]), EM: np.zeros((1, 0)), FORCE: np.array([[0.03]])}
    note, = said([SimpleNamespace(swing=swing)], Calibration(clock=0.025))
    assert '0.02 mm and 0.03 N' in note and '25 ms' in note
