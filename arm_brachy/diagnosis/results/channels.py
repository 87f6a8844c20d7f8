"""Where, when and how a term acts, in words: pads by their names, places in mm.

Test: diagnosis/test_channels.py
"""

import numpy as np

from arm_brachy.core.quantity import UNITS, quantities
from arm_brachy.diagnosis.results.formatting import STREAMS, listed, spoken

# Fields of terms that say what carries the effect.
CARRIERS = ('actuators', 'pads', 'pad', 'carrier', 'marker', 'markers', 'tools', 'stream')


def channel(key, value, pads):
    """What carries an effect: 'pad east', 'all actuators', 'marker m1'.

    key, value : a field of a term, of CARRIERS, and what it holds: names, or numbers of pads
    pads : names, in the order of the numbers
    """
    if key == 'stream':
        return STREAMS[value][0]
    one = 'pad' if key == 'carrier' else key.removesuffix('s')
    names = [value] if isinstance(value, str) else [
        n if isinstance(n, str) else pads[n] for n in np.atleast_1d(value).tolist() if n != -1]
    if not names and one in ('actuator', 'pad') and len(pads) == 1:
        names = list(pads)
    if not names:
        return f'all {one}s'
    return f'{one if len(names) == 1 else one + "s"} {listed(names)}'


def whereabouts(cls, place, pads):
    """Where a term acts, when and how, in edge units; '' if it has no such choice.

    cls : term class;  place : field -> SI value;  pads : as of `channel`
    """
    infos = quantities(cls)
    return ', '.join(channel(key, value, pads) if key in CARRIERS
                     else _measured(key, value, infos[key]) for key, value in place.items())


def _measured(name, value, info):
    """A quantity with its name and unit: 'centre (23.0, 43.0, 21.0) mm', 'onset 3.2 s'."""
    unit = UNITS[info.unit][1]
    digits = '.1f' if unit == 'mm' else '.4g'
    parts = [f'{v:z{digits}}' for v in np.atleast_1d(info.to_edge(value)).tolist()]
    text = f'({", ".join(parts)})' if info.shape else parts[0]
    return f'{spoken(name)} {text}{"" if unit == "1" else f" {unit}"}'
