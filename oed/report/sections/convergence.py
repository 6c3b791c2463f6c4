"""How fast each search found what it found; searches by different criteria apart."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from oed.foundation.text import listing, quantity, significant, whole
from oed.records.record import Record
from oed.report.parts.judging import Aim, by_aim
from oed.report.parts.reading import Entry
from oed.report.parts.section import Picture, Section
from oed.report.parts.tables import Cell, Column, Table

TARGETS = (0.9, 0.99, 0.999)
"""Shares of the best objective whose times are listed."""
FLOOR = 1e-4
"""Shortfall [%] below which a search counts as level with the best."""

Group = tuple[Aim, list[Entry]]


def convergence(record: Record) -> Section | None:
    """Best objective so far against time, and the time each search took to given targets."""
    searches = [entry for entry in record.results if _points(entry)]
    if not searches:
        return None
    groups = by_aim(record, searches)
    apart = len(groups) > 1
    alt = f"Convergence of {listing([str(entry['name']) for entry in searches])} over time"
    drawn = [line for aim, entries in groups for line in _lines(aim, entries, apart)]
    picture = Picture("convergence", alt, _caption(apart), partial(_draw, drawn, apart))
    return Section(
        "Convergence",
        paragraphs=tuple(sentence for _, entries in groups for sentence in _races(entries)),
        figures=(picture,),
        tables=(_table(groups),),
    )


def _caption(apart: bool) -> str:
    of = "all searches by the same criterion, in efficiency by it" if apart else "all searches"
    return (
        f"Best objective so far below the best of {of}, re-scored at all times, against the "
        f"search's own time on one machine. Below {FLOOR:g} % it is drawn at that level. A search that "
        "settles among equal optima gives up a little of its objective afterwards; that is not drawn."
    )


def _points(entry: Entry) -> list[Any]:
    # A design that leaves something undetermined has no finite number by most criteria.
    return [point for point in entry.get("history") or [] if point["objective"] is not None]


def _reached(entry: Entry) -> float:
    return max(float(point["objective"]) for point in _points(entry))


def time_to(entry: Entry, objective: float) -> tuple[float, int] | None:
    """Seconds and evaluations after which a search had reached `objective`; None if it never did."""
    for point in _points(entry):
        if point["objective"] >= objective:
            return float(point["seconds"]), int(point["evaluations"])
    return None


def _time_to_share(aim: Aim, entry: Entry, best: float, share: float) -> float | None:
    for point in _points(entry):
        if aim.change(float(point["objective"]), best) >= 100.0 * (share - 1.0):
            return float(point["seconds"])
    return None


def _lines(aim: Aim, searches: Sequence[Entry], apart: bool) -> list[tuple[str, list[tuple[float, float]]]]:
    # (seconds, shortfall in percent), one point each time the objective rose, and at the end.
    best = max(_reached(entry) for entry in searches)
    lines = []
    for entry in searches:
        points = [
            (float(point["seconds"]), max(FLOOR, -aim.change(float(point["objective"]), best)))
            for point in _points(entry)
        ]
        end = max(points[-1][0], float(entry["wall_seconds"]))
        name = f"{entry['name']}, by {aim.label}" if apart else str(entry["name"])
        lines.append((name, [*points, (end, points[-1][1])]))
    return lines


def _races(searches: list[Entry]) -> list[str]:
    # Only within a group: objectives by different criteria do not compare.
    if not any(entry["kind"] == "ipopt" for entry in searches):
        return []
    return [_race(entry, searches) for entry in searches if entry["kind"] != "ipopt"]


def _race(entry: Entry, searches: list[Entry]) -> str:
    # How long the gradient search took to what this search ended with.
    own, target = float(entry["wall_seconds"]), _reached(entry)
    others = [(other, time_to(other, target)) for other in searches if other["kind"] == "ipopt"]
    reached = [(other, hit[0]) for other, hit in others if hit is not None]
    first = time_to(entry, target)
    if first is None or not reached:
        return f"No gradient search reached what {entry['name']} ended with, {quantity(target, '', 6)}."
    other, seconds = min(reached, key=lambda pair: pair[1])
    return (
        f"{other['name']} reached the final best of {entry['name']}, {quantity(target, '', 6)}, after "
        f"{quantity(seconds, 's')}; {entry['name']} itself after {quantity(first[0], 's')} of its "
        f"{quantity(own, 's')}, which is {quantity(first[0] / seconds, '', 2)} times as long."
    )


def _table(groups: Sequence[Group]) -> Table:
    several = len(groups) > 1
    columns = [Column("result"), *([Column("searched for")] if several else [])]
    columns += [Column("best objective", "", significant(6))]
    columns += [Column(f"time to {100 * share:g} %", "s", significant(3)) for share in TARGETS]
    columns += [Column("whole search", "s", significant(3)), Column("evaluations", "", whole)]
    rows = tuple(row for aim, entries in groups for row in _rows(aim, entries, several))
    alike = " by the same criterion" if several else ""
    caption = f"Times to shares of the best objective of all searches{alike}; – where it was not reached"
    return Table(tuple(columns), rows, caption)


def _rows(aim: Aim, entries: Sequence[Entry], several: bool) -> list[tuple[Cell, ...]]:
    best = max(_reached(entry) for entry in entries)
    rows: list[tuple[Cell, ...]] = []
    for entry in entries:
        times = [_time_to_share(aim, entry, best, share) for share in TARGETS]
        named = (str(entry["name"]), *((aim.label,) if several else ()))
        ends = (float(entry["wall_seconds"]), int(entry["history"][-1]["evaluations"]))
        rows.append((*named, _reached(entry), *times, *ends))
    return rows


def _draw(lines: Any, apart: bool) -> Any:
    from oed.report.figures import panels

    return panels.convergence(lines, apart)
