"""The logs, and what was found in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from oed.foundation.text import fixed, whole, words
from oed.report.estimate.gist import findings
from oed.report.estimate.numbers import known, scaled, sized
from oed.report.estimate.reading import MOST_ROWS, Data, clocks, entries, in_signs
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table

Log = Mapping[str, Any]


def logs(data: Data) -> Section | None:
    """Tables of logs and of findings, grouped by kind."""
    every = entries(data, "logs")
    if not every:
        return None
    found = (_table(data, every), _findings(data))
    return Section("Logs", tables=tuple(table for table in found if table is not None))


def _table(data: Data, every: Sequence[Log]) -> Table:
    clock, factor = sized("clock offset", [known(log.get("clock_offset")) for log in every], "s")
    timed = bool(clocks(data))
    columns = (
        Column("no.", "", whole),
        Column("log"),
        Column("duration", "s", fixed(1)),
        Column("poses", "", whole),
        *((clock,) if timed else ()),
        Column("findings"),
    )
    numbered = list(enumerate(every, 1))
    if len(every) > MOST_ROWS:
        # Doubtful ones first; the order is otherwise kept.
        numbered = sorted(numbered, key=lambda pair: not _doubtful(pair[1]))
    rows: list[tuple[Cell, ...]] = []
    for number, log in numbered[:MOST_ROWS]:
        offset = (scaled(known(log.get("clock_offset")), factor),) if timed else ()
        rows.append((float(number), str(log["name"]), *_numbers([log]), *offset, _named(log)))
    rest = [log for _, log in numbered[MOST_ROWS:]]
    if rest:
        blank = ("",) if timed else ()
        rows.append(("", f"and {len(rest)} more", *_numbers(rest), *blank, ""))
    return Table(columns, tuple(rows), "Logs that the estimate rests on")


def _numbers(some: Sequence[Log]) -> tuple[Cell, Cell]:
    seconds = [known(log.get("seconds")) for log in some]
    poses = sum(int(log.get("poses") or 0) for log in some)
    return sum(size for size in seconds if size is not None), float(poses)


def _doubtful(log: Log) -> bool:
    return any(one.get("doubtful") for one in log.get("findings") or [])


def _named(log: Log) -> str:
    found = [words(str(one["name"])) for one in log.get("findings") or []]
    return ", ".join(dict.fromkeys(found)) or "none"


def _findings(data: Data) -> Table | None:
    groups = findings(data)
    columns = (Column("finding"), Column("logs", "", whole), Column("doubtful"), Column("in words"))
    rows = []
    for (name, doubtful), group in groups.items():
        names = {log for log, _ in group}
        log, first = group[0]
        message = in_signs(str(first["message"]))
        text = message if len(groups) == 1 and len(names) == 1 else f"{log}: {message}"
        rows.append((words(name), float(len(names)), doubtful, text))
    caption = "What was found in the logs, by kind, each with its first instance"
    return Table(columns, tuple(rows), caption) if rows else None
