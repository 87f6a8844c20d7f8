"""Where, when and how much, beside what was planted: the columns of a row that are numbers."""

import numpy as np

from arm_brachy.core.quantity import quantities
from arm_brachy.experiments.diagnosis_score import (
    NEAR,
    PRODUCTS,
    SOON,
    TOLERANCE,
    departure,
    holds,
    onset_told,
)
from arm_brachy.registry import by_name

EMPTY = {'place_right': None, 'place_error_mm': None, 'onset_right': None, 'onset_error_s': None,
         'parameter_right': None, 'parameter_error_percent': None, 'interval_holds': None,
         'intervals': 0, 'intervals_held': 0, 'numbers': ()}
CHANNELS = ('actuators', 'pads', 'tools')     # values that are tuples of names
NAMES = ('pad', 'target', 'marker_name', 'stream')
STREAMS = {'forces': 'force'}               # our word for a stream of theirs
NOWHERE = ('optical_scale', 'em_distortion')    # their centre is no place of anything


def details(answer, effect, start, *, strange=False):
    """Columns of EMPTY for one planted effect; None where it has none or it was not found.

    effect : of the truth;  start : [s] that the bag is ahead of the truth
    strange : of no catalogue: any place and time that is told counts
    """
    cause = next((c for c in answer['causes'] if c['term'] == effect['name']), None)
    if cause is None and not strange:
        return dict(EMPTY)
    found = {**EMPTY, **_place(answer, effect, strange),
             **_onset(answer, cause, effect, start, strange)}
    return found if cause is None else {**found, **_parameters(cause, effect)}


def _place(answer, effect, strange):
    told = [p for p in answer['where'] if strange or p.get('term') == effect['name']]
    values = effect['values']
    centred = 'centre_mm' in values and effect['name'] not in NOWHERE
    if not (centred or _channel(values)):
        return {}
    named = {word for p in told for key in ('stream', 'channel', 'actuator', 'boundary')
             for word in str(p.get(key, '')).split()}
    right = _channel(values) in named if _channel(values) else False
    placed = [p for p in told if 'position_m' in p]
    if effect['place_m'] is None or not placed:
        return {'place_right': right}
    first = placed[0]
    away = float(np.linalg.norm(np.subtract(first['position_m'], effect['place_m'])))
    near = away <= (max(NEAR, first['radius_m'] or 0.0) if strange else NEAR)
    return {'place_right': right or near, **({'place_error_mm': 1e3 * away} if centred else {})}


def _channel(values):
    """Name of the pad, tool, marker or stream that an effect is in; None for the whole body."""
    for key in CHANNELS:
        if values.get(key):
            return values[key][0]
    name = next((values[key] for key in NAMES if key in values and isinstance(values[key], str)),
                None)
    return STREAMS.get(name, name)


def _onset(answer, cause, effect, start, strange):
    """Error of the onset; of something strange, whether any interval told holds it.

    None where another law was planted whose onset is not that of the registry's that fits it best.
    """
    if effect['onset_s'] is None or not strange and 'onset_s' not in comparable(effect):
        return {}
    true = effect['onset_s'] + start
    if cause is None:
        inside = [i for i in answer['when'] if _inside(i, true)]
        return {'onset_right': bool(inside)}
    told = onset_told(answer, cause)
    if told is None:
        return {'onset_right': False}
    error = told - true
    return {'onset_right': abs(error) <= SOON, 'onset_error_s': error}


def _inside(interval, t):
    ends = (interval['t_start_s'], interval['t_end_s'])
    return None not in ends and ends[0] - SOON <= t <= ends[1] + SOON


def _parameters(cause, effect):
    """Largest error relative to the departure from 'off', and how many intervals hold, and all.

    A strength that was planted and is not told counts as 'off', and as an interval that does not
    hold; a vector has one interval per component.  What means something else in the form that was
    planted is left out.
    """
    infos = quantities(by_name(effect['name']))
    keys = [(info, info.key(name)) for name, info in infos.items()
            if info.neutral is not None and info.key(name) in comparable(effect)
            and not _is_off(info, effect['values'][info.key(name)])]
    if not keys:
        return {}
    told = cause['parameters']
    held = [one for _, key in keys for one in _held(told.get(key), effect['values'][key])]
    counted = {'interval_holds': all(held) if held else None, 'intervals': len(held),
               'intervals_held': sum(held),
               'numbers': [_number(effect, key, told.get(key)) for _, key in keys]}
    if any(key not in told for _, key in keys):
        return {'parameter_error_percent': 100.0, 'parameter_right': False, **counted}
    errors = [departure(info, told[key]['value'], effect['values'][key]) for info, key in keys]
    if effect['name'] in PRODUCTS and set(comparable(effect)) == set(effect['values']):
        errors = [_product(effect, told, infos)]
    worst = float(max(errors))
    return {'parameter_error_percent': 100.0 * worst, 'parameter_right': worst <= TOLERANCE,
            **counted}


def comparable(effect):
    """Names of the values of a planted effect that mean what they mean in the registry."""
    return effect.get('same', effect['values'])


def _number(effect, key, told):
    """What was planted and what is told of one strength, as the answer writes it."""
    told = {} if told is None else told
    return {'parameter': f'{effect["name"]} {key}', 'planted': effect['values'][key],
            'told': told.get('value'), 'interval_90': told.get('interval_90')}


def _held(told, true):
    """Per component of a true value, whether the interval told holds it; none where its ends are
    told to be unknown.
    """
    parts = np.atleast_1d(np.asarray(true, dtype=float))
    if told is None:
        return [False] * len(parts)
    low, high = (np.atleast_1d(np.asarray(end, dtype=object)) for end in told['interval_90'])
    return [holds(ends, part) for *ends, part in zip(low, high, parts, strict=True)
            if ends != [None, None]]


def _is_off(info, value):
    return bool(np.all(np.asarray(value, dtype=float) == info.neutral))


def _product(effect, told, infos):
    """Error of what of two parameters is known together only."""
    def fields(values):
        return {name: info.to_si(values[info.key(name)]) for name, info in infos.items()
                if not info.shape and info.key(name) in values}

    product = PRODUCTS[effect['name']]
    true = fields(effect['values'])
    found = {**true, **fields({key: one['value'] for key, one in told.items()})}
    return abs(product(found) / product(true) - 1.0)
