"""Tables: raw cells with columns that know their unit and how to write a number."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from oed.foundation.text import MISSING, Form, fixed, quantity, significant, to_error, unit_for, unit_text

Cell = float | str | bool | None


@dataclass(frozen=True)
class Column:
    """A table's column.

    Attributes:
        title: above it.
        unit: of its numbers.
        form: how they are written; None for words.
        cell: of an item that a row is about.
    """

    title: str
    unit: str = ""
    form: Form | None = None
    cell: Callable[[Any], Cell] = lambda item: item

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

    @classmethod
    def of(cls, items: Iterable[object], columns: Iterable[Column | None], caption: str = "") -> Table:
        """A row for each item; a column that is None is left out.

        Args:
            items: one for each row.
            columns: that are shown; None is left out.
            caption: of the table.
        """
        shown = tuple(one for one in columns if one is not None)
        return cls(shown, tuple(tuple(one.cell(item) for one in shown) for item in items), caption)

    @property
    def cells(self) -> list[list[str]]:
        """The rows as they are printed."""
        return [
            [column.text(cell) for column, cell in zip(self.columns, row, strict=True)] for row in self.rows
        ]


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
