"""How numbers, names and lists are put: digits that an interval deserves, units, per cents."""

import math

import numpy as np

STREAMS = {'optical': ('optical markers', 'marker'), 'em': ('EM tracker', 'tool'),
           'force': ('pad forces', 'pad'), 'encoder': ('encoders', 'pad')}

ROUNDING = 1e-9     # of the largest component of a vector


def spoken(term):
    """A term's or a pair's registry name as it is spoken."""
    return term.replace('_', ' ')


def listed(items):
    """'a', 'a and b', 'a, b and c'."""
    items = list(items)
    return items[0] if len(items) == 1 else f'{", ".join(items[:-1])} and {items[-1]}'


def parameter(name, unit, value, low, high):
    """One fitted parameter: name, value, unit and 90 % interval, in edge units."""
    return f'{spoken(name)} {amount(unit, value, low, high)}, {bounds(unit, value, low, high)}'


def amount(unit, value, low, high):
    """A fitted value with its unit as printed, to the digits that its interval deserves."""
    return f'{_joined([p[0] for p in _parts(value, low, high)], value)}{_unit(unit)}'


def bounds(unit, value, low, high):
    """The 90 % interval of a fitted value, per axis for a vector."""
    if not np.isfinite([low, high]).any():
        return '90 % interval not known'
    return f'90 % interval {ends(value, low, high)}{_unit(unit)}'


def ends(value, low, high):
    """From where to where an interval goes, per axis for a vector, without its unit."""
    if not np.isfinite([low, high]).any():
        return 'not known'
    return _joined([f'{p[1]} to {p[2]}' for p in _parts(value, low, high)], value)


def _parts(value, low, high):
    """(value, low, high) as texts, per component; zero where it is that but for rounding."""
    parts = np.stack([np.atleast_1d(x) for x in (value, low, high)]).astype(float)
    parts[np.abs(parts) <= ROUNDING * np.abs(parts[0]).max()] = 0.0
    return [figures((v, a, b), b - a) for v, a, b in parts.T.tolist()]


def _joined(texts, value):
    return f'({", ".join(texts)})' if np.ndim(value) else texts[0]


def _unit(unit):
    return '' if unit == '1' else f' {unit}'


def figures(values, width=None):
    """Numbers with the decimals that `width` deserves (two digits of it), as texts.

    width : of an interval; None or 0 = the smallest of the numbers that is not zero
    """
    sizes = [abs(v) for v in values if v and math.isfinite(v)]
    scale = width or min(sizes, default=1.0)
    decimals = max(0, 1 - math.floor(math.log10(scale))) if math.isfinite(scale) else 2
    return tuple('unbounded' if math.isinf(v) else f'{v:z.{decimals}f}' for v in values)


def percent(chance):
    """A probability; what rounds to certainty is a bound."""
    if chance > 0.999:
        return 'above 99.9 %'
    if chance < 0.001:
        return 'below 0.1 %'
    return f'{100.0 * chance:.{1 if chance > 0.99 or chance < 0.01 else 0}f} %'


def share(chance):
    """A share of cases, small ones in powers of ten."""
    return percent(chance) if chance >= 1e-3 else f'less than {_power(chance)}'


def _power(chance):
    exponent = math.ceil(math.log10(max(chance, 1e-12)))
    return f'1 in {10 ** -exponent:,}'.replace(',', ' ')
