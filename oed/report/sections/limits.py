"""How far every drive stays inside every limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from oed.foundation.text import Unit, fixed, in_degrees, quantity, unit_text, words
from oed.records.record import Record
from oed.records.stored.result import Margin, Result
from oed.report.parts.prose import Prose
from oed.report.parts.reading import with_drive
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table
from oed.robots.limits import LIMITS

SAY = Prose("limits")
CONDITIONS = ("duration", "start", "rest_to_rest")
"""What holds exactly or not at all: there is no room to speak of."""
MOST_COLUMNS = 7
"""Limits beyond which a table of all drives names only those that a drive touches."""


def limits(record: Record) -> Section | None:
    """The best drive limit by limit, then all drives side by side."""
    results = [one for one in with_drive(record) if one.margins]
    if not results:
        return None
    winner = record.best or results[0]
    margins = [margin for one in results for margin in one.margins]
    # When limits were looked at; records of before say nothing of it.
    silent = any(margin.certain is None for margin in margins)
    points = list(dict.fromkeys(margin.limit for margin in margins if not margin.certain))
    tables = [_by_limit(winner)] + ([_side_by_side(results)] if len(results) > 1 else [])
    return Section("Limits", paragraphs=(SAY("margins", silent, points),), tables=tuple(tables))


@dataclass(frozen=True)
class _Room:
    """How much room a drive leaves to a limit, in words."""

    margin: Margin

    @property
    def name(self) -> str:
        return words(self.margin.limit)

    @property
    def unit(self) -> Unit:
        """As shown, and its factor from SI."""
        degrees = getattr(LIMITS.get(self.margin.limit), "in_degrees", False)
        return in_degrees(self.margin.unit) if degrees else (self.margin.unit, 1.0)

    @property
    def met(self) -> bool:
        return self.margin.active and self.margin.limit in CONDITIONS

    @property
    def text(self) -> str:
        shown, factor = self.unit
        return quantity(abs(factor * self.margin.margin), shown)

    @property
    def brief(self) -> str:
        """A cell of the table of all drives."""
        if not self.margin.kept:
            return f"exceeded by {self.text}"
        return "met" if self.met else "active" if self.margin.active else f"{self.text} spare"

    @property
    def state(self) -> str:
        """The same of the table of one drive."""
        if not self.margin.kept or self.met:
            return "met" if self.margin.kept else "exceeded"
        state = "active" if self.margin.active else "kept with room"
        return f"{state} (checked at points only)" if self.margin.certain is False else state

    @property
    def row(self) -> tuple[Cell, ...]:
        """Of the table of one drive; as fine as the tolerance that a limit is judged by, and a digit more."""
        shown, factor = self.unit
        size = factor * self.margin.size
        amount = fixed(4 if size <= 1 else 3)(factor * self.margin.margin)
        sized = self.margin.limit not in ("start", "rest_to_rest")
        return self.name, amount, f"{size:g}" if sized else None, unit_text(shown), self.state


def _by_limit(result: Result) -> Table:
    columns = tuple(map(Column, ("limit", "margin", "size of the limit", "unit", "state")))
    return Table(columns, tuple(_Room(one).row for one in result.margins), f"Limits of {result.name}")


def _side_by_side(results: list[Result]) -> Table:
    names = list(dict.fromkeys(margin.limit for one in results for margin in one.margins))
    if len(names) > MOST_COLUMNS:
        columns = tuple(map(Column, ("result", "exceeded", "active or met", "kept with room")))
        return Table(columns, tuple(map(_touched, results)), "All drives")
    rows: list[Any] = []
    for one in results:
        rooms = {margin.limit: _Room(margin).brief for margin in one.margins}
        rows.append((one.name, *(rooms.get(name) for name in names)))
    return Table((Column("result"), *(Column(words(name)) for name in names)), tuple(rows), "All drives")


def _touched(result: Result) -> tuple[Cell, ...]:
    rooms = [_Room(margin) for margin in result.margins]
    broken = [one for one in rooms if not one.margin.kept]
    touched = [one for one in rooms if one.margin.kept and one.margin.active]
    exceeded = ", ".join(f"{one.name} by {one.text}" for one in broken)
    met = ", ".join(one.name for one in touched)
    return result.name, exceeded or None, met or None, str(len(rooms) - len(broken) - len(touched))
