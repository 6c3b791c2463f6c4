"""Dead reckoning before and after: paths, errors over time, and of logs that the estimate does not know."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from oed.foundation.text import count, own_unit, significant, size_text, to_error, unit_text, words
from oed.records.stored.estimate import Estimated, EstimateRecord
from oed.records.stored.reckoned import Reckoned, ReckonedPath, UnseenLogs
from oed.report.estimate.logs import MOST_ROWS
from oed.report.figures import reckoned as figures
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
EVO = (
    ("APE, position, aligned at the start", "rmse_position", "m"),
    ("APE, position, aligned by least squares", "rmse_aligned", "m"),
    ("APE, heading, aligned at the start", "rmse_heading", "rad"),
    ("RPE over 1 m, position", "drift_position", "m"),
    ("RPE over 1 m, heading", "drift_heading", "rad"),
)
"""The same errors by the names that evo has for them, with unit."""
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


def drawn_paths(record: EstimateRecord) -> list[ReckonedPath]:
    """Paths of logs that the estimate does not know, else of its own; [] where there are no positions."""
    return [one for one in record.paths if one.drawable][:MOST_PATHS]


def path_picture(record: EstimateRecord) -> Picture | None:
    """The reference beside dead reckoning before and after; None where there are no positions."""
    drawn = drawn_paths(record)
    if not drawn:
        return None
    alt = "Driven paths beside dead reckoning with nominal and with estimated parameters"
    return Picture("estimate_paths", alt, SAY("paths", _roles(drawn)), figures.paths(drawn))


def errors_over_time(record: EstimateRecord) -> Section | None:
    """Errors of position and heading over time, and their sizes as evo has them; None without positions."""
    timed = [one for one in drawn_paths(record) if one.t]
    picture = None
    if timed:
        alt = "Errors of position and heading over time, with nominal and with estimated parameters"
        shown = timed[: figures.MOST_LOGS]
        caption = SAY("over_time", _roles(shown), any(one.heading_errors for one in shown))
        picture = Picture("estimate_errors", alt, caption, figures.errors(shown))
    table = _evo(record)
    if picture is None and table is None:
        return None
    made = Section.of("Error over time", SAY("definitions") if table else "", picture, table)
    return replace(made, brief=(0, 1))


def reckoned(record: EstimateRecord) -> tuple[str, list[Run]]:
    """The logs that say most of dead reckoning, in words and one by one: those the estimate does not know."""
    fitted = [
        Run(one.log, one.before, one.after)
        for one in record.paths
        if one.role == "fitted" and one.before is not None and one.after is not None
    ]
    test, folds = tested(record.test_set), folds_of(record)
    runs = test or folds or fitted
    return SAY("of", ["held out" if test else "left out" if folds else "fitted"], len(runs)), runs


def _evo(record: EstimateRecord) -> Table | None:
    which, runs = reckoned(record)
    known = [(name, pair, unit) for name, key, unit in EVO if (pair := means(runs, key)) is not None]
    if not known:
        return None
    columns = (
        Column("root mean square error", cell=lambda item: item[0]),
        Column("nominal", "", significant(3), lambda item: size_text(item[1][0], item[2])),
        Column("estimated", "", significant(3), lambda item: size_text(item[1][1], item[2])),
    )
    return Table.of(known, columns, SAY("whose", which, len(runs)))


def _roles(drawn: Sequence[ReckonedPath]) -> list[str]:
    return sorted({str(one.role) for one in drawn})
