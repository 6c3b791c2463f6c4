"""The logs, what was found in them, and their clocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import PurePath
from typing import Any

from oed.foundation.text import fixed, in_signs, listing, own_unit, whole, words
from oed.records.stored.estimate import EstimateRecord, Finding, ReadLog, Unknown
from oed.report.parts.section import Cell, Column, Section, Table, sized

MOST_ROWS = 15
"""Rows of a table beyond which the others share one."""
CLOCKS_APART = 0.1
"""Offset of two clocks that is worth a warning [s]."""
NAMED = 3
"""How many clocks a sentence names before it counts the others."""


def findings(record: EstimateRecord) -> dict[tuple[str, bool], list[tuple[str, Finding]]]:
    """Findings, each with its log's name, by kind and doubtfulness, the doubtful ones first."""
    groups: dict[tuple[str, bool], list[tuple[str, Finding]]] = {}
    for log in record.logs:
        for one in log.findings:
            groups.setdefault((one.name, bool(one.doubtful)), []).append((log.name, one))
    return dict(sorted(groups.items(), key=lambda item: not item[0][1]))


def clocks(record: EstimateRecord) -> list[Unknown]:
    """The clock offsets that were estimated, one a file."""
    return [one for one in record.nuisances if one.name == "clock_offset"]


def clock_label(record: EstimateRecord, clock: Unknown) -> str:
    """What a clock's offset belongs to: the log, or the file where that holds several."""
    names = [log.name for log in record.logs if log.file == (clock.file or "")]
    return names[0] if len(names) == 1 else PurePath(clock.file or "").name or "all logs"


def offset_clocks(record: EstimateRecord, beyond: float = CLOCKS_APART) -> str:
    """Which clocks are further apart than `beyond` [s], in words; nothing where none is."""
    sizes = [(clock_label(record, one), one.value or 0.0) for one in clocks(record)]
    far = sorted((one for one in sizes if abs(one[1]) > beyond), key=lambda one: -abs(one[1]))
    unit, factor = own_unit("s")
    shown = [f"{label} {factor * value:+.0f} {unit}" for label, value in far[:NAMED]]
    return listing([*shown, f"{len(far) - NAMED} more"] if len(far) > NAMED else shown)


def logs(record: EstimateRecord) -> Section | None:
    """Tables of logs and of findings, grouped by kind."""
    tables = [table for table in (_table(record), _findings(record)) if table.rows]
    return Section.of("Logs", *tables) if record.logs else None


def _table(record: EstimateRecord) -> Table:
    items = [(str(number), log.name, [log]) for number, log in enumerate(record.logs, 1)]
    if len(items) > MOST_ROWS:
        # Doubtful ones first; the order is otherwise kept.
        items.sort(key=lambda item: not item[2][0].doubtful)
        rest = [log for _, _, logs in items[MOST_ROWS:] for log in logs]
        items[MOST_ROWS:] = [("", f"and {len(rest)} more", rest)]

    def alone(say: Callable[[ReadLog], Cell]) -> Callable[[Any], Cell]:
        # What is said of a log, but not of several in one row.
        return lambda item: say(item[2][0]) if item[0] else ""

    offsets = [log.clock_offset for log in record.logs]
    columns = (
        Column("no.", "", whole, lambda item: item[0]),
        Column("log", cell=lambda item: item[1]),
        Column("duration", "s", fixed(1), lambda item: sum(log.seconds or 0.0 for log in item[2])),
        Column("poses", "", whole, lambda item: float(sum(log.poses or 0 for log in item[2]))),
        sized("clock offset", "s", offsets, alone(lambda log: log.clock_offset)) if clocks(record) else None,
        Column("findings", cell=alone(_named)),
    )
    return Table.of(items, columns, "Logs that the estimate rests on")


def _named(log: ReadLog) -> str:
    return ", ".join(dict.fromkeys(words(one.name) for one in log.findings)) or "none"


def _findings(record: EstimateRecord) -> Table:
    groups = list(findings(record).values())

    def count(group: Sequence[tuple[str, Finding]]) -> float:
        return float(len({log for log, _ in group}))

    def text(group: Sequence[tuple[str, Finding]]) -> str:
        log, first = group[0]
        alone = len(groups) == 1 and count(group) == 1
        return in_signs(first.message) if alone else f"{log}: {in_signs(first.message)}"

    columns = (
        Column("finding", cell=lambda group: words(group[0][1].name)),
        Column("logs", "", whole, count),
        Column("doubtful", cell=lambda group: bool(group[0][1].doubtful)),
        Column("in words", cell=text),
    )
    return Table.of(groups, columns, "What was found in the logs, by kind, each with its first instance")
