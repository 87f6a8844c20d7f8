"""Load cells in line with the actuators, in whatever way they were written down."""

import numpy as np
import pytest

from arm_brachy.diagnosis.signals.force_axes import across, along_pushes, measured_axes
from arm_brachy.diagnosis.signals.stream import FORCE, Stream, components

N = 200
OBLIQUE = np.array([0.6, 0.0, -0.8])
PUSHES = {'a': np.array([1.0, 0.0, 0.0]), 'b': OBLIQUE}
# Forces that push back on either pad, pulses of 3 and 2 N.
PULSE = np.clip(np.sin(np.linspace(0.0, 9.0, N)), 0.0, None)
READ = -np.stack([3.0 * PULSE, 2.0 * PULSE[::-1]], axis=1)
READ += 0.02 * np.random.default_rng(5).standard_normal(READ.shape)


def stream(values):
    values = measured_axes(np.array(values))
    return Stream(FORCE, 0.01 * np.arange(N), ('a', 'b'), values,
                  np.isfinite(values).all(axis=2), ('a', 'b'), np.zeros((2, 3)))


def vectors(*ways):
    return np.stack([READ[:, k:k + 1] * way for k, way in enumerate(ways)], axis=1)


def absent(way):
    return np.where(way == 0.0, np.nan, way)


@pytest.mark.parametrize('ways', [
    (PUSHES['a'], OBLIQUE), (absent(PUSHES['a']), OBLIQUE)])
def test_vectors_along_the_push_are_taken_along_it(ways):
    notes = []
    found = along_pushes(stream(vectors(*ways)), PUSHES, notes)
    np.testing.assert_allclose(found.values[..., 0], READ, atol=1e-12)
    np.testing.assert_array_equal(found.along, [PUSHES['a'], OBLIQUE])
    np.testing.assert_allclose(found.vectors, vectors(PUSHES['a'], OBLIQUE), atol=1e-12)
    assert found.valid.all() and 'a, b have one axis' in notes[0] and len(notes) == 1


def test_a_reading_in_an_axis_of_the_sensor_pushes_back_whatever_its_sign():
    z, notes = np.array([0.0, 0.0, 1.0]), []
    for sign in (1.0, -1.0):
        found = along_pushes(stream(vectors(PUSHES['a'], np.zeros(3)) + sign * np.stack(
            [0.0 * READ[:, [0]] * z, READ[:, [1]] * np.array([0.0, 1.0, 0.0])], axis=1)),
            PUSHES, notes)
        np.testing.assert_allclose(found.values[..., 0], READ, atol=1e-12)
    assert 'read on b lies on a line that is not the push' in notes[-1]


def test_sensors_of_three_axes_stay_as_they_are():
    rng, notes = np.random.default_rng(1), []
    given = stream(vectors(PUSHES['a'], OBLIQUE) + 0.01 * rng.standard_normal((N, 2, 3)))
    assert along_pushes(given, PUSHES, notes) is given and not notes


def test_a_force_without_noise_that_keeps_its_direction_was_measured_along_all_axes():
    """Aside of the push by 25 degrees, as a linear tissue's answer may be."""
    aside, notes = np.array([np.cos(0.44), np.sin(0.44), 0.0]), []
    given = stream(vectors(aside, [0.0, 0.36, -0.93]))
    assert along_pushes(given, PUSHES, notes) is given and not notes


def test_a_sensor_of_three_axes_beside_one_of_one_axis_keeps_them_all():
    rng, notes = np.random.default_rng(1), []
    values = vectors(PUSHES['a'], OBLIQUE)
    values[:, 1] += rng.standard_normal((N, 1)) * [0.0, 1.0, 0.0] + 0.1 * rng.random((N, 3))
    found = along_pushes(stream(values), PUSHES, notes)
    assert found.names == found.bodies == ('a', 'b', 'b', 'b')
    np.testing.assert_allclose(found.values[..., :2, 0], np.stack(
        [READ[:, 0], values[:, 1] @ OBLIQUE], axis=1), atol=1e-12)
    np.testing.assert_allclose(found.vectors[:, 1:].sum(axis=1), values[:, 1], atol=1e-12)
    assert 'sensors of a have one axis' in notes[0] and 'of these pads' in notes[0]


def test_the_axes_across_a_push_are_each_nearest_to_an_axis_of_their_own():
    for way in (OBLIQUE, np.array([0.0, -1.0, 0.0]), np.full(3, 3**-0.5)):
        frame = np.stack([way, *across(way)])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        assert sorted(np.abs(frame).argmax(axis=1)) == [0, 1, 2] or np.ptp(way) == 0.0
        assert len(set(np.abs(frame[1:]).argmax(axis=1))) == 2


def test_what_sensors_of_one_axis_show_of_a_vector():
    seen = components(np.ones((4, 2, 3)), np.array([PUSHES['a'], OBLIQUE]))
    np.testing.assert_allclose(seen, np.broadcast_to([[[1.0], [-0.2]]], (4, 2, 1)))
    assert components(seen, None) is seen
