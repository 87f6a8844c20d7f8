"""KF-ADMM: identities of its filter, its limits, its outcomes."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.outcome import Outcome
from arm_brachy.core.paths import config_dir
from arm_brachy.core.scene import load_scene, with_mesh
from arm_brachy.estimation import kf_admm, open_loop, volume_prox
from arm_brachy.estimation.admm_points import AdmmPoints
from arm_brachy.estimation.estimate import Surface
from arm_brachy.estimation.kf_admm import KfAdmm, KfAdmmParams
from arm_brachy.estimation.steady_gain import plain_step, steady_covariance
from arm_brachy.registry import parse_terms
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.mesh import interpolate
from arm_brachy.tissue.newton import StaticSolver

TARGETS = ('target_1', 'target_5')
Q = np.array([6e-3, 0.0, 0.0, 3e-3])


@pytest.fixture(scope='module')
def scene():
    """The coarse breast with linear elements: 128 free nodes, so that filters are small."""
    folder = config_dir() / 'scenes'
    whole = with_mesh(load_scene(folder / 'breast.yaml'), folder / 'breast' / 'breast_600.msh')
    return replace(whole, element='linear', material=replace(whole.material, nu=0.4))


@pytest.fixture(scope='module')
def markers(scene):
    return tuple(m.name for m in scene.markers if m.body == 'tissue')


@pytest.fixture(scope='module')
def truth(scene, markers):
    """The model itself, pushed by Q: node positions, and markers on them."""
    loop = open_loop.build(scene, (), TARGETS, markers)
    said = loop.step(Surface(0.0, Q, np.full((len(markers), 3), np.nan)))
    return said, interpolate(loop._model.marker_rider, said.x)


@pytest.fixture(scope='module')
def built(scene, markers):
    return KfAdmm(scene, (), TARGETS, markers, KfAdmmParams())


def surfaces(points, count=3):
    return [Surface(0.1 * i, Q, points) for i in range(count)]


def test_element_without_shear_has_the_minimiser_of_its_energy():
    """Gradient of ratio / 2 (det z - 1)^2 + |z - Y|^2 / 2 vanishes."""
    rng = np.random.default_rng(3)
    Y = np.eye(3).reshape(9, 1) + 0.05 * rng.standard_normal((9, 200))
    z, u, ratio = Y.copy(), np.zeros_like(Y), np.full(200, 2.5)
    assert volume_prox.local_step(Y, z, u, ratio, 1e-10) < volume_prox.MOST
    F = z.T.reshape(-1, 3, 3)
    J = np.linalg.det(F)
    pressure = (ratio * (J - 1.0) * J)[:, None, None] * np.swapaxes(np.linalg.inv(F), 1, 2)
    np.testing.assert_allclose(pressure + F - Y.T.reshape(-1, 3, 3), 0.0, atol=1e-9)
    np.testing.assert_array_equal(u, Y - z)


@pytest.mark.parametrize('element', ('linear', 'quadratic'))
def test_without_markers_the_iteration_ends_at_newtons_equilibrium(scene, element):
    """Points of linear and of quadratic elements; nu = 0.49 with the latter."""
    body = build_body(replace(scene, element=element, material=replace(
        scene.material, nu=0.49 if element == 'quadratic' else 0.4)))
    admm = AdmmPoints(body, 50e-3, 4.0, 0.4)
    pads = 3e-3 * np.array([p.direction for p in body.pads]) * [[1.0], [0.0], [0.0], [0.5]]
    exact = StaticSolver(body).solve(body.mesh.nodes, pads).x
    admm.start(body.mesh.nodes)
    off = []
    for count in (40, 100):
        for _ in range(count):
            admm.local_step()
            admm.predict(pads)
        off.append(np.linalg.norm(admm.x - exact, axis=1).max())
    assert off[1] < 0.1e-3 and off[1] < 0.3 * off[0]


def test_an_equilibrium_stays_where_it_is(scene):
    body = build_body(scene)
    pads = 3e-3 * np.array([p.direction for p in body.pads])
    exact = StaticSolver(body).solve(body.mesh.nodes, pads).x
    admm = AdmmPoints(body, 50e-3, 4.0, 0.4)
    admm.start(exact)
    for _ in range(5):
        admm.local_step()
        admm.predict(pads)
    assert np.abs(admm.x - exact).max() < 1e-7


def test_steady_covariance_is_the_recursions(built):
    """(4.6)-(4.7) on the 2N problem of the breast, step by step."""
    for process in ('white', 'correlated'):
        S, C, noise, R = kf_admm.filter_matrices(
            built._admm, built._C, replace(built.params, process=process))
        X = noise.copy()
        for _ in range(40):
            X = plain_step(X, S, C, noise, R)
        np.testing.assert_allclose(steady_covariance(S, C, noise, R), X,
                                   atol=1e-9 * np.abs(X).max())


def test_the_thesis_noise_hardly_reaches_the_inside(built, scene, markers):
    """Q = 3 I: gain near 1 at a marker, of a hundredth at the targets. Correlated: far more."""
    white = KfAdmm(scene, (), TARGETS, markers, KfAdmmParams(process='white'))
    reach = {}
    for name, one in (('white', white), ('correlated', built)):
        one._choose(np.ones(len(markers), dtype=bool))
        gain = one._gain[:len(one._admm.free)]
        assert np.diag(one._C @ gain).min() > 0.9
        reach[name] = np.abs(one._T @ gain).max()
    assert reach['white'] < 0.03 < 0.1 < reach['correlated']


def test_infinite_measurement_noise_is_plain_admm(scene, markers, truth):
    one = KfAdmm(scene, (), TARGETS, markers, KfAdmmParams(measurement_variance=np.inf))
    rng = np.random.default_rng(0)
    for surface in surfaces(truth[1] + 5e-3 * rng.standard_normal(truth[1].shape)):
        said = one.step(surface)
    plain = AdmmPoints(one._model.body, one.params.step, one.params.weight,
                       one.params.volume_weight)
    plain.start(one._start)
    for _ in range(3 * one.params.iterations):
        plain.local_step()
        plain.predict(one._model.pad_displacement(Q))
    np.testing.assert_array_equal(said.x, plain.x)
    assert np.isnan(said.covariance).all()    # a filter that sees nothing claims nothing


def test_exact_model_and_markers_lead_to_the_models_solution(built, truth):
    """And to it faster than without markers."""
    built.reset()
    for surface in surfaces(truth[1], 12):
        said = built.step(surface)
    assert np.abs(said.points - truth[0].points).max() < 0.05e-3
    built._admm.start(truth[0].x)
    after = built.step(Surface(0.0, Q, truth[1]))
    assert np.abs(after.points - truth[0].points).max() < 1e-6


def test_equal_input_equal_bits_and_a_fixed_number_of_iterations(built, truth, monkeypatch):
    made = []
    original = AdmmPoints.predict
    monkeypatch.setattr(AdmmPoints, 'predict', lambda self, pads: (made.append(1),
                                                                   original(self, pads)))
    said = []
    for _ in range(2):
        built.reset()
        said.append([built.step(s).x for s in surfaces(truth[1])][-1])
    np.testing.assert_array_equal(*said)
    assert len(made) == 2 * 3 * built.params.iterations


def test_covariance_is_positive_and_grows_as_markers_hide(built, truth):
    built.reset()
    few = truth[1].copy()
    few[5:] = np.nan
    sizes = []
    for points in (truth[1], few):
        P = built.step(Surface(0.0, Q, points)).covariance
        np.testing.assert_array_equal(P, np.swapaxes(P, 1, 2))
        assert np.linalg.eigvalsh(P).min() > 0.0
        sizes.append(P[:, 0, 0])
    assert (sizes[1] > sizes[0]).all()


def test_an_error_of_the_frame_is_carried_on(built, truth):
    """A translation known to 1 mm adds 1 mm^2 to every target along its axis, and no more."""
    frame = np.zeros((6, 6))
    frame[3, 3] = 1e-6
    built.reset()
    plain = built.step(Surface(0.0, Q, truth[1])).covariance
    wider = built.step(Surface(0.1, Q, truth[1], frame)).covariance
    np.testing.assert_allclose(wider - plain, np.diag([1e-6, 0.0, 0.0])[None].repeat(2, 0),
                               atol=1e-15)
    # a turn about the markers' middle moves a target across its arm
    turn = np.zeros((6, 6))
    turn[2, 2] = 1e-4
    part = kf_admm.frame_part(Surface(0.0, Q, truth[1], turn), truth[0].points)
    arm = truth[0].points - truth[1].mean(axis=0)
    np.testing.assert_allclose(part[:, 0, 0], 1e-4 * arm[:, 1] ** 2, rtol=1e-9)
    np.testing.assert_allclose(part[:, 1, 1], 1e-4 * arm[:, 0] ** 2, rtol=1e-9)


def test_too_few_markers_and_bad_covariance_are_named(built, truth, monkeypatch):
    few = truth[1].copy()
    few[2:] = np.nan
    said = built.step(Surface(0.0, Q, few))
    assert said.outcome is Outcome.REJECTED and '2 of 19 markers seen' in said.message
    assert np.isnan(said.points).all()
    built._choose(np.ones(19, dtype=bool))
    monkeypatch.setattr(built, '_variance', np.array([1e-6, -1e-9]))
    said = built.step(Surface(0.0, Q, truth[1]))
    assert said.outcome is Outcome.NOT_CONVERGED
    assert 'covariance of target_5 is not positive' in said.message


def test_models_whose_filter_is_not_three_equal_ones_are_refused(scene, markers):
    for name, message in (('base_compliance', 'springs'), ('anisotropy', 'Neo-Hookean')):
        term = parse_terms([{'name': name} | ({'ratio': 0.5} if name == 'anisotropy' else {})],
                           'test')
        with pytest.raises(ConfigError, match=message):
            KfAdmm(scene, term, TARGETS, markers, KfAdmmParams())
    with pytest.raises(ConfigError, match='iterations = 0'):
        KfAdmmParams(iterations=0)
