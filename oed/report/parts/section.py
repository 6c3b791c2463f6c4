"""What a report is made of: sections with tables and figures, each the same in every output format."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from oed.foundation.text import (
    MISSING,
    Form,
    error_text,
    fixed,
    own_unit,
    quantity,
    shown_unit,
    significant,
    to_error,
    unit_for,
    unit_text,
)
from oed.report.figures.spec import Plot


@dataclass(frozen=True)
class Link:
    """A text that leads to a page beside the report.

    Attributes:
        text: it.
        address: of the page.
        number: that the text says; None for a word.
    """

    text: str
    address: str
    number: float | None = None


Cell = float | str | bool | Link | None


@dataclass(frozen=True)
class Entry:
    """A cell as it is printed.

    Attributes:
        text: it.
        key: what it is sorted by; "" comes last.
        address: of the page that it leads to; "" for none.
    """

    text: str
    key: str
    address: str = ""


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
        if isinstance(cell, Link):
            return cell.text
        if isinstance(cell, str):
            return cell
        return (self.form or significant(4))(cell)


@dataclass(frozen=True)
class Table:
    """Rows of raw cells under columns, with a caption; `sortable` by a click on a column's heading."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""
    sortable: bool = False

    @classmethod
    def of(
        cls,
        items: Iterable[object],
        columns: Iterable[Column | None],
        caption: str = "",
        *,
        sortable: bool = False,
    ) -> Table:
        """A row for each item; a column that is None is left out.

        Args:
            items: one for each row.
            columns: that are shown; None is left out.
            caption: of the table.
            sortable: whether a click on a column's heading sorts it.
        """
        shown = tuple(one for one in columns if one is not None)
        rows = tuple(tuple(one.cell(item) for one in shown) for item in items)
        return cls(shown, rows, caption, sortable)

    @property
    def cells(self) -> list[list[str]]:
        """The rows as they are printed."""
        return [
            [column.text(cell) for column, cell in zip(self.columns, row, strict=True)] for row in self.rows
        ]

    @property
    def entries(self) -> list[list[Entry]]:
        """The rows as they are printed, with what they are sorted by and lead to."""
        return [
            [
                Entry(text, sort_key(cell), cell.address if isinstance(cell, Link) else "")
                for text, cell in zip(texts, row, strict=True)
            ]
            for texts, row in zip(self.cells, self.rows, strict=True)
        ]


def sort_key(cell: Cell) -> str:
    """What a cell is sorted by, as a script reads it; what is not known has ""."""
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return ""
    if isinstance(cell, float) and math.isinf(cell):
        return "Infinity" if cell > 0 else "-Infinity"
    if isinstance(cell, (bool, int, float)):
        return repr(float(cell))
    if isinstance(cell, Link):
        return sort_key(cell.text if cell.number is None else cell.number)
    return cell.casefold()


@dataclass(frozen=True)
class Picture:
    """A figure of a section.

    Attributes:
        name: of the file, without suffix; unique in the report.
        alt: what the figure shows, for those who cannot see it.
        caption: how to read it.
        figure: what is drawn.
    """

    name: str
    alt: str
    caption: str
    figure: Plot


@dataclass(frozen=True)
class Animation:
    """Drives to be played in the HTML page; lengths in m.

    Attributes:
        drives: each a run with name, duration [s], and x, y, heading at even times, of a tractor the
            trailer's angle, too; its inputs chart by chart, each at even times, which hold if `steps`; and
            the paths of simulated robots.
        view: x_min, x_max, y_min, y_max of what is shown.
        workspace: its outline, a circle (x, y, radius) or a polygon (points).
        obstacles: outlines alike.
        width: of the robot; 0 where it is not known.
        body_radius: of the circle around it, 0 for none.
        trailer: how far behind the robot's origin it is hitched, and from there to its axle.
        charts: of the inputs over time: title, labels of the lines, and limits or None.
        caption: how to read it.
    """

    drives: tuple[Mapping[str, Any], ...]
    view: tuple[float, float, float, float]
    workspace: Mapping[str, Any] | None
    width: float
    obstacles: tuple[Mapping[str, Any], ...] = ()
    body_radius: float = 0.0
    trailer: tuple[float, float] | None = None
    charts: tuple[Mapping[str, Any], ...] = ()
    caption: str = ""


@dataclass(frozen=True)
class Download:
    """A file that the HTML page holds.

    Attributes:
        text: of the link to it.
        name: of the file.
        content: of the file.
    """

    text: str
    name: str
    content: str


@dataclass(frozen=True)
class Film:
    """A GIF that lies beside the report.

    Attributes:
        file: it.
        alt: what it shows, for those who cannot see it.
        caption: how to read it.
    """

    file: Path
    alt: str
    caption: str


@dataclass(frozen=True)
class Section:
    """A titled part of a report.

    Attributes:
        title: heading.
        notices: sentences that must not be overlooked, shown first.
        remarks: sentences for those who ask, in small print below the tables.
        paragraphs: plain text; `backticks` mark code.
        figures: drawn below the paragraphs.
        tables: below the figures.
        animation: played in the HTML page, left out elsewhere.
        film: below the animation; part of the HTML page.
        links: text and address of pages beside the report.
        code: verbatim text.
        downloads: files that the HTML page holds.
        commands: what to do next, and the command that does it.
        folds: parts that are folded away in the HTML page, last.
        brief: how many paragraphs and tables are in sight in the HTML page, the others folded; None for all.
        folded: whether the section itself is.
        first: whether it is the page's first screen: the drive beside the tables and sentences.
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Picture, ...] = ()
    notices: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    animation: Animation | None = None
    film: Film | None = None
    links: tuple[tuple[str, str], ...] = ()
    code: str = ""
    downloads: tuple[Download, ...] = ()
    commands: tuple[tuple[str, str], ...] = ()
    folds: tuple[Section, ...] = ()
    brief: tuple[int, int] | None = None
    folded: bool = False
    first: bool = False

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures, those of folded parts too."""
        return (*self.figures, *(picture for one in self.folds for picture in one.pictures))

    @classmethod
    def of(cls, title: str, *parts: str | Table | Picture | None, notices: Iterable[str] = ()) -> Section:
        """Those of these sentences, tables and figures that say something, each kind in its order.

        Args:
            title: heading.
            parts: sentences, tables and figures; "" and None are left out.
            notices: sentences that must not be overlooked; "" is left out.
        """
        return cls(
            title,
            paragraphs=tuple(one for one in parts if isinstance(one, str) and one),
            tables=tuple(one for one in parts if isinstance(one, Table)),
            figures=tuple(one for one in parts if isinstance(one, Picture)),
            notices=tuple(filter(None, notices)),
        )


def estimated(of: Callable[[Any], Any] = lambda item: item) -> tuple[Column, ...]:
    """Columns for what items say was estimated: unit, estimate and standard error."""

    def value(item: object) -> str:
        one = of(item)
        return to_error(one.value, one.standard_error, own_unit(one.unit)[1])

    def error(item: object) -> str:
        return error_text(of(item).standard_error, own_unit(of(item).unit)[1])

    return (
        Column("unit", cell=lambda item: shown_unit(of(item).unit)),
        Column("estimate", "", significant(5), value),
        Column("± standard error", "", significant(2), error),
    )


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


def sized(
    title: str, unit: str, sizes: Iterable[float | None], cell: Callable[[Any], Cell] = lambda item: item
) -> Column:
    """A column for sizes [SI], in one unit and with as many decimals as give most of them three digits.

    Args:
        title: of the column.
        unit: SI unit.
        sizes: [SI].
        cell: the size [SI] of an item that a row is about.
    """
    known = [size for size in sizes if size is not None]
    shown, factor = unit_for(known, unit)
    middle = sorted(abs(size) for size in known)[len(known) // 2] * factor if known else 1.0
    decimals = 2 - math.floor(math.log10(middle)) if middle > 0 else 2
    write = fixed(min(max(decimals, 0), 3))
    return Column(title, unit_text(shown), lambda size: write(size * factor), cell)


def percent(share: float | None) -> float | None:
    """A share in percent, for a cell."""
    return None if share is None else 100 * share


def probability(p_value: float) -> str:
    """A p-value; below what matters, just that."""
    return "< 0.0001" if p_value < 1e-4 else significant(2)(p_value)


def lasting(seconds: float) -> str:
    """A duration: `48.2 s`, `6 min 56 s`, `3 h 5 min`."""
    if seconds < 100:
        return quantity(seconds, "s")
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 100:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"
