"""How far every drive stays inside every limit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from oed.foundation.text import Unit, fixed, in_degrees, quantity, unit_text, words
from oed.records.record import Record
from oed.records.stored.result import Margin, Result
from oed.report.parts.prose import Prose
from oed.report.parts.reading import called, with_drive
from oed.report.parts.section import Cell, Column, Section, Table
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
    every = _side_by_side(results) if len(results) > 1 else None
    table = _by_limit(winner, called(record, winner))
    return replace(Section.of("Limits", SAY("margins", silent, points), table, every), brief=(1, 1))


@dataclass(frozen=True)
class Room:
    """How much room a drive leaves to a limit, in words."""

    margin: Margin

    @property
    def unit(self) -> Unit:
        """As shown, and its factor from SI."""
        degrees = getattr(LIMITS.get(self.margin.limit), "in_degrees", False)
        return in_degrees(self.margin.unit) if degrees else (self.margin.unit, 1.0)

    @property
    def met(self) -> bool:
        """Whether it is a condition, which holds exactly."""
        return self.margin.active and self.margin.limit in CONDITIONS

    @property
    def text(self) -> str:
        """The distance to the limit, with its unit."""
        shown, factor = self.unit
        return quantity(abs(factor * self.margin.margin), shown)

    @property
    def amount(self) -> str:
        """As fine as the tolerance that the limit is judged by, and one digit more."""
        factor = self.unit[1]
        return fixed(4 if factor * self.margin.size <= 1 else 3)(factor * self.margin.margin)

    @property
    def size(self) -> str | None:
        """Of the limit, where it has one."""
        sized = self.margin.limit not in ("start", "rest_to_rest")
        return f"{self.unit[1] * self.margin.size:g}" if sized else None


def _by_limit(result: Result, title: str) -> Table:
    columns = (
        Column("limit", cell=lambda one: words(one.margin.limit)),
        Column("margin", cell=lambda one: one.amount),
        Column("size of the limit", cell=lambda one: one.size),
        Column("unit", cell=lambda one: unit_text(one.unit[0])),
        Column("state", cell=lambda one: SAY("state", one)),
    )
    return Table.of(map(Room, result.margins), columns, f"Limits: {title}")


def _side_by_side(results: list[Result]) -> Table:
    names = dict.fromkeys(margin.limit for one in results for margin in one.margins)
    columns = _touched() if len(names) > MOST_COLUMNS else map(_column, names)
    return Table.of(results, [Column("result", cell=lambda one: one.name), *columns], "All drives")


def _column(name: str) -> Column:
    def brief(one: Result) -> Cell:
        rooms = (Room(margin) for margin in one.margins if margin.limit == name)
        return next((SAY("brief", room) for room in rooms), None)

    return Column(words(name), cell=brief)


def _touched() -> Iterator[Column]:
    def exceeded(one: Result) -> Cell:
        broken = (Room(margin) for margin in one.margins if not margin.satisfied)
        return ", ".join(f"{words(room.margin.limit)} by {room.text}" for room in broken) or None

    def met(one: Result) -> Cell:
        touched = (words(margin.limit) for margin in one.margins if margin.satisfied and margin.active)
        return ", ".join(touched) or None

    def spare(one: Result) -> Cell:
        return str(sum(margin.satisfied and not margin.active for margin in one.margins))

    yield Column("exceeded", cell=exceeded)
    yield Column("active or met", cell=met)
    yield Column("satisfied with room", cell=spare)
