"""The distortion field: zero at its centre, divergence and curl as given, local, pad-driven."""

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.devices.terms.em_distortion import EmDistortion

CENTRE = (0.02, -0.01, 0.03)
TERM = EmDistortion(centre=CENTRE, gradient=0.12, rotation=(0.02, -0.05, 0.08), extent=0.1)
AT_REST = np.zeros((2, 3))


def _error(term, points, pads=AT_REST):
    points = np.atleast_2d(np.asarray(points, dtype=float))
    return term.distort(0.0, ('t',) * len(points), points, pads) - points


def _gradient(term, at, h=1e-5):
    """Central differences: entry [i, j] is d error_i / d x_j."""
    return np.column_stack([(_error(term, at + h * e) - _error(term, at - h * e))[0] / (2.0 * h)
                            for e in np.eye(3)])


def test_vanishes_at_the_centre():
    np.testing.assert_array_equal(_error(TERM, CENTRE), 0.0)


def test_divergence_and_curl_at_the_centre():
    J = _gradient(TERM, np.array(CENTRE))
    curl = np.array([J[2, 1] - J[1, 2], J[0, 2] - J[2, 0], J[1, 0] - J[0, 1]])
    assert np.trace(J) == pytest.approx(3.0 * TERM.gradient, rel=1e-6)
    np.testing.assert_allclose(curl, 2.0 * np.array(TERM.rotation), rtol=1e-6)
    np.testing.assert_allclose(0.5 * (J + J.T), TERM.gradient * np.eye(3), atol=1e-8)


def test_fades_and_is_largest_at_one_extent():
    """r exp(-r^2 / 2 L^2) peaks at r = L, with g L exp(-1/2)."""
    term = EmDistortion(gradient=0.1, extent=0.1)
    r = np.linspace(0.0, 0.8, 801)
    size = np.linalg.norm(_error(term, np.outer(r, [0.0, 0.6, 0.8])), axis=1)
    assert r[size.argmax()] == pytest.approx(0.1)
    assert size.max() == pytest.approx(0.1 * 0.1 * np.exp(-0.5))
    assert size[-1] < 1e-10


def test_pad_part_is_proportional_to_travel_and_the_same_everywhere():
    term = EmDistortion(gradient=0.0, pad_coupling=(0.1, 0.0, -0.05))
    pads = np.array([[0.003, 0.0, 0.004], [0.0, 0.01, 0.0]])
    points = [[0.0, 0.0, 0.0], [0.1, 0.2, 0.0]]
    np.testing.assert_allclose(_error(term, points, pads), [[1.5e-3, 0.0, -0.75e-3]] * 2,
                               atol=1e-17)
    one = EmDistortion(gradient=0.0, pad_coupling=(0.1, 0.0, 0.0), pad=0)
    np.testing.assert_allclose(_error(one, points, 2 * pads)[:, 0], 1e-3)
    np.testing.assert_array_equal(_error(one, points), 0.0)


def test_near_metal_draws_by_the_inverse_cube_of_its_distance():
    """1 mm at 50 mm: 8 mm at 25, 1/8 mm at 100, and no more than at 10 mm."""
    term = EmDistortion(gradient=0.0, pull=(0.0, 1e-3, 0.0), metal=(0.1, 0.0, 0.0))
    away = np.array([0.05, 0.025, 0.1, 0.01, 0.002])
    points = np.array([0.1, 0.0, 0.0]) + np.outer(away, [0.0, -0.6, 0.8])
    np.testing.assert_allclose(_error(term, points)[:, 1],
                               [1e-3, 8e-3, 0.125e-3, 0.125, 0.125], rtol=1e-9)
    np.testing.assert_array_equal(_error(term, points)[:, [0, 2]], 0.0)


def test_metal_on_a_pad_comes_closer_with_it():
    """From 60 to 50 mm by a push of 10: from 0.5787 to 1 mm; that of no pad stays."""
    pull = {'gradient': 0.0, 'pull': (1e-3, 0.0, 0.0), 'metal': (0.0, 0.0, 0.06)}
    pads = np.array([[0.0, 0.0, -0.01], [0.02, 0.0, 0.0]])
    for carrier, expected in ((0, 1.0), (-1, (5 / 6)**3)):
        error = _error(EmDistortion(**pull, carrier=carrier), [0.0, 0.0, 0.0], pads)
        np.testing.assert_allclose(error, [[1e-3 * expected, 0.0, 0.0]], rtol=1e-9)


def test_an_unknown_carrier_is_refused():
    with pytest.raises(ConfigError, match='carrier = 2; must be -1'):
        EmDistortion(carrier=2, pull=(1e-3, 0.0, 0.0)).distort(0.0, ('t',), np.zeros((1, 3)),
                                                               AT_REST)


def test_unknown_pad_is_refused():
    with pytest.raises(ConfigError, match='pad = 2; must be -1'):
        EmDistortion(pad=2).distort(0.0, ('t',), np.zeros((1, 3)), AT_REST)
