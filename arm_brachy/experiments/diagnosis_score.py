"""What one answer of the diagnosis is worth, beside what was planted.

- right: the verdict names what was planted and nothing else. class: it says 'equivalent', and one
  option is what was planted and every other is known not to differ from it (CONFOUNDED). wide: an
  option is what was planted, but there are others that theory could tell from it.
- wrong: a claim of something that is not there, also beside what is. abstained: 'unexplained'
  without a wrong cause. silent: nothing is missing. failed: no answer.
- A modulus is no cause but recalibrated: for stiffness_scale, silence with the modulus within
  TOLERANCE of its departure is right. Damping does nothing to a quasi-static body, a lag before
  the encoders nothing to a model that they drive: silence is right.
- A mesh at fault (discretisation) is no wrong claim: model and patient have different meshes.
"""

import numpy as np

from arm_brachy.core.quantity import quantities
from arm_brachy.core.scene import load_scene
from arm_brachy.experiments.diagnosis_plan import SCENE
from arm_brachy.registry import by_name

MESH = 'discretisation'
INERT = ('damping', 'actuator_lag', 'point_mass')     # see the head
RECALIBRATED = 'stiffness_scale'
TOLERANCE = 0.2                 # of a parameter, and of the held-out error over an oracle's
NEAR, SOON = 10e-3, 0.5         # m, s: a right place (half a pad) and a right onset
FOUND = ('right', 'class')
# Causes that some recordings cannot tell apart: MISMATCH theorems and `invisible_when`.
CONFOUNDED = tuple(frozenset(pair) for pair in (
    ('actuator_gain', 'actuator_compliance'), ('actuator_lag', 'clock_offset'),      # T8
    ('reference_shape', 'optical_scale'), ('swelling_drift', 'optical_scale'),       # T9
    ('reference_shape', 'gravity'), ('force_gain', 'stiffness_scale'),               # T10, T4
    ('inclusion', 'external_force'), ('inclusion', 'obstacle'),                      # T6
    ('stiffness_gradient', 'force_gain'), ('stiffness_gradient', 'anisotropy'),
    ('actuator_gain', 'lost_steps'), ('marker_slip', 'lost_steps'),
    ('stress_softening', 'strain_stiffening'), ('force_drift', 'stiffness_drift')))
# What of two parameters is known together only (T7 and `invisible_when`), from fields in SI.
PRODUCTS = {
    'inclusion': lambda f: f['radius'] ** 3 * (f['ratio'] - 1.0) / (3.0 + 2.0 * f['ratio']),
    'skin_layer': lambda f: (f['ratio'] - 1.0) * f['thickness'],
}


def explanations(answer):
    """Sets of causes of which an answer says that one holds; the mesh is left out.

    answer : diagnosis.Diagnosis as JSON. No cause at all is one empty set.
    """
    options = {}
    for cause in answer['causes']:
        options.setdefault(cause['option'], set()).add(cause['term'])
    always = options.pop(0, set())
    return [frozenset((always | one) - {MESH}) for one in options.values()] or [
        frozenset(always - {MESH})]


def outcome(answer, label):
    """What an answer is worth, in one of the words of the head of this file.

    label : of the case (`diagnosis_cases.labels`)
    """
    if 'error' in answer:
        return 'failed'
    planted = set() if label['term'] in (None, *INERT) else {label['term']}
    said = explanations(answer)
    if answer['verdict'] == 'unexplained':
        return 'abstained' if all(one <= planted for one in said) else 'wrong'
    if not any(said):
        return 'right' if planted == {RECALIBRATED} and _modulus(answer, label).get(
            'parameter_right') else 'silent'
    if planted not in said:
        return 'wrong'
    others = [one for one in said if one != planted]
    if not others:
        return 'right'
    alike = all(len(one) == 1 and one | planted in CONFOUNDED for one in others)
    return 'class' if alike else 'wide'


def _modulus(answer, label):
    """Parameter columns from the recalibrated modulus; {} if there is none."""
    told = answer['recalibrated'].get('E_kPa')
    if told is None:
        return {}
    given = load_scene(SCENE).material.E / 1e3
    true = given * label['fields']['factor']
    return _worth(abs(told['value'] - true) / abs(true - given),
                  holds(told['interval_90'], np.array([true])))


def _worth(error, held):
    return {'parameter_error_percent': 100.0 * float(error),
            'parameter_right': bool(error <= TOLERANCE), 'interval_holds': held}


def score(label, line):
    """One row of the table, flat, from a label and a line of answers.jsonl; None = not said."""
    answer = line['answer']
    row = {'case': label['name'], 'term': label['term'] or '-', 'size': label['size'],
           'outcome': outcome(answer, label), 'verdict': answer.get('verdict', 'none'),
           'said': _said(answer), 'place_right': None, 'place_error_mm': None,
           'onset_right': None, 'onset_error_s': None, 'parameter_right': None,
           'parameter_error_percent': None, 'interval_holds': None,
           'error_over_floor': _over_floor(answer), 'cpu_s': line['cpu_s'],
           'plant': label['plant']}
    cause = _cause(answer, label['term'])
    if cause is not None:
        return row | _place(answer, label) | _onset(answer, cause, label) | _parameter(
            cause, label)
    recalibrated = row['outcome'] == 'right' and label['term'] == RECALIBRATED
    return row | _modulus(answer, label) if recalibrated else row


def _said(answer):
    if 'error' in answer:
        return answer['error']
    return ' | '.join(' + '.join(sorted(one)) for one in explanations(answer) if one)


def _cause(answer, term):
    return next((c for c in answer.get('causes', ()) if c['term'] == term), None)


def _over_floor(answer):
    """Largest of the streams' held-out errors over their noise floors."""
    ratios = []
    for fit in answer.get('fit', ()):
        reached = fit['with_the_causes']
        reached = fit['recalibrated'] if reached is None else reached
        if reached is not None and fit['noise_floor']:
            ratios.append(reached / fit['noise_floor'])
    return max(ratios, default=None)


def _place(answer, label):
    """Whether the pad, actuator, marker, stream or centre is the one planted; first place said."""
    where = next((p for p in answer['where'] if p.get('term') == label['term']), {})
    wanted = _channel(label['place'])
    if 'centre' in label['place']:
        if 'position_m' not in where:
            return {'place_right': False}
        away = float(np.linalg.norm(np.subtract(where['position_m'], label['place']['centre'])))
        return {'place_right': away <= NEAR, 'place_error_mm': 1e3 * away}
    if wanted is None:
        return {}
    told = ' '.join(where.get(key, '') for key in ('stream', 'channel', 'actuator', 'boundary'))
    return {'place_right': wanted in told.split()}


def _channel(place):
    """Name of what a planted term is in, None where it is in the whole body or stream."""
    if 'actuators' in place:
        return load_scene(SCENE).pads[place['actuators'][0]].name
    if 'pads' in place:
        return place['pads'][0]
    return place.get('marker') or place.get('stream')


def _parameter(cause, label):
    """Error relative to the departure from 'off', and whether every interval holds the truth."""
    infos = quantities(by_name(label['term']))
    true = {name: _edge(infos[name], value) for name, value in label['parameters'].items()}
    told = {name: cause['parameters'].get(infos[name].key(name)) for name in true}
    if None in told.values():
        return {'parameter_right': False, 'interval_holds': False}
    held = all_hold({name: one['interval_90'] for name, one in told.items()}, true)
    if label['term'] in PRODUCTS:
        product = PRODUCTS[label['term']]
        found = product({**label['fields'], **_scalars(cause, infos)})
        return _worth(abs(found / product(label['fields']) - 1.0), held)
    return _worth(max(departure(infos[name], told[name]['value'], true[name])
                      for name in true), held)


def _edge(info, value):
    return np.atleast_1d(np.asarray(value, dtype=float) / info.scale)


def _scalars(cause, infos):
    """Fields of a cause's scalar parameters, SI."""
    keys = {info.key(name): name for name, info in infos.items() if not info.shape}
    return {keys[key]: infos[keys[key]].to_si(one['value'])
            for key, one in cause['parameters'].items() if key in keys}


def departure(info, found, true):
    """Error over the departure from the value that switches a term off (0 if that is infinite).

    info : core.quantity;  found, true : numbers or sequences, in one unit
    """
    off = info.neutral if info.neutral is not None and np.isfinite(info.neutral) else 0.0
    found, true = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (found, true))
    return float(np.linalg.norm(found - true) / np.linalg.norm(true - off))


def holds(interval, true):
    """True if true, a number or (c,), lies in [low, high]; an end that is null is open."""
    low, high = (np.array([fill if v is None else v for v in np.atleast_1d(
        np.asarray(end, dtype=object))], dtype=float)
        for end, fill in zip(interval, (-np.inf, np.inf), strict=True))
    true = np.atleast_1d(np.asarray(true, dtype=float))
    return bool(np.all((low <= true) & (true <= high)))


def all_hold(told, true):
    """True if all intervals told, name -> of `holds`, hold the true values, name -> value; None if
    none of them is known.

    A parameter of `true` that was not told is not held.
    """
    known = [name for name in true if name not in told or not _unknown(told[name])]
    return all(name in told and holds(told[name], true[name]) for name in known) if known else None


def _unknown(interval):
    return all(end is None for part in interval for end in np.atleast_1d(
        np.asarray(part, dtype=object)))


def onset_told(answer, cause):
    """Onset [s] that an answer tells of a cause, middle of its interval or parameter; or None."""
    told = [np.mean(i['onset_s']) for i in answer['when']
            if i.get('term') == cause['term'] and None not in i.get('onset_s', (None,))]
    if not told and 'onset_s' in cause['parameters']:
        told = [cause['parameters']['onset_s']['value']]
    return float(told[0]) if told else None


def _onset(answer, cause, label):
    """Middle of the onset's interval minus the onset, from `when` or from the parameter."""
    if 'onset' not in label['place']:
        return {}
    told = onset_told(answer, cause)
    if told is None:
        return {'onset_right': False}
    error = told - label['place']['onset']
    return {'onset_right': abs(error) <= SOON, 'onset_error_s': error}
