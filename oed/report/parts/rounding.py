"""Estimates as they are read: in mm, deg and ms, and to their error's second digit."""

from __future__ import annotations

import math
from collections.abc import Iterable

from oed.foundation.text import DEGREES, Unit, fixed, quantity, significant, unit_text
from oed.report.parts.tables import MISSING, Cell, Column

LADDERS: dict[str, tuple[tuple[str, float, float], ...]] = {
    "m": (("m", 1.0, 1.0), ("mm", 1e3, 1e-4), ("µm", 1e6, 0.0)),
    "s": (("s", 1.0, 1.0), ("ms", 1e3, 0.0)),
    "m/m": (("mm/m", 1e3, 0.0),),
    "rad": (("deg", DEGREES, 0.0),),
    "rad/m": (("deg/m", DEGREES, 0.0),),
    "rad/s": (("deg/s", DEGREES, 0.0),),
}
"""SI unit -> units from coarse to fine, their factors, and the least size [SI] that they suit."""
OWN_UNITS: dict[str, Unit] = {
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "rad": ("deg", DEGREES),
    "rad/s": ("deg/s", DEGREES),
}
"""SI unit -> unit in which parameters are shown, so that all of a robot's lengths compare."""
MOST_DECIMALS = 9


def unit_for(sizes: Iterable[float | None], unit: str) -> Unit:
    """The unit, and its factor from SI, in which most of these sizes [SI] are easily read."""
    known = sorted(abs(size) for size in sizes if size is not None)
    size = known[len(known) // 2] if known else 0.0
    ladder = LADDERS.get(unit, ((unit, 1.0, 0.0),))
    for shown, factor, least in ladder:
        if size >= least and size > 0:
            return shown, factor
    # Of nothing at all neither the coarsest nor the finest.
    return ladder[min(1, len(ladder) - 1)][:2]


def own_unit(unit: str | None) -> Unit:
    """The unit, and its factor from SI, in which a parameter is shown."""
    return OWN_UNITS.get(unit or "", (unit or "", 1.0))


def decimals_of(error: float | None) -> int | None:
    """Decimals down to an error's second digit; None where the error says nothing of that."""
    if error is None or not math.isfinite(error) or error <= 0:
        return None
    exponent = int(f"{error:.1e}".split("e")[1])
    return min(max(1 - exponent, 0), MOST_DECIMALS)


def to_error(value: float | None, error: float | None, factor: float = 1.0) -> str:
    """A number rounded to its error's second digit, both [SI] shown times a factor.

    Args:
        value: [SI].
        error: its standard error [SI].
        factor: to the unit shown.
    """
    if value is None:
        return MISSING
    decimals = decimals_of(None if error is None else error * factor)
    shown = value * factor
    if decimals is None or abs(shown) >= 1e6:
        return significant(5)(shown)
    return fixed(decimals)(shown)


def error_text(error: float | None, factor: float = 1.0) -> str:
    """An error's two digits."""
    if error is None:
        return MISSING
    return significant(2)(error * factor) if error * factor >= 1e6 else to_error(error, error, factor)


def shown_unit(unit: str | None) -> str:
    """The unit in which a parameter is shown, "1" for none."""
    return unit_text(own_unit(unit)[0]) or "1"


def span_text(low: float | None, high: float | None, error: float | None, factor: float) -> str:
    """`41.83 to 41.88`.

    Args:
        low: [SI].
        high: [SI].
        error: standard error [SI].
        factor: to the unit shown.
    """
    if low is None or high is None:
        return MISSING
    return f"{to_error(low, error, factor)} to {to_error(high, error, factor)}"


def size_text(size: float, unit: str, digits: int = 3) -> str:
    """A size [SI] in the unit that suits it: `45.2 mm`.

    Args:
        size: [SI].
        unit: SI unit.
        digits: that are shown.
    """
    shown, factor = unit_for([size], unit)
    return quantity(size * factor, shown, digits)


def sized(title: str, sizes: Iterable[float | None], unit: str) -> tuple[Column, float]:
    """A column for sizes [SI], in one unit and with as many decimals as give most of them three digits.

    Returns:
        column: it.
        factor: from SI, for its cells.

    Args:
        title: of the column.
        sizes: [SI].
        unit: SI unit.
    """
    known = [size for size in sizes if size is not None]
    shown, factor = unit_for(known, unit)
    middle = sorted(abs(size) for size in known)[len(known) // 2] * factor if known else 1.0
    decimals = 2 - math.floor(math.log10(middle)) if middle > 0 else 2
    return Column(title, unit_text(shown), fixed(min(max(decimals, 0), 3))), factor


def scaled(value: float | None, factor: float) -> Cell:
    """A cell in a column's unit."""
    return None if value is None else value * factor


def probability(p_value: float | None) -> str:
    """A p-value; below what matters, just that."""
    if p_value is None:
        return MISSING
    return "< 0.0001" if p_value < 1e-4 else significant(2)(p_value)


def lasting(seconds: float) -> str:
    """A duration: `48.2 s`, `6 min 56 s`, `3 h 5 min`."""
    if seconds < 100:
        return quantity(seconds, "s")
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 100:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"
