"""Unit strings become SI numbers; anything doubtful is refused with what was expected and what came."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from oed.foundation.component import Component
from oed.foundation.errors import PartError
from oed.foundation.quantities import (
    _COMMON,
    LARGEST,
    SMALLEST,
    Angle,
    AngularSpeed,
    Duration,
    Length,
    Ratio,
    _common_factor,
    _factor,
    counts_as_zero,
    parse_quantity,
)

READ = [
    ("4.9 cm", "m", 0.049),
    ("4.9cm", "m", 0.049),
    ("49 mm", "m", 0.049),
    ("1e3 um", "m", 1e-3),
    ("2 in", "m", 0.0508),
    ("-1 m", "m", -1.0),
    ("+.5 km", "m", 500.0),
    ("10 deg", "rad", math.radians(10)),
    ("10°", "rad", math.radians(10)),
    ("1 turn", "rad", 2 * math.pi),
    ("2 min", "s", 120.0),
    ("100 ms", "s", 0.1),
    ("10 rad/s", "rad/s", 10.0),
    ("60 rpm", "rad/s", 2 * math.pi),
    ("180 deg/s", "rad/s", math.pi),
    ("20 rad/s^2", "rad/s^2", 20.0),
    ("20 rad/s**2", "rad/s^2", 20.0),
    ("1 rev/s^2", "rad/s^2", 2 * math.pi),
    ("3.6 km/h", "m/s", 1.0),
    ("5 %", "", 0.05),
    ("5%", "", 0.05),
    ("0.05", "", 0.05),
    ("0.5", "m", 0.5),
    (0.049, "m", 0.049),
    (2, "s", 2.0),
]
"""Of the quantities of robots: what is given, and its size in SI units."""


OTHER_KINDS = [
    ("10 cm", "rad"),
    ("10 rad", "m"),
    ("10 Hz", "rad/s"),
    ("10 1/s", "rad/s"),
    ("10 rad/s", "rad/s^2"),
    ("10 rad/s^2", "rad/s"),
    ("5 %", "m"),
    ("3 m", ""),
]


def refusal(value: object, unit: str = "m") -> str:
    """What is said of a value that is refused; nothing of one that is taken."""
    try:
        parse_quantity(value, unit)
    except ValueError as error:
        return str(error)
    return ""


def test_another_dimension_is_refused():
    said = {pair: refusal(*pair) for pair in OTHER_KINDS}
    words = ("of another kind", "expected")
    assert [
        pair for pair, text in said.items() if not all(word in text for word in (*words, repr(pair[0])))
    ] == []


def test_unknown_units_are_refused():
    texts = ["4.9 parsnips", "4.9 m)", "4.9 cm cm/", "1 2 m", "3 __import__"]
    assert [text for text in texts if not re.search(r"is not known|another kind", refusal(text))] == []


OTHER_FIELDS = [
    ("0.5 mol/l", "mol/m^3", 500.0),
    ("2 mM", "mol/m^3", 2.0),
    ("3 µmol/L", "mol/m^3", 3e-3),
    ("5 nM", "mol/m^3", 5e-6),
    ("1 g/l/h", "kg/m^3/s", 1 / 3600),
    ("3 1/min", "1/s", 0.05),
    ("2 d", "s", 172800.0),
    ("5 ds", "s", 0.5),
    ("298.15 K", "K", 298.15),
    ("8.314 J/mol/K", "kg*m^2/s^2/mol/K", 8.314),
    ("8.314 J/(mol*K)", "J/mol/K", 8.314),
    ("1.5 bar", "Pa", 1.5e5),
    ("2 MPa", "Pa", 2e6),
    ("1 mPa s", "kg/m/s", 1e-3),
    ("3 kW", "kg m^2/s^3", 3e3),
    ("1 kWh", "J", 3.6e6),
    ("40 mNm/A", "V s", 0.04),
    ("2 kohm", "V/A", 2e3),
    ("4 mS", "A/V", 4e-3),
    ("3 uF", "C/V", 3e-6),
    ("1 mH", "V s/A", 1e-3),
    ("3 mol^(1/2)/l^(1/2)/s", "mol^(1/2)/m^(3/2)/s", 3 * 1000**0.5),
    ("1 (m/s)^2", "m^2/s^2", 1.0),
]


WRONG = [
    ("25 degC", "K", "unit 'degC' is no multiple of a unit; write temperatures in K: 298.15 K"),
    ("-40 °C", "K", "unit '°C' is no multiple of a unit; write temperatures in K: 233.15 K"),
    ("70 °F", "K", "unit '°F' is no multiple of a unit; write temperatures in K"),
    ("3 J/degC", "J/K", "unit 'J/degC' is no multiple of a unit; write temperatures in K"),
    ("1 Pas", "Pa s", "unit 'Pas' is not known; products are written with a space, as 'Pa s'"),
    ("1 m^0.5", "m", "unit 'm^0.5' is not known; powers are whole numbers, or written as m^(1/2)"),
    ("1 m^1/2", "m", "unit 'm^1/2' is not known; powers are whole numbers, or written as m^(1/2)"),
    ("5 Mm", "m", "unit 'Mm' is not known"),
    ("5 Ms", "s", "unit 'Ms' is not known; products are written with a space, as 'Pa s'"),
    ("5 mol", "m", "unit is of another kind"),
    ("5 N", "m", "unit is of another kind"),
    ("5 M", "m", "unit is of another kind"),
    ("1e13 1/s", "1/s", r"expected a rate [1/s] of at most 1e+12 in SI units, got '1e13 1/s'"),
]


def test_what_is_wrong_with_a_unit_is_said():
    assert [text for text, unit, why in WRONG if not refusal(text, unit).endswith(why)] == []


def test_sizes_may_be_others_than_a_robots():
    assert parse_quantity("1e13 1/s", "1/s", sizes=(0.0, 1e100)) == 1e13
    assert parse_quantity(1e-20, "mol/m^3", sizes=(0.0, 1e100)) == 1e-20
    with pytest.raises(ValueError, match=r"of at most 1e\+100 in SI units"):
        parse_quantity(1e101, "1/s", sizes=(0.0, 1e100))


ARITHMETIC = [
    "5 m**(9**9**9)",
    "5 m^9^9^9",
    "5 m**99999999",
    "5 m*(9**9**9)",
    "5 (9**9**9) m",
    "5 m**-(9**9)",
    "5 ((m))",
    "5 m^0.5*m^0.5",
    "5 m⁹⁹⁹⁹",
    "5 2*m",
    "5 m.real",
    "5 m[0]",
    "5 m if s else m",
    "5 " + "m*" * 20_000 + "m",
    "5 " + "(" * 20_000 + "m" + ")" * 20_000,
    "5 " + "m " * 20_000 + "!",
    "5 " + "m" * 20_000 + "!",
]


def test_arithmetic_is_no_unit():
    assert [text[:20] for text in ARITHMETIC if "is not known" not in refusal(text)] == []


PRODUCTS = [
    ("20 rad/s²", "rad/s^2", 20.0),
    ("1 rad*s^-1", "rad/s", 1.0),
    ("1 rad s**-1", "rad/s", 1.0),
    ("36 km / h", "m/s", 10.0),
    ("3 m per s", "m/s", 3.0),
    ("2 rad/(s*s)", "rad/s^2", 2.0),
    ("2 (m)/(s)", "m/s", 2.0),
    ("3 mm*s/rad", "m*s/rad", 3e-3),
    ("2 deg*s/m", "rad*s/m", math.radians(2)),
    ("4 1/s", "Hz", 4.0),
]


@pytest.mark.slow
@pytest.mark.parametrize("cases", [READ, OTHER_FIELDS, PRODUCTS], ids=["robots", "other fields", "products"])
def test_si_value(cases):
    found = {(value, unit): parse_quantity(value, unit) for value, unit, _ in cases}
    expected = {(value, unit): size for value, unit, size in cases}
    assert found == pytest.approx(expected, rel=1e-12)


def test_whole_numbers_beyond_all_floats_are_refused():
    with pytest.raises(ValueError, match="of at most"):
        parse_quantity(10**400, "m")


def test_text_that_is_no_quantity_is_refused():
    texts = ["", "cm", "about 3 cm", "4,9"]
    assert [text for text in texts if "expected a length [m]" not in refusal(text)] == []


def test_other_types_are_refused():
    values = [True, None, [1, "m"], {"value": 1}, 1j]
    assert [value for value in values if "expected a length [m], got" not in refusal(value)] == []


def test_values_that_are_not_finite_are_refused():
    values = [math.nan, math.inf, -math.inf, "1e999 m"]
    assert [value for value in values if "finite" not in refusal(value)] == []


TOO_LARGE = ["1.1e12 m", "1e300 m", "1e300 km", "-1e10 km", 1e13, -1e29, 10**13, 10**5000]


def test_what_no_robot_has_is_refused():
    said = [refusal(value) for value in TOO_LARGE]
    words = "expected a length [m] of at most 1e+12 in SI units, got"
    assert [number for number, text in enumerate(said) if words not in text or len(text) >= 150] == []


def test_what_rounding_leaves_is_nothing():
    values = ["1e-13 m", "1e-300 m", "-9e-10 mm", 6.1e-17, -5e-324]
    assert [value for value in values if parse_quantity(value, "m") != 0] == []


def test_nothing_is_refused_where_a_size_is_needed_and_said_why():
    assert counts_as_zero("1e-13 m") == "; less than 1e-12 in SI units counts as 0"
    assert [counts_as_zero(value) for value in ("-1 m", 0, "x", None)] == [""] * 4


SCALES = [("cm", "m", 1e-2), ("deg", "rad", math.pi / 180), ("ms", "s", 1e-3), ("rpm", "rad/s", math.pi / 30)]


@given(number=st.floats(-1e9, 1e9), scale=st.sampled_from(SCALES))
def test_a_unit_is_a_factor(number, scale):
    text, unit, factor = scale
    read = parse_quantity(f"{number!r} {text}", unit)
    assert read == pytest.approx(number * factor, rel=1e-12, abs=SMALLEST)


@given(number=st.floats(SMALLEST, LARGEST) | st.floats(-LARGEST, -SMALLEST) | st.just(0.0))
def test_bare_numbers_are_si(number):
    assert parse_quantity(number, "m") == number
    assert parse_quantity(repr(number), "m") == number


@pytest.mark.parametrize(
    ("quantity", "text", "expected"),
    [
        (Length, "18 cm", 0.18),
        (Angle, "90 deg", math.pi / 2),
        (Duration, "20 s", 20.0),
        (AngularSpeed, "10 rad/s", 10.0),
        (Ratio, "5 %", 0.05),
    ],
)
def test_annotated_fields(quantity, text, expected):
    adapter = TypeAdapter(quantity)
    assert adapter.validate_python(text) == pytest.approx(expected)
    assert adapter.validate_python(adapter.dump_python(expected)) == expected
    with pytest.raises(ValidationError, match="expected"):
        adapter.validate_python("3 parsnips")
    schema = adapter.json_schema()
    assert {entry["type"] for entry in schema["anyOf"]} == {"number", "string"}


def test_components_refuse_unknown_keys():
    class Part(Component):
        length: Length

    assert Part(length="1 cm").length == pytest.approx(0.01)
    with pytest.raises(PartError, match="width"):
        Part(length=1, width=2)


QUOTIENTS = ("", "/s", "/s^2", "/s^3", "/m", "/m^2", "/m^3")


def test_common_units_are_pints():
    # The small table that spares loading pint says the same, to the last bit.
    for name, (_, powers) in _COMMON.items():
        own = {(1, 0, 0): "m", (0, 1, 0): "rad", (0, 0, 1): "s"}.get(powers)
        for quotient in QUOTIENTS if own else ("",):
            known = _common_factor(name + quotient, own + quotient if own else "")
            assert known is not None
            assert known == _factor(name, name + quotient, own + quotient if own else "", "")


def test_other_texts_are_left_to_pint():
    texts = ["m/", "/s", "m/s^", "m/s^4", "m/s/s", "m^2", "M", "m /s", "mm/ms", "1/s", ""]
    assert [text for text in texts for unit in ("m", "") if _common_factor(text, unit) is not None] == []


def test_a_common_unit_of_another_dimension_is_left_to_pint():
    assert _common_factor("cm", "rad") is None
    assert _common_factor("deg/s", "rad/s^2") is None
    assert _common_factor("s/s", "") == 1.0
