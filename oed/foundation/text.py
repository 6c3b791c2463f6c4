"""Numbers and names in words: the units a reader expects, lists, plurals."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence

READABLE_UNITS = {"m": ("cm", 100.0)}
"""SI unit -> unit in which parameters are shown, and its factor."""

DEGREES = 180.0 / math.pi
"""In a radian."""

FINE_UNITS: dict[str, tuple[tuple[str, float], ...]] = {
    "m": (("cm", 1e2), ("mm", 1e3), ("µm", 1e6)),
    "": (("", 1.0), ("×10⁻³", 1e3), ("×10⁻⁶", 1e6)),
    "rad": (("deg", DEGREES),),
    "rad/s": (("deg/s", DEGREES),),
}
"""SI unit -> units in which deviations are shown, coarse to fine, and their factors."""

ENOUGH = 0.1
"""Least number that is shown of a deviation before the next finer unit is taken."""
LEAST = {"": 0.01}
"""Least number that is shown in the coarsest unit of these, where that is another."""

Unit = tuple[str, float]
Form = Callable[[float], str]


def significant(digits: int) -> Form:
    """Writes a number with that many significant digits, in powers of ten where it is very large or small."""

    def write(value: float) -> str:
        if value == 0 or not math.isfinite(value):
            return _special(value)
        exponent = math.floor(math.log10(abs(value)))
        if -4 <= exponent < 6:
            return f"{value:.{max(0, digits - 1 - exponent)}f}"
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa}e{int(power)}"

    return write


def fixed(decimals: int) -> Form:
    """Writes a number with that many decimals; never "-0"."""

    def write(value: float) -> str:
        return f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else _special(value)

    return write


def whole(value: float) -> str:
    """A count."""
    return fixed(0)(value)


def _special(value: float) -> str:
    if value == 0:
        return "0"
    return "undefined" if math.isnan(value) else "∞" if value > 0 else "-∞"


def readable(value: float, unit: str) -> tuple[float, str]:
    """A parameter's value and unit as shown: lengths in cm."""
    shown, factor = READABLE_UNITS.get(unit, (unit, 1.0))
    return value * factor, shown


def fine_unit(size: float | None, unit: str, least: float | None = None) -> Unit:
    """The unit, and its factor from SI, in which a deviation of that size [SI] is easily read.

    Args:
        size: of the deviation, SI.
        unit: SI unit.
        least: number that may be shown; `LEAST` by default.
    """
    choices = FINE_UNITS.get(unit, ((unit, 1.0),))
    if size is None or not math.isfinite(size) or size <= 0:
        return choices[0]
    first, others = (LEAST.get(unit, ENOUGH), ENOUGH) if least is None else (least, least)
    needed = [first, *[others] * (len(choices) - 1)]
    good = (choice for choice, enough in zip(choices, needed, strict=True) if size * choice[1] >= enough)
    return next(good, choices[-1])


def common_units(sizes: Mapping[str, float | None], units: Mapping[str, str]) -> dict[str, Unit]:
    """A unit, and its factor from SI, for the deviations of each parameter: one for all lengths, and so on.

    Args:
        sizes: standard deviations by parameter, SI; None for those that are not identifiable.
        units: SI units by parameter.
    """
    smallest: dict[str, float] = {}
    for name, size in sizes.items():
        if size is not None and math.isfinite(size) and size > 0:
            smallest[units[name]] = min(size, smallest.get(units[name], math.inf))
    return {name: fine_unit(smallest.get(unit), unit) for name, unit in units.items()}


def deviation_text(size: float, unit: str, chosen: Unit | None = None) -> str:
    """A standard deviation [SI] in the unit that suits it, or the one chosen: `30.3 µm`.

    Args:
        size: of the deviation, SI.
        unit: SI unit.
        chosen: the unit to show it in, and its factor; the one that suits it by default.
    """
    shown, factor = chosen or fine_unit(size, unit)
    return quantity(size * factor, shown)


def given_text(size: float, unit: str) -> str:
    """A quantity [SI] that somebody chose, without idle digits: `1 cm`, `2.5 deg`."""
    shown, factor = fine_unit(abs(size), unit, least=1 - 1e-9)
    return f"{size * factor:.4g} {unit_text(shown)}".strip()


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """`4.90 cm`; just the number where there is no unit.

    Args:
        value: in `unit`.
        unit: to write after it.
        digits: significant ones.
    """
    return f"{significant(digits)(value)} {unit_text(unit)}".strip()


def in_degrees(unit: str) -> Unit:
    """The unit in which an angle, or its rate, is shown in degrees, and its factor from SI."""
    return unit.replace("rad", "deg", 1), DEGREES if unit.startswith("rad") else 1.0


def unit_text(unit: str) -> str:
    """A unit with raised exponents: rad/s^2 -> rad/s²."""
    return unit.replace("^2", "²").replace("^3", "³")


def in_signs(text: str) -> str:
    """A message with the signs of formulas that a page can show: F^-1 -> F⁻¹."""
    return text.replace("F^-1", "F⁻¹").replace("+-", "±")


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
