"""A physical parameter, declared once: default, unit, range, prior, meaning, source.

A dataclass field made by `quantity` holds an SI value and has no suffix in Python. At the edges
(YAML, ROS parameters, tables) it appears as `<name>_<unit>` in that unit. Configuration files,
the term registry, ROS parameter descriptions and the documentation tables all read this one
declaration.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

# edge unit -> (factor to SI, how it is printed). The key is also the suffix of the YAML key.
UNITS = {
    '': (1.0, '1'),
    'm': (1.0, 'm'),
    'mm': (1e-3, 'mm'),
    'um': (1e-6, 'um'),
    'mm_s': (1e-3, 'mm/s'),
    'mm_s2': (1e-3, 'mm/s^2'),
    'm_s2': (1.0, 'm/s^2'),
    's': (1.0, 's'),
    'ms': (1e-3, 'ms'),
    'Hz': (1.0, 'Hz'),
    'deg': (np.pi / 180.0, 'deg'),
    'Pa': (1.0, 'Pa'),
    'kPa': (1e3, 'kPa'),
    'kPa_mm': (1e6, 'kPa/mm'),
    'N': (1.0, 'N'),
    'N_mm': (1e3, 'N/mm'),
    'Nm': (1.0, 'N m'),
    'Nmm': (1e-3, 'N mm'),
    'kg': (1.0, 'kg'),
    'g': (1e-3, 'g'),
    'kg_m3': (1.0, 'kg/m^3'),
    'per_s': (1.0, '1/s'),
    'per_m': (1.0, '1/m'),
    'mm_per_mm': (1.0, 'mm/mm'),
    'mm2': (1e-6, 'mm^2'),
    'per_mm2': (1e6, '1/mm^2'),
}


@dataclass(frozen=True)
class Quantity:
    """What is known about one parameter besides its value.

    unit : key of UNITS, the unit used at the edges
    text : one line saying what it is
    low, high : allowed range, inclusive, in the edge unit; None = unbounded
    shape : () for a scalar, (3,) for a vector in the world frame
    prior : (kind, a, b) for the fitter, edge unit: ('uniform', low, high),
        ('normal', mean, sd) or ('lognormal', median, factor at one sd); None = not fitted
    typical : size at which the effect is usually met (edge unit); None = the default
    source : where default and range come from
    """

    unit: str
    text: str
    low: float | None = None
    high: float | None = None
    shape: tuple = ()
    prior: tuple | None = None
    typical: float | None = None
    source: str = ''

    @property
    def scale(self):
        """Factor from the edge unit to SI."""
        return UNITS[self.unit][0]

    def key(self, name):
        """Name at the edges, with its unit: `stroke` -> `stroke_mm`."""
        return f'{name}_{self.unit}' if self.unit else name

    def to_si(self, value):
        """Edge unit to SI; a vector becomes a tuple of floats."""
        if self.shape:
            return tuple(float(v) * self.scale for v in value)
        return None if value is None else float(value) * self.scale

    def to_edge(self, value):
        """SI to edge unit, rounded to 12 digits so that a dump reads as it was written."""
        if self.shape:
            return [float(f'{v / self.scale:.12g}') for v in value]
        return None if value is None else float(f'{value / self.scale:.12g}')


def quantity(default, unit, text, *, low=None, high=None, shape=(), prior=None, typical=None,
             source=''):
    """Declare a physical parameter as a dataclass field.

    default : in the edge unit (as a person would write it); stored in SI. None = must be given,
        `...` = optional and absent (stored as None)
    unit, text, low, high, shape, prior, typical, source : see Quantity
    """
    info = Quantity(unit, text, low, high, shape, prior, typical, source)
    meta = {'quantity': info}
    if default is None:
        return dataclasses.field(metadata=meta)
    if default is ...:
        return dataclasses.field(default=None, metadata=meta)
    return dataclasses.field(default=info.to_si(default), metadata=meta)


def quantities(cls):
    """Map field name -> Quantity for the fields of dataclass `cls` declared with `quantity`."""
    return {f.name: f.metadata['quantity'] for f in dataclasses.fields(cls)
            if 'quantity' in f.metadata}
