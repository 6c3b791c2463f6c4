"""Tables: raw cells with columns that know their unit and how to write a number."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from oed.foundation.text import Form, significant

Cell = float | str | bool | None

MISSING = "–"


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
