"""Numbers and words as they are printed."""

from __future__ import annotations

import math

import pytest

from oed.foundation.text import (
    common_units,
    count,
    deviation_text,
    fixed,
    given_text,
    listing,
    quantity,
    readable,
    significant,
    slug,
)
from oed.report.parts.tables import Column, Table


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (269.6176, "269.6"),
        (0.0175432, "0.01754"),
        (1.33e16, "1.330e16"),
        (-4.5e-13, "-4.500e-13"),
        (12345.6, "12346"),
        (0.0, "0"),
        (math.inf, "∞"),
    ],
)
def test_four_significant_digits(value: float, text: str) -> None:
    assert significant(4)(value) == text


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
    assert readable(0.0245, "m") == (pytest.approx(2.45), "cm")
    assert readable(0.27, "") == (0.27, "")
    assert quantity(20.0, "rad/s^2") == "20.0 rad/s²"
    assert (listing([]), listing(["a"]), listing(["a", "b", "c"])) == ("", "a", "a, b and c")
    assert (count(1, "start"), count(12, "start")) == ("1 start", "12 starts")
    assert slug("The paper's figures") == "the-paper-s-figures"


@pytest.mark.parametrize(
    ("size", "unit", "text"),
    [
        (0.00472, "m", "0.472 cm"),
        (3.03e-4, "m", "0.303 mm"),
        (3.03e-5, "m", "30.3 µm"),
        (3.03e-9, "m", "0.00303 µm"),
        (0.05, "", "0.0500"),
        (0.00361, "", "3.61 ×10⁻³"),
        (3.61e-5, "", "36.1 ×10⁻⁶"),
        (math.inf, "m", "∞ cm"),
    ],
)
def test_deviations_in_the_unit_that_suits_them(size: float, unit: str, text: str) -> None:
    assert deviation_text(size, unit) == text


@pytest.mark.parametrize(
    ("size", "unit", "text"),
    [
        (0.01, "m", "1 cm"),
        (0.0005, "m", "500 µm"),
        (math.radians(2.5), "rad", "2.5 deg"),
        (0.2, "s", "0.2 s"),
    ],
)
def test_given_quantities_have_no_idle_digits(size: float, unit: str, text: str) -> None:
    assert given_text(size, unit) == text


def test_parameters_of_one_kind_share_a_unit() -> None:
    units = common_units(
        {"radius": 3e-5, "track": 1e-3, "slip": 0.02, "untold": None},
        {"radius": "m", "track": "m", "slip": "", "untold": "m"},
    )
    assert {name: unit for name, (unit, _) in units.items()} == {
        "radius": "µm",
        "track": "µm",
        "slip": "",
        "untold": "µm",
    }
