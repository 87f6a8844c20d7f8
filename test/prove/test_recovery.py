"""Test of prove/recovery.py with a model that needs no solver: pads move points in proportion."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_up_answers import answer, cause, effect, truth

from arm_brachy.devices.terms.actuator_gain import ActuatorGain
from arm_brachy.prove import bridge, recovery

GAIN, TOUCH, STIFF = 0.1, 2e-4, 1.1     # planted, and of the set-up
NOISE = {'forces': 0.01, 'optical': 5e-5, 'em': 2e-4}
TRUTH = {**truth(effect('actuator_gain', {'gain': GAIN, 'offset_mm': 0.0, 'actuators': ['b']})),
         'duration_s': 60.0, 'sensors': {'noise': NOISE},
         'nuisances': {'modulus_factor': STIFF, 'touch_m': [TOUCH, 0.0]}}


def shown(q, modulus, terms):
    """Positions and forces of two pads at travels q (n, 2) under actuator gains."""
    q = q.copy()
    for term in terms:
        q[:, list(term.actuators)] *= 1.0 + term.gain
    moved = q[:, :, None] * np.ones(3)
    return {'optical': moved, 'em': 0.5 * moved[:, :1], 'force': modulus / 50.0 * moved}


class Linear:
    """Stands for forward.ForwardModel."""

    def __init__(self, scene, terms):
        self.modulus, self.terms = scene.material.E, terms

    def predict(self, encoder, t):
        found = shown(encoder.at(t), self.modulus, self.terms)
        return SimpleNamespace(valid=np.ones(len(t), bool), get=found.get)


@pytest.fixture
def case(tmp_path, monkeypatch):
    """Folder with the scene, and file with clean signals of a push of both pads."""
    monkeypatch.setattr(recovery, 'ForwardModel', Linear)
    monkeypatch.setattr(recovery, 'specimen_of', lambda scene: scene)
    pads = [{'name': name, 'centre_m': [0, 0, 0], 'direction': [1, 0, 0], 'radius_m': 0.01,
             'stroke_m': 0.005} for name in 'ab']
    body = {'E_Pa': 6e3, 'nu': 0.49, 'density_kg_m3': 1e3, 'gravity_m_s2': [0, 0, 0],
            'pads': pads, 'markers_m': {}, 'targets_m': {}}
    bridge.write_scene(body, 'mesh.msh', tmp_path / 'scene.yaml')
    t = np.linspace(0.0, 10.0, 200)
    u = 4e-3 * np.column_stack([np.sin(t) ** 2, np.cos(t) ** 2])
    true = shown(u - [TOUCH, 0.0], 6e3 * STIFF, (ActuatorGain(gain=GAIN, actuators=(1,)),))
    signals = {'encoders': u, 'forces': true['force'], 'optical': true['optical'],
               'em': true['em']}
    np.savez(tmp_path / 'heldout.npz', **{f'{k}/t_s': t for k in signals},
             **{f'{k}/values': v for k, v in signals.items()})
    return tmp_path


def recovered(case, gain):
    causes = [cause('actuator_gain', parameters={'gain': {'value': gain}})] if gain else []
    for one in causes:
        one['applies_to'] = {'actuators': [1]}
    given = answer('named' if gain else 'nothing_missing', *causes,
                   recalibrated={'E_kPa': {'value': 6.0 * STIFF}})
    return recovery.recover(case, case / 'heldout.npz', TRUTH, given)


@pytest.mark.parametrize(('gain', 'share'), [(GAIN, 1.0), (0.0, 0.0), (0.5 * GAIN, 0.5)])
def test_what_is_recovered_is_the_share_of_the_error_that_goes_away(case, gain, share):
    # the oracle is exact but for the interpolation between samples, some 1e-3 of the travel
    assert recovered(case, gain)['recovery'] == pytest.approx(share, abs=0.03)


def test_a_wrong_term_makes_it_worse(case):
    assert recovered(case, -GAIN)['recovery'] < -0.8


def test_sensors_and_the_mesh_are_no_part_of_a_model():
    given = answer('named', cause('discretisation'), cause('optical_scale'))
    assert recovery.said_terms(given) == ()


def test_of_several_options_the_likeliest_counts():
    gains = [cause('actuator_gain', option, chance, {'gain': {'value': gain}})
             for option, chance, gain in ((1, 0.3, 0.01), (2, 0.7, 0.02))]
    found = recovery.said_terms(answer('equivalent', *gains))
    assert [term.gain for term in found] == [0.02]
