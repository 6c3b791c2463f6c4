"""How fast each search found what it found."""

from __future__ import annotations

from functools import partial
from typing import Any

from oed.record import Record
from oed.report.reading import Entry
from oed.report.section import Picture, Section
from oed.report.tables import Cell, Column, Table, significant, whole
from oed.report.wording import listing, quantity

TARGETS = (0.9, 0.99, 0.999)
"""Shares of the best objective whose times are listed."""
FLOOR = 1e-4
"""Shortfall [%] below which a search counts as level with the best."""


def convergence(record: Record) -> Section | None:
    """Best objective so far against time, and the time each search took to given targets."""
    searches = [entry for entry in record.results if entry.get("history")]
    if not searches:
        return None
    best = max(_reached(entry) for entry in searches)
    lines = [(str(entry["name"]), _line(entry, best)) for entry in searches]
    caption = (
        "Best objective so far below the best of all searches, re-scored on the fine grid, against the "
        f"search's own time on one machine. Below {FLOOR:g} % it is drawn at that level. A search that "
        "settles among equal optima gives up a little of its objective afterwards; that is not drawn."
    )
    alt = f"Convergence of {listing([name for name, _ in lines])} over time"
    picture = Picture("convergence", alt, caption, partial(_draw, lines))
    return Section(
        "Convergence",
        paragraphs=tuple(_race(entry, searches) for entry in searches if entry["kind"] != "ipopt"),
        figures=(picture,),
        tables=(_table(searches, best),),
    )


def _reached(entry: Entry) -> float:
    return max(float(point["objective"]) for point in entry["history"])


def time_to(entry: Entry, objective: float) -> tuple[float, int] | None:
    """Seconds and evaluations after which a search had reached `objective`; None if it never did."""
    for point in entry["history"]:
        if point["objective"] >= objective:
            return float(point["seconds"]), int(point["evaluations"])
    return None


def _line(entry: Entry, best: float) -> list[tuple[float, float]]:
    # (seconds, shortfall in percent), one point each time the objective rose.
    return [
        (float(point["seconds"]), max(FLOOR, 100.0 * (best - point["objective"]) / abs(best)))
        for point in entry["history"]
    ]


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


def _table(searches: list[Entry], best: float) -> Table:
    columns = [Column("result"), Column("best objective", "", significant(6))]
    columns += [Column(f"time to {100 * share:g} %", "s", significant(3)) for share in TARGETS]
    columns += [Column("whole search", "s", significant(3)), Column("evaluations", "", whole)]
    rows = tuple(_row(entry, best) for entry in searches)
    caption = "Times to shares of the best objective of all searches; – where it was not reached"
    return Table(tuple(columns), rows, caption)


def _row(entry: Entry, best: float) -> tuple[Cell, ...]:
    hits = [time_to(entry, share * best) for share in TARGETS]
    times = [None if hit is None else hit[0] for hit in hits]
    ends = (float(entry["wall_seconds"]), int(entry["history"][-1]["evaluations"]))
    return (str(entry["name"]), _reached(entry), *times, *ends)


def _draw(lines: Any) -> Any:
    from oed.report import panels

    return panels.convergence(lines)
