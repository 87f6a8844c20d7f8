"""One case of the trial: a body, a protocol, a set-up, and what is hidden in it."""
from dataclasses import dataclass, replace

import numpy as np

from arm_brachy.prove.generator.body import Body
from arm_brachy.prove.generator.catalogue import Effect, draw_effect
from arm_brachy.prove.generator.forms import in_some_form, same_values
from arm_brachy.prove.generator.nuisance import Nuisances, draw_nuisances
from arm_brachy.prove.generator.protocol import Protocol, draw_heldout, draw_protocol
from arm_brachy.prove.generator.sensors import Sensors, draw_sensors
from arm_brachy.prove.generator.strange import STRANGE, draw_strange
from arm_brachy.prove.generator.world import marker_names

TERMS = (
    'actuator_lag', 'actuator_gain', 'backlash', 'lost_steps', 'actuator_compliance',
    'marker_slip', 'optical_scale', 'em_distortion', 'em_offset', 'force_gain', 'force_drift',
    'clock_offset', 'stiffness_scale', 'compressibility', 'stiffness_gradient', 'skin_layer',
    'inclusion', 'strain_stiffening', 'anisotropy', 'gravity', 'reference_shape',
    'pad_misplacement', 'base_debond', 'base_compliance', 'external_force', 'obstacle',
    'swelling_drift', 'stiffness_drift', 'breathing', 'viscoelasticity', 'stress_softening',
    'axis_crosstalk',
)


@dataclass(frozen=True)
class Case:
    """All that decides a recording: same case, same bits."""

    body: Body
    protocol: Protocol
    heldout: Protocol
    nuisances: Nuisances
    sensors: Sensors
    effects: tuple
    noise_seed: int

    @property
    def without_effect(self):
        """Same body and set-up, nothing planted, fresh noise."""
        return replace(self, effects=(), noise_seed=self.noise_seed + 1)

    @property
    def again(self):
        """The same once more, fresh noise."""
        return replace(self, noise_seed=self.noise_seed + 2)


def draw(rng, kind, body, *, terms=TERMS):
    """Random `Case` on `body`.

    kind : 'null', 'single', 'pair', 'strange', or the name of one term or strange family;
    terms : those that singles and pairs are drawn from.
    Raises ValueError for another kind.
    """
    protocol, heldout = draw_protocol(rng, body), draw_heldout(rng, body)
    nuisances, sensors = draw_nuisances(rng, len(body.pads)), draw_sensors(rng)
    if kind in TERMS:
        names = [kind]
    elif kind in STRANGE or kind == 'strange':
        names = []
    else:
        counts = {'null': 0, 'single': 1, 'pair': 2}
        if kind not in counts:
            raise ValueError(f'kind {kind!r}; must be null, single, pair, strange or a name')
        names = [str(n) for n in rng.choice(terms, counts[kind], replace=False)]
    effects = tuple(in_some_form(rng, draw_effect(rng, name, body)) for name in names)
    if kind in STRANGE or kind == 'strange':
        name = kind if kind in STRANGE else str(rng.choice(sorted(STRANGE)))
        effects = (draw_strange(rng, name, body),)
    return Case(body, protocol, heldout, nuisances, sensors, effects,
                int(rng.integers(2**62)))


def truth_of(case):
    """What is hidden, as plain numbers, lists and dicts; SI but for values, which name units."""
    n = case.nuisances
    return {
        'labels': [e.name for e in case.effects],
        'effects': [describe(e, case.body) for e in case.effects],
        'in_catalogue': all(e.name in TERMS for e in case.effects),
        'solver': case.body.solver,
        'nuisances': {'modulus_factor': n.modulus, 'touch_m': n.touch.tolist(),
                      'optical_turn_rad': n.turn.tolist(), 'optical_slide_m': n.slide.tolist(),
                      'em_zero_m': n.em_zero.tolist(), 'force_zero_N': n.force_zero.tolist()},
        'sensors': {'noise': case.sensors.noise, 'clock_s': case.sensors.clock},
    }


def describe(effect: Effect, body):
    """Effect as a dict; the marker of marker_slip by its name, too.

    same : names of the values that mean what they mean in the registry
    """
    values = {k: list(v) if isinstance(v, tuple) else v for k, v in effect.values.items()}
    if 'marker' in values:
        values['marker_name'] = marker_names(body)[values['marker']]
    place = None if effect.place is None else np.array(effect.place).tolist()
    return {'name': effect.name, 'form': effect.form, 'same': list(same_values(effect)),
            'size': effect.size, 'values': values, 'place_m': place, 'onset_s': effect.onset}
