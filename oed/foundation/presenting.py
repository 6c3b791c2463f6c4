"""How objects present themselves where people look at them: a console, a notebook, a table of numbers.

An object says what matters of it as a `Card`, once; its text, its HTML and its short form follow from that.
Cards, tables and figures that modules above make are found by `oed.foundation.views`.
"""

from __future__ import annotations

import dataclasses
import importlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from oed.foundation import views
from oed.foundation.errors import UserMistake
from oed.foundation.shown import shown, written
from oed.foundation.text import (
    MISSING,
    Unit,
    deviation_text,
    own_unit,
    significant,
    to_error,
    unit_text,
    words,
)

Fact = tuple[str, str]
Row = tuple[str, ...]

PARAMETER_COLUMNS: Row = ("parameter", "value", "standard error")
UNIDENTIFIED = "not identifiable"
"""What stands for an infinite standard error."""
MOST_ROWS = 30
"""Rows of a card's table that are shown."""
CELL = "style='text-align:left;padding-right:1.5em'"
"""How a notebook sets a cell; colours are the page's, light or dark."""


@dataclass(frozen=True)
class Card:
    """What matters of an object.

    Attributes:
        title: what it is, in one line.
        facts: what it is called, and what it is; numbers with their units.
        heads: of the table's columns.
        rows: of the table, each as wide as the heads.
        leads: whether the table is the answer, which comes before the facts, and in the short form too.
    """

    title: str
    facts: tuple[Fact, ...] = ()
    heads: Row = ()
    rows: tuple[Row, ...] = ()
    leads: bool = False

    @property
    def short(self) -> str:
        """The title, the table where that is the answer, and the facts, a line each."""
        return "\n".join([shown(self.title), *(self._table if self.leads else ()), *_aligned(self._indented)])

    @property
    def text(self) -> str:
        """The title, the facts and the table."""
        return "\n".join([self.short, *(() if self.leads else self._table)])

    @property
    def _indented(self) -> list[Row]:
        return [(f"  {name}", value) for name, value in self.facts]

    @property
    def _table(self) -> list[str]:
        lines = [*_aligned([self.heads, *self._shown_rows]), *self._rest] if self.rows else []
        return [f"  {line}" for line in lines]

    @property
    def html(self) -> str:
        """Small tables for notebooks; everything escaped."""
        facts = "".join(f"<tr><th {CELL}>{_html(n)}</th>{_cell(v)}</tr>" for n, v in self.facts)
        heads = "".join(f"<th {CELL}>{_html(one)}</th>" for one in self.heads)
        rows = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in self._shown_rows)
        rest = "".join(f"<p>{_html(line)}</p>" for line in self._rest)
        facts = f"<table>{facts}</table>" if facts else ""
        table = f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>{rest}" if rows else ""
        parts = (table, facts) if self.leads else (facts, table)
        return f"<div><strong>{_html(self.title)}</strong>{''.join(parts)}</div>"

    @property
    def _shown_rows(self) -> tuple[Row, ...]:
        return self.rows[:MOST_ROWS]

    @property
    def _rest(self) -> list[str]:
        hidden = len(self.rows) - MOST_ROWS
        return [f"and {hidden} more"] if hidden > 0 else []


def _html(text: str) -> str:
    # Loaded by notebooks: its table of all named characters takes longer to load than a card to write.
    from html import escape

    return escape(shown(text))


def _cell(text: str) -> str:
    return f"<td {CELL}>{_html(text)}</td>"


def _aligned(rows: Sequence[Row]) -> list[str]:
    # Columns under each other.
    cells = [[shown(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ("  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)) for row in cells)
    return [line.rstrip() for line in lines]


class Presented:
    """What has a card, and so a short form, a summary and a form for notebooks."""

    def _card(self) -> Card:
        card: Card = views.make("card", self)
        return card

    def __repr__(self) -> str:
        """The card's title and facts; just the class where the object is too broken to say them."""
        try:
            return self._card().short
        except Exception:
            # What looks at an object after an error must not meet another one.
            return f"<{type(self).__name__}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        # What notebooks show.
        return self._card().html

    def summary(self) -> str:
        """What matters of it as text, with its table."""
        return self._card().text


class Brief:
    """What has many fields: its short form says what each is, with large ones by their size only."""

    def __repr__(self) -> str:
        """The class and its fields, each cut."""
        names = [one.name for one in dataclasses.fields(self) if one.repr]  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(f'{one}={brief(getattr(self, one))}' for one in names)})"


def brief(value: object) -> str:
    """A value in a few words: arrays by their shape, long lists by their length."""
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and math.prod(shape) > 6:
        return f"<array {shape}>"
    if isinstance(value, Mapping) and len(value) > 3:
        return f"<{len(value)} entries>"
    if isinstance(value, list | tuple) and len(value) > 6:
        return f"<{len(value)} entries>"
    return " ".join(written(value).split())


def parameter_rows(
    names: Sequence[str],
    values: Mapping[str, float | None],
    errors: Mapping[str, float | None],
    units: Mapping[str, str],
    shown: Mapping[str, Unit] | None = None,
) -> tuple[Row, ...]:
    """Rows under `PARAMETER_COLUMNS`: every parameter rounded to its standard error, in its usual unit.

    Args:
        names: of the parameters.
        values: by name [SI].
        errors: their standard errors [SI], infinite of what is not identifiable.
        units: SI units.
        shown: units, and their factors from SI, of those that are shown in other ones.
    """
    return tuple(
        _parameter_row(one, values.get(one), errors.get(one), units.get(one, ""), (shown or {}).get(one))
        for one in names
    )


def _parameter_row(name: str, value: float | None, error: float | None, unit: str, shown: Unit | None) -> Row:
    own, factor = shown or own_unit(unit)
    known = value is None or f"{to_error(value, error, factor)} {unit_text(own)}".strip()
    if error is None or not math.isfinite(error):
        text = MISSING if error is None else UNIDENTIFIED
    else:
        text = deviation_text(error, unit, shown)
    return (words(name), MISSING if value is None else str(known), text)


def number(value: float | None, unit: str = "", digits: int = 4) -> str:
    """A number with its unit, a dash for none.

    Args:
        value: in that unit.
        unit: to write after it.
        digits: significant ones.
    """
    return MISSING if value is None else f"{significant(digits)(value)} {unit_text(unit)}".strip()


def given(*facts: tuple[str, str | None]) -> tuple[Fact, ...]:
    """The facts that there are: those without text are left out."""
    return tuple((name, text) for name, text in facts if text)


def dataframe(columns: Mapping[str, Any], units: Mapping[str, str] | None = None) -> Any:
    """A pandas DataFrame of columns, SI; its `attrs["units"]` say which units.

    Args:
        columns: by name, all of one length.
        units: SI units of those columns that have one.

    Raises:
        UserMistake: pandas is not installed; says how to.
    """
    try:
        pandas = importlib.import_module("pandas")
    except ModuleNotFoundError as error:
        if error.name != "pandas":
            raise
        raise UserMistake("tables as DataFrames need pandas: pip install pandas") from None
    frame = pandas.DataFrame(dict(columns))
    frame.attrs["units"] = {name: unit for name, unit in (units or {}).items() if unit}
    return frame
