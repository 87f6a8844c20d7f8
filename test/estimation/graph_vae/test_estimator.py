"""The estimator on a network that is trained in seconds: what it finds, and what it refuses."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.estimation.es_mda import RankDeficient
from arm_brachy.estimation.estimate import Surface
from arm_brachy.estimation.graph_vae import weights
from arm_brachy.estimation.graph_vae.dataset import Dataset, scene_hash
from arm_brachy.estimation.graph_vae.estimator import GraphVaeParams, build
from arm_brachy.estimation.graph_vae.loads import draw_walk
from arm_brachy.estimation.graph_vae.modes import error
from arm_brachy.estimation.graph_vae.network import NetworkOptions
from arm_brachy.estimation.graph_vae.training import Training, TrainingOptions, travels
from arm_brachy.estimation.graph_vae.walk import walk_states
from arm_brachy.tissue.build import build_body, load_scene_mesh, marker_points, target_points
from arm_brachy.tissue.mesh import embed, interpolate
from arm_brachy.tissue.newton import NewtonOptions, StaticSolver

SCENES = config_dir() / 'scenes'
SCENE = with_mesh(load_scene(SCENES / 'breast.yaml'), SCENES / 'breast/breast_600.msh')
MESH = load_scene_mesh(SCENE)
MARKERS, MARKERS_AT = marker_points(SCENE)
TARGETS, TARGETS_AT = target_points(SCENE)
UNSEEN = (9, 19)     # first walks for the test (dataset.SPLITS)


def pushes():
    """States of pads 1 and 2 up to 8 mm, in walks of four."""
    solver = StaticSolver(build_body(SCENE), options=NewtonOptions(tolerance=1e-6))
    directions = np.array([pad.direction for pad in solver.body.pads])
    u = []
    for angle in np.linspace(0.0, np.pi / 2.0, 10):
        x = MESH.nodes
        for depth in (2e-3, 4e-3, 6e-3, 8e-3):
            q = depth * np.array([np.cos(angle), np.sin(angle), 0.0, 0.0])
            x = solver.solve(x, q[:, None] * directions).x
            u.append((x - MESH.nodes).astype(np.float32))
    return np.array(u)


@pytest.fixture(scope='module')
def file(tmp_path_factory):
    walk = np.repeat(np.arange(10), 4)
    walks = [{'number': k, 'kind': 'own'} for k in range(10)]
    data = Dataset({'scene': 'breast', 'seed': 1}, pushes(), walk, np.ones(40), walks)
    folder = tmp_path_factory.mktemp('net')
    Training(data, MESH, folder, TrainingOptions(epochs=0, latent=6), scene=SCENE,
             network=NetworkOptions((2, 3, 2), (4, 3, 3)))
    return folder / 'weights.npz', data


def surface(u, q, *, noise=0.0, hidden=()):
    x = MESH.nodes + u
    markers = interpolate(embed(MESH, MARKERS_AT, names=MARKERS), x)
    markers = markers + noise * np.random.default_rng(0).standard_normal(markers.shape)
    markers[list(hidden)] = np.nan
    return Surface(0.1, q, markers), interpolate(embed(MESH, TARGETS_AT, names=TARGETS), x)


def made(file, **params):
    return build(SCENE, (), TARGETS, MARKERS, GraphVaeParams(weights=str(file[0]), **params))


def test_travel_is_read_off_the_states(file):
    q = travels(file[1], SCENE)
    assert q[3] == pytest.approx([8e-3, 0.0, 0.0, 0.0], abs=1e-6)
    assert q[-1] == pytest.approx([0.0, 8e-3, 0.0, 0.0], abs=1e-6)


def test_targets_are_found_within_the_ellipse_from_markers(file):
    estimator = made(file)
    for k in (10, 23, 34):
        q = travels(file[1], SCENE)[k]
        given, truth = surface(file[1].u[k], q, noise=5e-5)
        found = estimator.step(given)
        off = found.points - truth
        assert found.outcome.ok and np.linalg.norm(off, axis=1).max() < 0.5e-3
        assert np.linalg.norm(off, axis=1).max() < 0.4 * np.linalg.norm(truth - TARGETS_AT,
                                                                        axis=1).max()
        far = [o @ np.linalg.solve(P, o) for o, P in zip(off, found.covariance, strict=True)]
        assert max(far) < 16.0


def test_markers_correct_a_travel_that_is_wrong(file):
    """The prior says one push, the markers another: the estimate follows the markers."""
    given, truth = surface(file[1].u[3], np.array([4e-3, 0.0, 0.0, 0.0]))
    trusting, doubting = made(file, spread=1e-3), made(file, spread=20.0)
    off = [np.linalg.norm(e.step(given).points - truth, axis=1).mean()
           for e in (trusting, doubting)]
    assert off[1] < 0.5 * off[0]


def test_same_input_same_bits_and_hidden_markers_widen_the_ellipse(file):
    q = travels(file[1], SCENE)[7]
    given, _ = surface(file[1].u[7], q)
    few, _ = surface(file[1].u[7], q, hidden=range(3, 19))
    estimator = made(file)
    one = estimator.step(given)
    estimator.reset()
    assert np.array_equal(one.points, estimator.step(given).points)
    wide = np.trace(estimator.step(few).covariance, axis1=1, axis2=2)
    assert np.all(wide > np.trace(one.covariance, axis1=1, axis2=2))


def test_two_markers_are_too_few(file):
    given, _ = surface(file[1].u[7], np.zeros(4), hidden=range(17))
    found = made(file).step(given)
    assert found.outcome is Outcome.TOO_FEW_MARKERS and np.isnan(found.points).all()


def test_uncertain_registration_widens_the_ellipse(file):
    q = travels(file[1], SCENE)[7]
    given, _ = surface(file[1].u[7], q)
    loose = replace(given, frame_covariance=np.diag([1e-4] * 3 + [1e-6] * 3))
    narrow, wide = made(file).step(given), made(file).step(loose)
    assert np.all(np.trace(wide.covariance, axis1=1, axis2=2)
                  > np.trace(narrow.covariance, axis1=1, axis2=2))


def test_few_members_are_announced(file):
    with pytest.warns(RankDeficient, match='5 members span at most 4 of 6'):
        made(file, members=5)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        made(file)


def test_other_pads_no_weights_and_terms_are_refused(file):
    moved = replace(SCENE, pads=SCENE.pads[:3])
    params = GraphVaeParams(weights=str(file[0]))
    with pytest.raises(ConfigError, match='other pads'):
        build(moved, (), TARGETS, MARKERS, params)
    with pytest.raises(ConfigError, match='no weights'):
        build(SCENE, (), TARGETS, MARKERS, GraphVaeParams(weights='nowhere.npz'))
    with pytest.raises(ConfigError, match='must be none'):
        build(SCENE, (_Term(),), TARGETS, MARKERS, params)


class _Term:
    class spec:
        name = 'gravity'


def test_shipped_weights_are_of_the_scene_and_say_where_they_come_from():
    about = weights.load(weights.SHIPPED / 'breast.npz').about
    assert about['scene'] == 'breast' and about['states'] > 7500
    assert about['scene_sha256'] == scene_hash(load_scene(SCENES / 'breast.yaml'))
    assert {'seed', 'epoch', 'cpu_s', 'data_seed', 'training'} <= set(about)


def test_shipped_network_reconstructs_unseen_walks_better_than_as_many_linear_modes():
    """Test walks of the data set, solved anew; the README's table has all of them."""
    trained = weights.load(weights.SHIPPED / 'breast.npz')
    scene = load_scene(SCENES / 'breast.yaml')
    walks = [draw_walk(scene, trained.about['data_seed'], number) for number in UNSEEN]
    assert {walk.kind for walk in walks} == {'own', 'random'}
    u = np.concatenate([walk_states(walk, 4)[0] for walk in walks])
    network = error(u, trained.decode(trained.encode(u))).mean()
    linear = error(u, trained.modes.decode(trained.modes.encode(u))).mean()
    assert trained.modes.shapes.shape[0] == trained.network.latent
    assert network < 0.9 * linear
