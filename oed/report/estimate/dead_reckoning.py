"""Dead reckoning of logs that the estimate does not know, before and after, and the paths that it gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from oed.foundation.text import count, own_unit, significant, to_error, unit_text, words
from oed.records.stored.estimate import Estimated, EstimateRecord, Reckoned, UnseenLogs
from oed.report.estimate.logs import MOST_ROWS
from oed.report.figures import calibration as figures
from oed.report.parts.prose import Prose
from oed.report.parts.section import Cell, Column, Picture, Section, Table, sized

SAY = Prose("estimate/dead_reckoning")
MEASURES = (
    ("position", "rmse_position", "m"),
    ("heading", "rmse_heading", "rad"),
    ("drift", "drift_position", "m/m"),
    ("turning drift", "drift_heading", "rad/m"),
)
"""Title, name and unit of the errors that are shown before and after."""
MOST_PATHS = 6
"""Paths that are drawn."""


@dataclass(frozen=True)
class Run:
    """Dead reckoning of one log, with nominal and with estimated parameters."""

    log: str
    before: Reckoned
    after: Reckoned

    def pair(self, name: str) -> tuple[float, float] | None:
        """An error before and after; None unless both are known."""
        before, after = getattr(self.before, name), getattr(self.after, name)
        return None if before is None or after is None else (before, after)


def tested(logs: UnseenLogs | None) -> list[Run]:
    """Logs that an estimate does not know, one by one."""
    return [] if logs is None else list(map(Run, logs.logs, logs.before, logs.after))


def folds_of(record: EstimateRecord) -> list[Run]:
    """Every log against the estimate from the others."""
    return [run for fold in record.cross_validation for run in tested(fold)]


def one_by_one(record: EstimateRecord) -> bool:
    """Whether every fold is a single log."""
    return all(len(fold.logs) == 1 for fold in record.cross_validation)


def means(runs: Sequence[Run], name: str) -> tuple[float, float] | None:
    """An error before and after, mean of the runs that have it."""
    pairs = [pair for run in runs if (pair := run.pair(name)) is not None]
    if not pairs:
        return None
    before, after = zip(*pairs, strict=True)
    return sum(before) / len(pairs), sum(after) / len(pairs)


def validation(record: EstimateRecord) -> Section | None:
    """Tables of the test set and of cross-validation; None where there are neither."""
    caption = SAY("folds", len(record.cross_validation), one_by_one(record))
    tables = (
        _errors(tested(record.test_set), "Test set, by the estimate from all other logs"),
        _errors(folds_of(record), caption),
        _parameters(record),
    )
    return Section.of("Cross-validation and test set", SAY("errors"), *tables) if any(tables) else None


def _errors(runs: Sequence[Run], caption: str) -> Table | None:
    known = [one for one in MEASURES if means(runs, one[1]) is not None]
    if not known:
        return None
    shown, rest = _worst_first(runs)
    items: list[tuple[str, Sequence[Run]]] = [(run.log, [run]) for run in shown]
    if rest:
        caption += SAY("worst", len(shown), len(runs))
        items.append((f"and {len(rest)} more, on average", rest))
    if len(runs) > 1:
        items.append((f"mean of all {len(runs)}", runs))
    columns = [
        Column("log", cell=lambda item: item[0]),
        Column("path", "m", significant(3), _mean("length", 0)),
    ]
    for title, key, unit in known:
        both = [value for run in runs for value in run.pair(key) or ()]
        columns += [
            sized(f"{title} {when}", unit, both, _mean(key, at))
            for at, when in enumerate(("before", "after"))
        ]
    return Table.of(items, columns, caption)


def _mean(key: str, at: int) -> Callable[[Any], Cell]:
    # Of a row's runs an error before (0) or after (1).
    return lambda item: (means(item[1], key) or (None, None))[at]


def _worst_first(runs: Sequence[Run]) -> tuple[list[Run], list[Run]]:
    if len(runs) <= MOST_ROWS:
        return list(runs), []
    order = sorted(runs, key=lambda run: -(run.pair("rmse_position") or (0.0, 0.0))[1])
    return order[:MOST_ROWS], order[MOST_ROWS:]


def _parameters(record: EstimateRecord) -> Table | None:
    named = [(_name(fold), _values(fold, record)) for fold in record.cross_validation]
    if not named or not all(values for _, values in named):
        return None
    named.append(("nothing", {one.name: one.value for one in record.parameters}))

    def column(one: Estimated) -> Column:
        unit, factor = own_unit(one.unit)
        estimate = partial(to_error, error=one.standard_error, factor=factor)
        return Column(
            words(one.name), unit_text(unit), significant(5), lambda item: estimate(item[1].get(one.name))
        )

    columns = (Column("left out", cell=lambda item: item[0]), *map(column, record.parameters))
    what = "each log" if one_by_one(record) else "each part of the logs"
    return Table.of(named, columns, f"Estimates without {what} in turn")


def _values(fold: UnseenLogs, record: EstimateRecord) -> Mapping[str, float | None]:
    # By name, or in the order of the parameters where all of the robot's were estimated.
    given = fold.parameters or []
    if isinstance(given, Mapping):
        return given
    names = [one.name for one in record.parameters]
    return dict(zip(names, given, strict=True)) if len(given) == len(names) else {}


def _name(fold: UnseenLogs) -> str:
    names = fold.logs
    return names[0] if len(names) == 1 else f"{names[0]} … {names[-1]} ({count(len(names), 'log')})"


def paths(record: EstimateRecord) -> Section | None:
    """Paths of logs that the estimate does not know, else of its own; None where there are no positions."""
    drawn = [one for one in record.paths if one.drawable][:MOST_PATHS]
    if not drawn:
        return None
    alt = "Driven paths beside dead reckoning with nominal and with estimated parameters"
    roles = sorted({str(one.role) for one in record.paths[: len(drawn)]})
    picture = Picture("estimate_paths", alt, SAY("paths"), figures.paths(drawn))
    return Section.of("Driven paths", SAY("drawn", roles), picture)
