"""Tables: raw cells with columns that know their unit and how to write a number."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

Cell = float | str | bool | None
Form = Callable[[float], str]

MISSING = "–"


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


@dataclass(frozen=True)
class Column:
    """A table's column: title, unit of its numbers, and how they are written (None for words)."""

    title: str
    unit: str = ""
    form: Form | None = None

    @property
    def heading(self) -> str:
        """`title [unit]`."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def numeric(self) -> bool:
        """Whether the column holds numbers, to be set flush right."""
        return self.form is not None

    def text(self, cell: Cell) -> str:
        """A cell as it is printed."""
        if cell is None:
            return MISSING
        if isinstance(cell, bool):
            return "yes" if cell else "no"
        if isinstance(cell, str):
            return cell
        return (self.form or significant(4))(cell)


@dataclass(frozen=True)
class Table:
    """Rows of raw cells under columns, with a caption."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""

    @property
    def cells(self) -> list[list[str]]:
        """The rows as they are printed."""
        return [
            [column.text(cell) for column, cell in zip(self.columns, row, strict=True)] for row in self.rows
        ]
