"""Numbers and names in words: the units a reader expects, lists, plurals."""

from __future__ import annotations

import re
from collections.abc import Sequence

from oed.report.tables import significant

READABLE_UNITS = {"m": ("cm", 100.0)}
"""SI unit -> unit in which parameters and their deviations are shown, and its factor."""


def readable(value: float, unit: str) -> tuple[float, str]:
    """A parameter's value and unit as shown: lengths in cm."""
    shown, factor = READABLE_UNITS.get(unit, (unit, 1.0))
    return value * factor, shown


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """`4.90 cm`; just the number where there is no unit."""
    return f"{significant(digits)(value)} {unit_text(unit)}".strip()


def unit_text(unit: str) -> str:
    """A unit with raised exponents: rad/s^2 -> rad/s²."""
    return unit.replace("^2", "²").replace("^3", "³")


def words(identifier: str) -> str:
    """wheel_speed -> wheel speed."""
    return identifier.replace("_", " ")


def listing(items: Sequence[str]) -> str:
    """`a, b and c`."""
    return " and ".join(filter(None, [", ".join(items[:-1]), *items[-1:]]))


def count(number: int, noun: str) -> str:
    """`1 start`, `12 starts`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def slug(title: str) -> str:
    """A title as an anchor: lower case, words joined by hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")
