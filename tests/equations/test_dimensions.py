"""Units become factors and dimensions, and values SI numbers; what is wrong with them is said."""

from __future__ import annotations

import math
import re
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oed.equations.dimensions import (
    ANGLE,
    BASE,
    PLAIN,
    Dimension,
    expect_quantity,
    parse_unit,
    quantity,
)


def of(text: str) -> Dimension:
    return parse_unit(text)[1]


def test_unit():
    for unit, factor, text in (
        ("mol/l", 1e3, "mol/m^3"),
        ("M", 1e3, "mol/m^3"),
        ("1/s", 1.0, "1/s"),
        ("1/h", 1 / 3600, "1/s"),
        ("m^2", 1.0, "m^2"),
        ("K", 1.0, "K"),
        ("rad", 1.0, "rad"),
        ("deg", math.pi / 180, "rad"),
        ("rpm", math.pi / 30, "rad/s"),
        ("kg", 1.0, "kg"),
        ("mg", 1e-6, "kg"),
        ("g/l/h", 1 / 3600, "kg/m^3/s"),
        ("kW", 1e3, "W"),
        ("bar", 1e5, "Pa"),
        ("Pa s", 1.0, "kg/m/s"),
        ("J/mol/K", 1.0, "J/mol/K"),
        ("V", 1.0, "V"),
        ("C", 1.0, "A s"),
        ("mol^(1/2)/l^(1/2)/s", 1000**0.5, "mol^(1/2)/m^(3/2)/s"),
        ("l^(2/3)", 0.01, "m^2"),
        ("%", 0.01, ""),
        ("", 1.0, ""),
        ("1", 1.0, ""),
        (" h ", 3600.0, "s"),
    ):
        found, dimension = parse_unit(unit)
        assert found == pytest.approx(factor, rel=1e-12), unit
        assert dimension.text == str(dimension) == text, unit


@pytest.mark.parametrize(
    ("unit", "why"),
    [
        ("smoot", "unit 'smoot' is not known"),
        ("Mol", "unit 'Mol' is not known"),
        ("mol//l", "unit 'mol//l' is not known"),
        ("2 m", "unit '2 m' is not known"),
        ("degC", "unit 'degC' is no multiple of a unit; write temperatures in K"),
        ("J/°C", "unit 'J/°C' is no multiple of a unit; write temperatures in K"),
        ("Pas", "unit 'Pas' is not known; products are written with a space, as 'Pa s'"),
        ("m^.5", "unit 'm^.5' is not known; powers are whole numbers, or written as m^(1/2)"),
        ("m**(9**9**9)", "unit 'm**(9**9**9)' is not known"),
        ("(km^9 km^9)^9", "unit '(km^9 km^9)^9' is absurdly large or small"),
        ("(pA^9 pA^9 pA^9)^9", "unit '(pA^9 pA^9 pA^9)^9' is absurdly large or small"),
        ("(km^9 km^9 km^9 km^9)^9", "unit '(km^9 km^9 km^9 km^9)^9' is absurdly large or small"),
        ("__import__('os')", "is not known"),
    ],
)
def test_what_is_no_unit_is_refused(unit: str, why: str):
    with pytest.raises(ValueError, match=rf"{re.escape(why)}$"):
        parse_unit(unit)


POWERS = st.fractions(-3, 3, max_denominator=3)
DIMENSIONS = st.builds(lambda powers: Dimension(tuple(powers)), st.lists(POWERS, min_size=7, max_size=7))
UNITS = st.sampled_from(
    ["mol/l", "1/min", "kg", "g", "deg", "bar", "kW", "ohm", "K", "mN m", "%", "nM", "C^-2"]
)


@pytest.mark.slow
@settings(max_examples=30)
@given(dimension=DIMENSIONS)
def test_a_dimensions_text_is_a_unit_of_it(dimension: Dimension):
    factor, found = parse_unit(dimension.text)
    assert factor == pytest.approx(1.0, rel=1e-12)
    assert found == dimension


@pytest.mark.slow
@settings(max_examples=60)
@given(one=UNITS, other=UNITS)
def test_products_and_quotients_of_units(one: str, other: str):
    (a, left), (b, right) = parse_unit(one), parse_unit(other)
    for unit, factor, dimension in (
        (f"({one}) ({other})", a * b, left * right),
        (f"({one})/({other})", a / b, left / right),
        (f"({one})^-2", a**-2, left**-2),
    ):
        found = parse_unit(unit)
        assert found[0] == pytest.approx(factor, rel=1e-12)
        assert found[1] == dimension


@pytest.mark.slow
@given(one=DIMENSIONS, other=DIMENSIONS)
def test_dimensions_are_a_group(one: Dimension, other: Dimension):
    assert one * other == other * one
    assert one * other / other == one
    assert (one * other) ** Fraction(1, 2) == one**0.5 * other**0.5
    assert one / one == PLAIN == one**0


def test_a_power_that_is_almost_a_fraction_is_that():
    assert of("m") ** (1 / 3) * of("m") ** (2 / 3) == of("m")


def test_radians_count_as_plain_numbers_where_dimensions_are_compared():
    assert of("N m").fits(of("kg m^2 rad/s^2"))
    assert of("rad/s").fits(of("1/s"))
    assert not of("rad/s").fits(of("m/s"))
    assert of("rad/s") != of("1/s")
    assert ANGLE.plain
    assert PLAIN.plain
    assert not of("K").plain


def test_dimensions_in_words():
    assert [of(unit).words for unit in ("mol/l", "", "rad")] == ["in mol/m^3", "a plain number", "in rad"]
    assert len(PLAIN.powers) == len(BASE)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("0.7 1/min", 0.7 / 60),
        ("0.7", 0.7),
        (2, 2.0),
        ("2 mol/l", 2000.0),
        ("1e-20 mol/l", 1e-17),
        ("1e13 1/s", 1e13),
        ("6.02214076e23 1/mol", 6.02214076e23),
        ("5 %", 0.05),
        ("180 deg/s", math.pi),
        ("-0 m", 0.0),
        (-0.0, 0.0),
    ],
)
def test_value(value: object, expected: float):
    number, _ = quantity(value)
    assert number == pytest.approx(expected, rel=1e-12)
    assert math.copysign(1, number) == 1


@pytest.mark.parametrize(
    ("value", "why"),
    [
        ("3 smoots", "unit 'smoots' is not known"),
        ("4,9 K", "unit ',9 K' is not known; decimals need a point"),
        ("25 degC", "unit 'degC' is no multiple of a unit; write temperatures in K"),
        ("1 mol/x", "unit 'mol/x' is not known"),
        ("warm", "expected a plain number or a percentage, got 'warm', which does not begin with a number"),
        (True, "expected a plain number or a percentage, got True"),
        (None, "expected a plain number or a percentage, got None"),
        (math.nan, "expected a plain number or a percentage that is finite, got nan"),
        (1e101, "expected a plain number or a percentage of at most 1e+100, got 1e+101"),
        ("1e101 1/h", "expected a rate [1/h] of at most 1e+100, got '1e101 1/h'"),
        ("1e999 W", "expected a power [W] that is finite, got '1e999 W'"),
    ],
)
def test_what_is_no_value_is_refused(value: object, why: str):
    with pytest.raises(ValueError, match=rf"^{re.escape(why)}$"):
        quantity(value)


@pytest.mark.parametrize("unit", ["min", "ms", "cm", "deg", "mm/s^2", "1/min", "mmol/l", "%"])
def test_a_quantity_has_the_factor_and_dimension_of_its_unit(unit: str):
    factor, dimension = parse_unit(unit)
    assert quantity(f"3 {unit}") == (pytest.approx(3 * factor), dimension)


def test_expected_quantities_are_refused_in_other_units():
    assert expect_quantity("2 rad/s", of("1/s"), "") == 2.0
    with pytest.raises(ValueError, match=r"^\{x\} is in mol/m\^3, this in s$"):
        expect_quantity("3 s", of("mol/l"), "{x} is {expected}, this {got}")
