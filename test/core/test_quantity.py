"""Units, ranges and conversions of declared parameters."""

import dataclasses
import math

import pytest

from arm_brachy.core.quantity import UNITS, Quantity, quantities, quantity

# Factors to SI, by definition of the units (BIPM, SI Brochure, 9th ed.), written out anew.
DEFINITIONS = {
    'mm': (1, 'm', 1000), 'um': (1, 'm', 10**6), 'ms': (1, 's', 1000), 'kPa': (1000, 'Pa', 1),
    'g': (1, 'kg', 1000), 'Nmm': (1, 'N m', 1000), 'N_mm': (1000, 'N/m', 1),
    'mm_N': (1, 'm/N', 1000), 'N_min': (1, 'N/s', 60),
    'kPa_mm': (10**6, 'Pa/m', 1), 'mm2': (1, 'm^2', 10**6), 'per_mm2': (10**6, '1/m^2', 1),
    'mm_s': (1, 'm/s', 1000), 'mm_s2': (1, 'm/s^2', 1000),
}


@pytest.mark.parametrize('unit', DEFINITIONS)
def test_units_follow_their_definition(unit):
    numerator, _, denominator = DEFINITIONS[unit]
    assert Quantity(unit, 'x').to_si(denominator) == pytest.approx(numerator, rel=1e-15)


def test_a_half_turn_is_pi():
    assert Quantity('deg', 'angle').to_si(180) == pytest.approx(math.pi, rel=1e-15)


@pytest.mark.parametrize('unit', UNITS)
@pytest.mark.parametrize('value', [0.0, 1.0, -3.0, 0.1, 1 / 3, 123456.789, 1e-9, 62.106])
def test_a_value_as_written_comes_back(unit, value):
    info = Quantity(unit, 'x')
    assert info.to_edge(info.to_si(value)) == pytest.approx(value, rel=1e-11, abs=0)
    assert info.to_edge(info.to_si(info.to_edge(info.to_si(value)))) \
        == info.to_edge(info.to_si(value))


@pytest.mark.parametrize('unit', UNITS)
def test_twelve_digits_survive_to_the_bit(unit):
    info = Quantity(unit, 'x')
    value = 0.123456789012
    assert info.to_si(info.to_edge(info.to_si(value))) == info.to_si(value)


def test_a_dump_reads_as_it_was_written():
    """0.3 mm is 0.00029999... m in binary; a file shall say 0.3 again."""
    info = Quantity('mm', 'width')
    assert str(info.to_edge(info.to_si(0.3))) == '0.3'


def test_vectors_convert_entry_by_entry():
    info = Quantity('mm', 'place', shape=(3,))
    assert info.to_si([1, 2.5, -3]) == (0.001, 0.0025, -0.003)
    assert info.to_edge((0.001, 0.0025, -0.003)) == [1.0, 2.5, -3.0]


@pytest.mark.parametrize('shape', [(), (3,)])
def test_what_is_absent_stays_absent(shape):
    info = Quantity('mm', 'place', shape=shape)
    assert info.to_si(None) is None and info.to_edge(None) is None


@pytest.mark.parametrize('low,high,shape,unit,text', [
    (0.5, 200.0, (), 'mm', '0.5 to 200 mm'),
    (0.0, None, (), 'mm_s', 'at least 0 mm/s'),
    (None, 1.0, (), '', 'at most 1'),
    (None, None, (), 's', 'a finite number in s'),
    (None, None, (), '', 'a finite number'),
    (None, None, (3,), 'mm', '3 finite numbers in mm'),
])
def test_the_range_in_words(low, high, shape, unit, text):
    assert Quantity(unit, 'x', low, high, shape).allowed() == text


def test_bounds_belong_to_the_range_and_nan_does_not():
    info = Quantity('mm', 'x', 0.0, 2.0)
    assert info.allows(0.0) and info.allows(2.0)
    assert not info.allows(2.1) and not info.allows(-1e-9) and not info.allows(math.nan)


@pytest.mark.parametrize('declare,match', [
    (lambda: quantity(1.0, 'inch', 'length'), "unit 'inch'.*must be one of.*mm"),
    (lambda: quantity(5.0, 'mm', 'length', low=0.0, high=1.0), 'default 5.0.*0 to 1 mm'),
    (lambda: quantity(1.0, 'mm', 'length', low=2.0, high=1.0), 'must increase'),
    (lambda: quantity(1.0, 'mm', 'place', shape=(3,)), 'must be 3 finite numbers'),
    (lambda: quantity([1.0, 2.0], 'mm', 'place', shape=(3,)), 'must be 3 finite numbers'),
    (lambda: quantity(math.nan, 'mm', 'length', low=0.0), 'default nan'),
    (lambda: quantity(1.0, 'mm', 'length', prior=('half_normal', 1.0)), 'prior of .*lognormal'),
    (lambda: quantity(1.0, 'mm', 'length', prior=('lognormal', 1.0, 0.5)), 'factor above 1'),
])
def test_a_wrong_declaration_shows_itself_on_import(declare, match):
    with pytest.raises(ValueError, match=match):
        declare()


def test_a_declared_field_holds_si_and_is_named_with_its_unit_outside():
    @dataclasses.dataclass(frozen=True)
    class Pad:
        name: str
        stroke: float = quantity(30.0, 'mm', 'largest push')
        place: tuple = quantity(..., 'mm', 'where', shape=(3,))

    assert Pad('a').stroke == 0.03 and Pad('a').place is None
    assert {n: q.key(n) for n, q in quantities(Pad).items()} \
        == {'stroke': 'stroke_mm', 'place': 'place_mm'}
    with pytest.raises(dataclasses.FrozenInstanceError):
        Pad('a').stroke = 0.0
