"""The EM tracker: noise against its parameters, volume, statuses, roll of a 5DOF sensor."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm_brachy.core.errors import ConfigError
from arm_brachy.devices.em_tracker import (
    EmTracker,
    EmTrackerParams,
    ToolStatus,
    smallest_rotation,
)

QUIET = replace(EmTrackerParams(), dropout_probability=0.0, latency=0.0)
EXACT = replace(QUIET, position_noise=0.0, orientation_noise=0.0)
NO_PADS = np.zeros((0, 3))


def _watch(params, points, rotations=None, seconds=1.0, seed=5, tick=0.05):
    """Samples of tools at rest."""
    k = len(points)
    points = np.asarray(points, dtype=float)
    rotations = np.tile(np.eye(3), (k, 1, 1)) if rotations is None else rotations
    tracker = EmTracker(params, [f't{i}' for i in range(k)], (), np.random.default_rng(seed))
    out = []
    for i in range(round(seconds / tick)):
        out += tracker.advance(tick * i, points, rotations, tick * (i + 1), points, rotations,
                               NO_PADS, NO_PADS)
    return out


def _at_distance(r):
    """A point on the generator axis, r [m] from its face."""
    return [0.0, 0.0, QUIET.generator_position[2] + r]


def test_position_noise_is_as_stated_and_isotropic():
    """rms length 0.14 mm; chi-square on 3 x 4000 errors, four standard errors."""
    x = np.array([s.position for s in _watch(QUIET, [_at_distance(0.3)], seconds=100.0)])
    error = x - _at_distance(0.3)
    assert len(error) == 4000
    ratio = np.sum(error**2) / len(error) / QUIET.position_noise**2
    assert abs(ratio - 1.0) < 4.0 * np.sqrt(2.0 / error.size)
    per_axis = np.mean(error**2, axis=0) * 3.0 / QUIET.position_noise**2
    assert (np.abs(per_axis - 1.0) < 4.0 * np.sqrt(2.0 / len(error))).all()


def test_noise_grows_as_the_fourth_power_of_distance_for_a_dipole_field():
    """Beyond the reference: doubling the field's loss is 2^4 in position (Raab et al. 1979)."""
    reference = replace(QUIET, reference_distance=0.2, bad_fit_residual=0.1)
    far = [s.position for s in _watch(reference, [_at_distance(0.4)], seconds=100.0)]
    error = np.array(far) - _at_distance(0.4)
    ratio = np.sum(error**2) / len(error) / (16.0 * QUIET.position_noise)**2
    assert abs(ratio - 1.0) < 4.0 * np.sqrt(2.0 / error.size)


def test_rms_over_the_cube_volume_meets_the_data_sheet():
    """Quadrature over the 500 mm cube: within the 0.48 mm that NDI states for it."""
    side = np.linspace(-0.25, 0.25, 41)
    p = np.stack(np.meshgrid(side, side, np.linspace(0.05, 0.55, 41)), axis=-1).reshape(-1, 3)
    growth = np.maximum(np.linalg.norm(p, axis=1) / QUIET.reference_distance, 1.0)**4
    assert 0.40e-3 < QUIET.position_noise * np.sqrt(np.mean(growth**2)) < 0.48e-3


def test_orientation_noise_of_both_kinds_of_sensor():
    turned = Rotation.from_rotvec([[0.4, -0.7, 0.2]])
    for kind in ('5dof', '6dof'):
        params = replace(QUIET, sensor=kind)
        samples = _watch(params, [_at_distance(0.3)], turned.as_matrix(), seconds=100.0)
        found = Rotation.from_quat([s.quaternion for s in samples])
        if kind == '6dof':
            angle, degrees = (turned.inv() * found).magnitude(), 3
        else:
            axis = turned.apply([0.0, 0.0, 1.0])[0]
            angle, degrees = np.arccos(found.apply([0.0, 0.0, 1.0]) @ axis), 2
        ratio = np.mean(angle**2) / params.orientation_noise**2
        assert abs(ratio - 1.0) < 4.0 * np.sqrt(2.0 / degrees / len(samples))


def test_5dof_reports_the_axis_and_no_roll():
    rng = np.random.default_rng(2)
    rotations = Rotation.random(20, rng=rng)
    rolled = rotations * Rotation.from_rotvec([0.0, 0.0, 1.1])
    points = np.tile(_at_distance(0.3), (20, 1))
    a = _watch(EXACT, points, rotations.as_matrix(), seconds=0.05)
    b = _watch(EXACT, points, rolled.as_matrix(), seconds=0.05)
    for one, other, truth in zip(a, b, rotations.as_matrix(), strict=False):
        np.testing.assert_allclose(one.quaternion, other.quaternion, atol=1e-12)
        turn = Rotation.from_quat(one.quaternion)
        np.testing.assert_allclose(turn.apply([0, 0, 1.0]), truth[:, 2], atol=1e-12)
        assert abs(turn.as_rotvec()[2]) < 1e-12


@pytest.mark.parametrize('axis', [[0, 0, 1.0], [0, 0, -1.0], [1.0, 0, 0], [1e-9, 0, -1.0]])
def test_smallest_rotation_near_the_poles(axis):
    turn = Rotation.from_quat(smallest_rotation(np.array(axis)))
    np.testing.assert_allclose(turn.apply([0, 0, 1.0]), axis / np.linalg.norm(axis), atol=1e-12)
    assert abs(turn.as_rotvec()[2]) < 1e-12


def test_6dof_reports_the_pose():
    rotations = Rotation.from_rotvec([[0.4, -0.7, 0.2]])
    sample = _watch(replace(EXACT, sensor='6dof'), [_at_distance(0.3)], rotations.as_matrix())[0]
    np.testing.assert_allclose(Rotation.from_quat(sample.quaternion).as_matrix(),
                               rotations.as_matrix()[0], atol=1e-12)
    np.testing.assert_allclose(sample.position, _at_distance(0.3), atol=1e-15)


@pytest.mark.parametrize(('offset', 'inside'), [
    ([0, 0, 0.051], True), ([0, 0, 0.049], False), ([0, 0, 0.549], True), ([0, 0, 0.551], False),
    ([0.249, -0.249, 0.3], True), ([0.251, 0, 0.3], False), ([0, -0.251, 0.3], False)])
def test_volume_is_the_cube_before_the_generator(offset, inside):
    """Generator turned to look along -x; its own x along world y."""
    params = replace(EXACT, generator_position=(0.3, 0.1, 0.2), generator_axis=(-2.0, 0.0, 0.0),
                     generator_side=(0.0, 1.0, 0.0))
    x, y, z = offset
    point = [0.3 - z, 0.1 + x, 0.2 - y]
    sample = _watch(params, [point])[0]
    assert sample.status is (ToolStatus.OK if inside else ToolStatus.OUT_OF_VOLUME)
    assert np.isfinite(sample.position).all() == inside


def test_only_an_ok_sample_carries_a_pose():
    params = replace(QUIET, dropout_probability=0.3, bad_fit_residual=2e-4)
    points = [_at_distance(0.3), _at_distance(2.0)]
    samples = _watch(params, points, seconds=20.0)
    assert {s.status for s in samples} == set(ToolStatus)
    for s in samples:
        ok = s.status is ToolStatus.OK
        assert np.isfinite(s.position).all() == ok
        assert np.isfinite(s.quaternion).all() == ok
        assert np.isfinite(s.quality) == (s.status in (ToolStatus.OK, ToolStatus.BAD_FIT))
        assert not s.quality > 9.9
        assert (s.status is ToolStatus.BAD_FIT) == (s.quality == 9.9)


def test_dropout_probability():
    """Binomial, four standard errors, on 8000 samples."""
    p = 0.05
    samples = _watch(replace(QUIET, dropout_probability=p), [_at_distance(0.3)] * 2,
                     seconds=100.0)
    missing = np.mean([s.status is ToolStatus.MISSING for s in samples])
    assert abs(missing - p) < 4.0 * np.sqrt(p * (1 - p) / len(samples))


def test_moving_tool_is_sampled_on_its_way():
    """1 m/s along x: the position at acquisition, not at the tick."""
    tracker = EmTracker(EXACT, ['t'], (), np.random.default_rng(0))
    start, end = np.array([[0.0, 0, 0]]), np.array([[0.1, 0, 0]])
    eye = np.eye(3)[None]
    for s in tracker.advance(0.0, start, eye, 0.1, end, eye, NO_PADS, NO_PADS):
        np.testing.assert_allclose(s.position, [s.t, 0.0, 0.0], atol=1e-12)


def test_parallel_generator_axes_are_refused():
    params = replace(QUIET, generator_axis=(0.0, 0.0, 1.0), generator_side=(0.0, 0.0, 2.0))
    with pytest.raises(ConfigError, match='generator_axis .* not parallel'):
        EmTracker(params, ['t'], (), np.random.default_rng(0))
