"""Force gain: a factor on the named pads, and what it cannot be told from."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.term import Stage
from arm_brachy.devices.force_sensor import ForceSensor, ForceSensorParams
from arm_brachy.devices.terms.force_gain import ForceGain
from arm_brachy.tissue.body import Pad, SoftBody
from arm_brachy.tissue.box import box_mesh
from arm_brachy.tissue.material import moduli
from arm_brachy.tissue.simulator import TissueSimulator
from arm_brachy.tissue.terms.stiffness_scale import StiffnessScale

PADS = ('pad_1', 'pad_2')
EXACT = replace(ForceSensorParams(), noise=0.0, moment_noise=0.0, resolution=0.0,
                moment_resolution=0.0)
FORCES = np.array([[1.0, -2.0, 0.5], [0.0, 4.0, -3.0]])
MOMENTS = np.array([[0.01, 0.0, -0.02], [0.0, 0.003, 0.0]])
REST = np.zeros((2, 3))


def _wrenches(forces, *terms, params=EXACT):
    """Forces (2, 3), moments (2, 3) and saturation of one sample under a constant load."""
    sensor = ForceSensor(params, PADS, terms, np.random.default_rng(2))
    samples = sensor.advance(0.0, forces, MOMENTS, 0.01, forces, MOMENTS, REST, REST)
    return (np.array([s.force for s in samples]), np.array([s.moment for s in samples]),
            [s.saturated for s in samples])


def test_the_named_pad_shows_more_in_every_direction_and_no_more_moment():
    forces, moments, _ = _wrenches(FORCES, ForceGain(gain=0.25, pads=('pad_2',)))
    np.testing.assert_allclose(forces / np.where(FORCES == 0.0, 1.0, FORCES),
                               [[1.0, 1.0, 1.0], [0.0, 1.25, 1.25]])
    np.testing.assert_array_equal(moments, MOMENTS)


def test_all_pads_alike_is_another_modulus():
    """Tissue (1 + g) times as stiff moves alike and returns what the gain would show."""
    soft, stiff = (_squeezed(terms) for terms in ((), (StiffnessScale(factor=1.08),)))
    np.testing.assert_allclose(stiff.x, soft.x, atol=1e-9)
    shown, _, _ = _wrenches(soft.pad_force, ForceGain(gain=0.08))
    np.testing.assert_allclose(shown, _wrenches(stiff.pad_force)[0], rtol=1e-5, atol=1e-7)
    assert np.abs(soft.pad_force).max() > 0.1


def _squeezed(terms):
    """A block held below between two pads that move in unequally."""
    mesh = box_mesh((0.03, 0.03, 0.03), (3, 3, 3))
    m, (mu, kappa) = len(mesh.tets), moduli(6e3, 0.45)
    pads = tuple(Pad(name, mesh.node_sets[side], np.array(push), np.array(centre), 0.01)
                 for name, side, push, centre in (
                     ('pad_1', 'x0', [1.0, 0.0, 0.0], [0.0, 0.015, 0.015]),
                     ('pad_2', 'x1', [-1.0, 0.0, 0.0], [0.03, 0.015, 0.015])))
    body = SoftBody(mesh, np.full(m, mu), np.full(m, kappa), np.full(m, 1e3),
                    mesh.node_sets['z0'], pads)
    return TissueSimulator(body, terms).step(1.0, [[0.002, 0.0, 0.0], [-0.001, 0.0, 0.0]])


def test_saturation_is_of_what_the_sensor_shows():
    almost = np.array([[0.9 * EXACT.range, 0.0, 0.0], [0.0, 0.0, 0.0]])
    forces, _, saturated = _wrenches(almost, ForceGain(gain=0.2))
    assert forces[0, 0] == EXACT.range
    assert saturated == [True, False]


def test_unknown_pad_is_refused():
    with pytest.raises(ConfigError, match='force_gain: pads = .*pad_9 must be among pad_1, pad_2'):
        _wrenches(FORCES, ForceGain(pads=('pad_9',)))


def test_acts_on_the_force_stream():
    assert ForceGain().stage is Stage.FORCE
