"""Numbers and words as they are printed."""

from __future__ import annotations

import math

from oed.foundation.text import (
    count,
    deviation_text,
    fixed,
    given_text,
    listing,
    nominal_text,
    own_unit,
    quantity,
    significant,
    slug,
)
from oed.report.parts.section import Column, Table


def test_four_significant_digits() -> None:
    expected = {
        269.6176: "269.6",
        0.0175432: "0.01754",
        1.33e16: "1.330e16",
        -4.5e-13: "-4.500e-13",
        12345.6: "12346",
        0.0: "0",
        math.inf: "∞",
    }
    assert {value: significant(4)(value) for value in expected} == expected


def test_fixed_decimals_never_show_minus_zero() -> None:
    assert fixed(3)(-0.0) == "0.000"
    assert fixed(3)(-1e-9) == "0.000"
    assert fixed(2)(-1.239) == "-1.24"


def test_cells_as_printed() -> None:
    table = Table((Column("result"), Column("length", "m", fixed(1)), Column("kept")), (("a", 2.0, True),))
    assert [column.heading for column in table.columns] == ["result", "length [m]", "kept"]
    assert table.cells == [["a", "2.0", "yes"]]
    assert Column("length", "m", fixed(1)).text(None) == "–"


def test_words() -> None:
    assert (own_unit("m"), own_unit("")) == (("mm", 1e3), ("", 1.0))
    assert quantity(20.0, "rad/s^2") == "20.0 rad/s²"
    assert (listing([]), listing(["a"]), listing(["a", "b", "c"])) == ("", "a", "a, b and c")
    assert (count(1, "start"), count(12, "start")) == ("1 start", "12 starts")
    assert slug("The paper's figures") == "the-paper-s-figures"


def test_deviations_have_two_digits_in_the_unit_of_parameters() -> None:
    expected = {
        (0.00472, "m"): "4.7 mm",
        (3.03e-4, "m"): "0.30 mm",
        (3.03e-5, "m"): "0.030 mm",
        (3.03e-9, "m"): "0.0000030 mm",
        (math.radians(2.5), "rad"): "2.5 deg",
        (0.05, ""): "0.050",
        (3.61e-5, ""): "0.000036",
        (math.inf, "m"): "∞ mm",
    }
    assert {one: deviation_text(*one) for one in expected} == expected


def test_given_quantities_have_no_idle_digits() -> None:
    expected = {
        (0.01, "m"): "10 mm",
        (0.0005, "m"): "0.5 mm",
        (3.0, "m"): "3 m",
        (math.radians(2.5), "rad"): "2.5 deg",
        (0.2, "s"): "200 ms",
    }
    assert {one: given_text(*one) for one in expected} == expected


def test_nominal_values_are_as_given_or_short() -> None:
    expected = {33.0: "33", 11.875: "11.875", 1e3 * 0.163: "163", 0.049 / 0.18: "0.2722", 100 / 3: "33.33"}
    assert {value: nominal_text(value) for value in expected} == expected


def test_a_computed_nominal_value_goes_to_its_errors_second_digit():
    """An estimate that a next drive is designed for."""
    assert nominal_text(33.200912345, 0.0046) == "33.2009"
    assert nominal_text(33.200912345) == "33.2"
    assert nominal_text(33.0, 0.0046) == "33"
