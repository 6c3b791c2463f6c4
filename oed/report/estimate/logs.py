"""The logs, what was found in them, and their clocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

from oed.foundation.text import fixed, in_signs, listing, whole, words
from oed.records.stored.estimate import EstimateRecord, Finding, ReadLog, Unknown
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table, scaled, sized

MOST_ROWS = 15
"""Rows of a table beyond which the others share one."""
CLOCKS_APART = 0.1
"""Offset of two clocks that is worth a warning [s]."""
NAMED = 3
"""How many clocks a sentence names before it counts the others."""


@dataclass(frozen=True)
class LogFinding:
    """A finding, and the name of its log."""

    log: str
    finding: Finding


def findings(record: EstimateRecord) -> dict[tuple[str, bool], list[LogFinding]]:
    """Findings by kind and doubtfulness, the doubtful ones first."""
    groups: dict[tuple[str, bool], list[LogFinding]] = {}
    for log in record.logs:
        for one in log.findings:
            groups.setdefault((one.name, bool(one.doubtful)), []).append(LogFinding(log.name, one))
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
    shown = [f"{label} {1e3 * value:+.0f} ms" for label, value in far[:NAMED]]
    return listing([*shown, f"{len(far) - NAMED} more"] if len(far) > NAMED else shown)


def logs(record: EstimateRecord) -> Section | None:
    """Tables of logs and of findings, grouped by kind."""
    if not record.logs:
        return None
    tables = (_table(record), _findings(record))
    return Section("Logs", tables=tuple(table for table in tables if table.rows))


def _table(record: EstimateRecord) -> Table:
    clock, factor = sized("clock offset", [log.clock_offset for log in record.logs], "s")
    timed = bool(clocks(record))
    numbered = list(enumerate(record.logs, 1))
    if len(numbered) > MOST_ROWS:
        # Doubtful ones first; the order is otherwise kept.
        numbered = sorted(numbered, key=lambda pair: not pair[1].doubtful)
    shown, rest = numbered[:MOST_ROWS], [log for _, log in numbered[MOST_ROWS:]]
    rows: list[tuple[Cell, ...]] = []
    for number, log in shown:
        offset = (scaled(log.clock_offset, factor),) if timed else ()
        rows.append((float(number), log.name, *_sizes([log]), *offset, _named(log)))
    if rest:
        rows.append(("", f"and {len(rest)} more", *_sizes(rest), *([""] if timed else []), ""))
    columns = (
        Column("no.", "", whole),
        Column("log"),
        Column("duration", "s", fixed(1)),
        Column("poses", "", whole),
        *((clock,) if timed else ()),
        Column("findings"),
    )
    return Table(columns, tuple(rows), "Logs that the estimate rests on")


def _sizes(some: Sequence[ReadLog]) -> tuple[Cell, Cell]:
    # Duration [s] and number of poses, in all.
    return sum(log.seconds or 0.0 for log in some), float(sum(log.poses or 0 for log in some))


def _named(log: ReadLog) -> str:
    return ", ".join(dict.fromkeys(words(one.name) for one in log.findings)) or "none"


def _findings(record: EstimateRecord) -> Table:
    groups = findings(record)
    columns = (Column("finding"), Column("logs", "", whole), Column("doubtful"), Column("in words"))
    rows = []
    for (name, doubtful), group in groups.items():
        count, message = len({one.log for one in group}), in_signs(group[0].finding.message)
        alone = len(groups) == 1 and count == 1
        text = message if alone else f"{group[0].log}: {message}"
        rows.append((words(name), float(count), doubtful, text))
    return Table(columns, tuple(rows), "What was found in the logs, by kind, each with its first instance")
