"""What limits the best drive: what looser limits would gain, and how far every drive stays inside them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from oed.foundation.text import (
    Unit,
    excess_text,
    given_text,
    in_degrees,
    quantity,
    significant,
    size_text,
    unit_text,
    words,
)
from oed.kernel.limit import BOTH_ENDS
from oed.records.record import Record
from oed.records.stored.result import Margin, Result
from oed.records.stored.simulation import StoredRobustness
from oed.report.parts.prose import Prose
from oed.report.parts.reading import called, time_scale, with_drive
from oed.report.parts.section import Cell, Column, Section, Table, percent
from oed.robots.limits import LIMITS, InputLimit, Limit

SAY = Prose("limits")
CONDITIONS = ("duration", "settings", "start", "rest_to_rest")
"""What holds exactly or not at all: there is no room to speak of."""
MOST_COLUMNS = 7
"""Limits beyond which a table of all drives names only those that a drive touches."""
LITTLE = 0.01
"""Share of its size by which a limit is said to be looser, at most: its gain is a rate."""
BACK_OFF = " (back-off for other robots included)"
"""What is added to what a limit is exceeded by that is tightened for robots other than the nominal one."""
LEAST = 1e-4
"""Share of its size that a drive may be from a limit and count as at it."""
NOTHING = 1e-5
"""Share by which a drive is better that counts as none."""


def limits(record: Record) -> Section | None:
    """What looser limits would gain, the best drive limit by limit, then all drives side by side."""
    results = [one for one in with_drive(record) if one.margins]
    if not results:
        return None
    winner = record.best
    margins = [margin for one in results for margin in one.margins]
    # When limits were looked at; records of before say nothing of it.
    silent = any(margin.certain is None for margin in margins)
    points = list(dict.fromkeys(margin.limit for margin in margins if not margin.certain))
    every = _side_by_side(record, results) if len(results) > 1 or winner is None else None
    if winner is None:
        return Section.of("How far every drive exceeds the limits", SAY("margins", silent, points), every)
    found = [_room(record, margin) for margin in winner.margins]
    rooms = sorted(found, key=lambda one: -(one.gain or 0.0))
    known = [one for one in rooms if one.gain is not None]
    table = _by_limit(rooms, called(record, winner), bool(known))
    said = (SAY("gains", known), SAY("margins", silent, points), SAY("rates", bool(known)))
    return replace(Section.of("What limits it", *said, table, every), brief=(1, 1))


@dataclass(frozen=True)
class Room:
    """How much room a drive leaves to a limit, and what a looser one would gain, in words.

    Attributes:
        margin: to the limit.
        own: the unit in which the study gives the limit, and its factor from SI; None where it gives none.
        looser: what there is where it is wider by an `{amount}`, in words; as the limit of its name says by
            default.
    """

    margin: Margin
    own: Unit | None = None
    looser: str = ""

    @property
    def unit(self) -> Unit:
        """As shown, and its factor from SI."""
        if self.own is not None:
            return self.own
        return in_degrees(self.margin.unit) if self._degrees else (self.margin.unit, 1.0)

    @property
    def _degrees(self) -> bool:
        return getattr(LIMITS.get(self.margin.limit), "in_degrees", False)

    @property
    def _usual(self) -> bool:
        # Lengths are in mm where they are small.
        return self.margin.unit == "m" and self.own is None

    @property
    def step(self) -> float:
        """By how much a looser limit is wider, in the unit shown: a round number, a little of its size."""
        most = LITTLE * self.margin.size * self.unit[1]
        power = 10.0 ** math.floor(math.log10(most))
        return next(one * power for one in (5, 2, 1) if one * power <= (1 + 1e-9) * most)

    @property
    def loosened(self) -> str:
        """The limit that much wider."""
        shown, factor = self.unit
        amount = given_text(self.step / factor, "m") if self._usual else f"{self.step:g} {unit_text(shown)}"
        said = self.looser or getattr(LIMITS.get(self.margin.limit), "loosened", Limit.loosened)
        return str(said).format(amount=amount, name=words(self.margin.limit))

    @property
    def gain(self) -> float | None:
        """By which share the best drive would be better then; None where that is not known."""
        if self.margin.gain is None or not self.margin.size:
            return None
        share = self.margin.gain * self.step / self.unit[1]
        return share if share > NOTHING else 0.0

    @property
    def met(self) -> bool:
        """Whether it is a condition, which holds exactly."""
        return self.margin.active and self.margin.limit in CONDITIONS

    @property
    def text(self) -> str:
        """The distance to the limit, with its unit."""
        if self.own is not None:
            return quantity(abs(self.margin.margin) * self.own[1], self.own[0])
        return excess_text(abs(self.margin.margin), self.margin.unit, degrees=self._degrees)

    @property
    def amount(self) -> str:
        """The distance with its unit and sign; 0 where it is nothing beside the tolerance of scoring."""
        shown, factor = self.unit
        if abs(self.margin.margin) < LEAST * self.margin.size:
            return "0"
        if self._usual:
            return size_text(self.margin.margin, "m")
        return quantity(factor * self.margin.margin, shown)

    @property
    def size(self) -> str | None:
        """Of the limit, where it has one, with its unit."""
        sized = self.margin.limit not in ("start", "rest_to_rest")
        shown, factor = self.unit
        return f"{factor * self.margin.size:.4g} {unit_text(shown)}".strip() if sized else None


def _room(record: Record, margin: Margin) -> Room:
    # Of experiments: limits have names of their own, and times are shown as those of courses.
    limit = next((one for one in record.study.every_limit if one.name == margin.limit), None)
    if record.study.domain == "robots":
        both = isinstance(limit, InputLimit) and limit.bounds is not None and sum(limit.bounds) != 0
        return Room(margin, looser=BOTH_ENDS if both else "")
    own = record.study.limit_units.get(margin.limit)
    if own is None and margin.unit == "s":
        own = time_scale(record.study.space.duration)
    return Room(margin, own, "" if limit is None else limit.loosened)


def _by_limit(rooms: Sequence[Room], title: str, known: bool) -> Table:
    columns = (
        Column("limit", cell=lambda one: words(one.margin.limit)),
        Column("a little looser", cell=lambda one: None if one.gain is None else one.loosened)
        if known
        else None,
        Column("best drive better by", "%", significant(2), lambda one: percent(one.gain)) if known else None,
        Column("margin", cell=lambda one: one.amount),
        Column("size of the limit", cell=lambda one: one.size),
        Column("state", cell=lambda one: SAY("state", one)),
    )
    return Table.of(rooms, columns, f"Limits: {title}")


def exceeded(
    result: Result, robustness: StoredRobustness | None = None, units: Mapping[str, Unit] | None = None
) -> list[str]:
    """The limits that a drive exceeds, and by how much: `end position by 1.27 m`.

    Args:
        result: that has the drive.
        robustness: a record's: of limits that it tightens the back-off is said to be included.
        units: in which limits are given, by their names.
    """
    own = units or {}
    broken = [Room(margin, own.get(margin.limit)) for margin in result.margins if not margin.satisfied]
    said = [f"{words(room.margin.limit)} by {room.text}{_back_off(room, robustness)}" for room in broken]
    return said or list(map(words, result.violations))


def _back_off(room: Room, robustness: StoredRobustness | None) -> str:
    tightened = robustness is not None and room.margin.limit in robustness.limits
    return BACK_OFF if tightened else ""


def _side_by_side(record: Record, results: list[Result]) -> Table:
    names = dict.fromkeys(margin.limit for one in results for margin in one.margins)
    columns = _touched(record) if len(names) > MOST_COLUMNS else (_column(name, record) for name in names)
    return Table.of(results, [Column("drive", cell=lambda one: called(record, one)), *columns], "All drives")


def _column(name: str, record: Record) -> Column:
    def brief(one: Result) -> Cell:
        rooms = (_room(record, margin) for margin in one.margins if margin.limit == name)
        return next((SAY("brief", room, _back_off(room, record.robustness)) for room in rooms), None)

    return Column(words(name), cell=brief)


def _touched(record: Record) -> Iterator[Column]:
    def broken(one: Result) -> Cell:
        return ", ".join(exceeded(one, record.robustness, record.study.limit_units)) or None

    def met(one: Result) -> Cell:
        touched = (words(margin.limit) for margin in one.margins if margin.satisfied and margin.active)
        return ", ".join(touched) or None

    def spare(one: Result) -> Cell:
        return str(sum(margin.satisfied and not margin.active for margin in one.margins))

    yield Column("exceeded", cell=broken)
    yield Column("active or met", cell=met)
    yield Column("satisfied with room", cell=spare)
