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
    'mm_Ns': (1e-3, 'mm/(N s)'),
    'm_s2': (1.0, 'm/s^2'),
    's': (1.0, 's'),
    'ms': (1e-3, 'ms'),
    'Hz': (1.0, 'Hz'),
    'deg': (np.pi / 180.0, 'deg'),
    'deg_s': (np.pi / 180.0, 'deg/s'),
    'deg_s2': (np.pi / 180.0, 'deg/s^2'),
    'Pa': (1.0, 'Pa'),
    'kPa': (1e3, 'kPa'),
    'kPa_mm': (1e6, 'kPa/mm'),
    'mm_kPa': (1e-6, 'mm/kPa'),
    'N': (1.0, 'N'),
    'N_mm': (1e3, 'N/mm'),
    'N_m': (1.0, 'N/m'),
    'Ns_m': (1.0, 'N s/m'),
    'N_m2': (1.0, 'N/m^2'),
    'Ns_m2': (1.0, 'N s/m^2'),
    'Nm_rad': (1.0, 'N m/rad'),
    'Nms_rad': (1.0, 'N m s/rad'),
    'mm_N': (1e-3, 'mm/N'),
    'N_min': (1.0 / 60.0, 'N/min'),
    'Nm': (1.0, 'N m'),
    'Nmm': (1e-3, 'N mm'),
    'Nm2': (1.0, 'N m^2'),
    'kg': (1.0, 'kg'),
    'g': (1e-3, 'g'),
    'kg_m3': (1.0, 'kg/m^3'),
    'N_m3': (1.0, 'N/m^3'),
    'per_s': (1.0, '1/s'),
    'per_min': (1.0 / 60.0, '1/min'),
    'per_m': (1.0, '1/m'),
    'mm_per_mm': (1.0, 'mm/mm'),
    'mm2': (1e-6, 'mm^2'),
    'per_mm3': (1e9, '1/mm^3'),
    'm_s': (1.0, 'm/s'),
    'dB': (1.0, 'dB'),
    'per_mm2': (1e6, '1/mm^2'),
}


def _is_prior(kind=None, a=None, b=None, *more):
    """True for what `Quantity.prior` may be."""
    if more or None in (a, b):
        return False
    return {'uniform': a < b, 'normal': b > 0.0, 'lognormal': a > 0.0 and b > 1.0}.get(kind, False)


@dataclass(frozen=True)
class Quantity:
    """What is known about one parameter besides its value.

    unit : key of UNITS, the unit used at the edges
    text : one line saying what it is
    low, high : allowed range, inclusive, in the edge unit; None = unbounded
    shape : () for a scalar, (3,) for a vector in the world frame
    prior : (kind, a, b) for the fitter, edge unit: ('uniform', low, high),
        ('normal', mean, sd) or ('lognormal', median, factor at one sd); None = not fitted
    typical : size at which the effect is usually met (edge unit; the length of a vector); None =
        the default
    neutral : value (edge unit) at which the effect is switched off by this parameter, each
        component of a vector alike; infinity = rigid in the limit; None = it does not scale the
        effect, but says where, when or how
    source : where default and range come from

    Raises ValueError for a unit that is not in UNITS, a range turned round and a prior of another
    form: a declaration is code, so a wrong one is a bug and shows itself on import.
    """

    unit: str
    text: str
    low: float | None = None
    high: float | None = None
    shape: tuple = ()
    prior: tuple | None = None
    typical: float | None = None
    source: str = ''
    neutral: float | None = None

    def __post_init__(self):
        if self.unit not in UNITS:
            raise ValueError(f'unit {self.unit!r} of {self.text!r}; must be one of '
                             f'{", ".join(u or repr(u) for u in UNITS)}')
        if None not in (self.low, self.high) and not self.low <= self.high:
            raise ValueError(f'range of {self.text!r}: {self.low} to {self.high}; must increase')
        if self.prior is not None and not _is_prior(*self.prior):
            raise ValueError(
                f'prior of {self.text!r}: {self.prior}; must be (uniform, low, high), (normal, '
                'mean, sd) or (lognormal, median, factor above 1)')

    @property
    def scale(self):
        """Factor from the edge unit to SI."""
        return UNITS[self.unit][0]

    def key(self, name):
        """Name at the edges, with its unit: `stroke` -> `stroke_mm`."""
        return f'{name}_{self.unit}' if self.unit else name

    def allows(self, value):
        """True if a number in the edge unit lies in the range (NaN never does)."""
        low = -np.inf if self.low is None else self.low
        high = np.inf if self.high is None else self.high
        return bool(low <= value <= high)

    def allowed(self):
        """What a message says after 'must be': '0.5 to 200 mm', '3 finite numbers in mm'."""
        unit = f' {UNITS[self.unit][1]}' if self.unit else ''
        if self.shape:
            return f'{self.shape[0]} finite numbers' + (f' in{unit}' if unit else '')
        if self.low is not None and self.high is not None:
            return f'{self.low:.12g} to {self.high:.12g}{unit}'
        if self.low is not None:
            return f'at least {self.low:.12g}{unit}'
        if self.high is not None:
            return f'at most {self.high:.12g}{unit}'
        return 'a finite number' + (f' in{unit}' if unit else '')

    def to_si(self, value):
        """Edge unit to SI; a vector becomes a tuple of floats, None stays None."""
        if value is None:
            return None
        if self.shape:
            return tuple(float(v) * self.scale for v in value)
        return float(value) * self.scale

    def to_edge(self, value):
        """SI to edge unit, rounded to 12 digits so that a dump reads as it was written."""
        if value is None:
            return None
        if self.shape:
            return [float(f'{v / self.scale:.12g}') for v in value]
        return float(f'{value / self.scale:.12g}')


def quantity(default, unit, text, *, low=None, high=None, shape=(), prior=None, typical=None,
             source='', neutral=None):
    """Declare a physical parameter as a dataclass field.

    default : in the edge unit (as a person would write it); stored in SI. None = must be given,
        `...` = optional and absent (stored as None)
    unit, text, low, high, shape, prior, typical, source, neutral : see Quantity
    Raises ValueError as Quantity does, and for a default outside its own range.
    """
    info = Quantity(unit, text, low, high, shape, prior, typical, source, neutral)
    meta = {'quantity': info}
    if default is None:
        return dataclasses.field(metadata=meta)
    if default is ...:
        return dataclasses.field(default=None, metadata=meta)
    if not np.all([info.allows(v) for v in np.ravel(default)]) or np.shape(default) != shape:
        raise ValueError(f'default {default!r} of {text!r}; must be {info.allowed()}')
    return dataclasses.field(default=info.to_si(default), metadata=meta)


@dataclass(frozen=True)
class Whole:
    """Allowed range of a whole number, inclusive; high None = unbounded."""

    low: int
    high: int | None = None

    def allowed(self):
        """What a message says after 'must be': 'a whole number, 2 to 1000'."""
        return f'a whole number, {self.span()}'

    def span(self):
        """The range alone: '2 to 1000', 'at least 2'."""
        return f'at least {self.low}' if self.high is None else f'{self.low} to {self.high}'


def whole(default, text, *, low, high=None):
    """Declare a whole number with a range as a dataclass field.

    Raises ValueError for a default outside its own range.
    """
    info = Whole(low, high)
    if default < low or (high is not None and default > high):
        raise ValueError(f'default {default!r} of {text!r}; must be {info.allowed()}')
    return dataclasses.field(default=default, metadata={'text': text, 'whole': info})


def word(text, **given):
    """Declare a dataclass field that is no quantity, with one line saying what it is.

    given : `default` or `default_factory`; nothing = must be given
    """
    return dataclasses.field(metadata={'text': text}, **given)


def wholes(cls):
    """Map field name -> Whole for the fields of dataclass `cls` declared with `whole`."""
    return {f.name: f.metadata['whole'] for f in dataclasses.fields(cls)
            if 'whole' in f.metadata}


def quantities(cls):
    """Map field name -> Quantity for the fields of dataclass `cls` declared with `quantity`."""
    return {f.name: f.metadata['quantity'] for f in dataclasses.fields(cls)
            if 'quantity' in f.metadata}
