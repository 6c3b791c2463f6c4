"""Dead reckoning of logs that the estimate did not know, before and after, and what others estimate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from oed.foundation.text import count, significant, unit_text, words
from oed.report.estimate.numbers import known, scaled, sized, to_error
from oed.report.estimate.reading import (
    MOST_ROWS,
    Data,
    Run,
    entries,
    errors,
    held_out_runs,
    left_out_runs,
    means,
    units,
)
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table

MEASURES = (
    ("position", "rmse_position", "m"),
    ("heading", "rmse_heading", "rad"),
    ("drift", "drift_position", "m/m"),
    ("turning drift", "drift_heading", "rad/m"),
)
"""Title, name and unit of the numbers that are told before and after."""


def left_out(data: Data) -> Section | None:
    """Tables of logs kept apart and left out; None where there are neither."""
    apart, left = held_out_runs(data), left_out_runs(data)
    tables = (
        _table(apart, "Logs kept apart, by the estimate from all others"),
        _table(left, _caption(data)),
        _parameters(data),
    )
    found = tuple(table for table in tables if table is not None)
    if not found:
        return None
    return Section("Logs that the estimate did not know", paragraphs=(_explained(),), tables=found)


def _explained() -> str:
    return (
        "Position and heading: root mean square errors along a log of dead reckoning that starts on its "
        "first pose. Drift and turning drift: the same over every metre of path by itself. Before: with "
        "nominal parameters; after: with estimated ones."
    )


def _caption(data: Data) -> str:
    if _one_by_one(data):
        return "Each log by the estimate from the others"
    parts = len(entries(data, "left_out"))
    return f"Each log by an estimate that does not know it ({parts} parts left out in turn)"


def _one_by_one(data: Data) -> bool:
    return all(len(fold["logs"]) == 1 for fold in entries(data, "left_out"))


def _table(runs: Sequence[Run], caption: str) -> Table | None:
    told = [one for one in MEASURES if means(runs, one[1]) is not None]
    if not told:
        return None
    shown, rest = _worst_first(runs)
    scales = [sized(title, _both(runs, key), unit) for title, key, unit in told]
    length = Column("path", "m", significant(3))
    columns = [Column("log"), length]
    for column, _ in scales:
        columns += [
            Column(f"{column.title} {when}", column.unit, column.form) for when in ("before", "after")
        ]
    keys, factors = [key for _, key, _ in told], [factor for _, factor in scales]
    rows = [_row(run.log, [run], keys, factors) for run in shown]
    if rest:
        caption += f"; the {len(shown)} with the largest errors after, of {len(runs)}"
        rows.append(_row(f"and {len(rest)} more, on average", rest, keys, factors))
    if len(runs) > 1:
        rows.append(_row(f"mean of all {len(runs)}", runs, keys, factors))
    return Table(tuple(columns), tuple(rows), caption)


def _both(runs: Sequence[Run], key: str) -> list[float | None]:
    return [value for run in runs for value in run.pair(key) or ()]


def _worst_first(runs: Sequence[Run]) -> tuple[list[Run], list[Run]]:
    if len(runs) <= MOST_ROWS:
        return list(runs), []
    order = sorted(runs, key=lambda run: -(run.pair("rmse_position") or (0.0, 0.0))[1])
    return order[:MOST_ROWS], order[MOST_ROWS:]


def _row(name: str, runs: Sequence[Run], keys: Sequence[str], factors: Sequence[float]) -> tuple[Cell, ...]:
    cells: list[Cell] = []
    for key, factor in zip(keys, factors, strict=True):
        before, after = means(runs, key) or (None, None)
        cells += [scaled(before, factor), scaled(after, factor)]
    length = means(runs, "length")
    return name, None if length is None else length[0], *cells


def _parameters(data: Data) -> Table | None:
    folds, shown = entries(data, "left_out"), units(data)
    named = [(fold, _values(fold, list(shown))) for fold in folds]
    if not named or not all(values for _, values in named):
        return None
    columns = [Column("left out")]
    columns += [Column(words(name), unit_text(unit), significant(5)) for name, (unit, _) in shown.items()]
    every = entries(data, "parameters")
    whole = {str(one["name"]): known(one.get("value")) for one in every}
    rows = [(_fold_name(fold), *_cells(data, values)) for fold, values in named]
    rows.append(("nothing", *_cells(data, whole)))
    what = "each log" if _one_by_one(data) else "each part of the logs"
    return Table(tuple(columns), tuple(rows), f"Estimates without {what} in turn")


def _values(fold: Mapping[str, Any], names: Sequence[str]) -> dict[str, float | None]:
    # By name, or in the order of the parameters where all of the robot's were estimated.
    given = fold.get("parameters") or []
    if isinstance(given, Mapping):
        return {name: known(given.get(name)) for name in names}
    return dict(zip(names, map(known, given), strict=True)) if len(given) == len(names) else {}


def _cells(data: Data, values: Mapping[str, float | None]) -> list[Cell]:
    sizes, shown = errors(data), units(data)
    return [to_error(values.get(name), sizes[name], factor) for name, (_, factor) in shown.items()]


def _fold_name(fold: Mapping[str, Any]) -> str:
    names = [str(name) for name in fold["logs"]]
    return names[0] if len(names) == 1 else f"{names[0]} … {names[-1]} ({count(len(names), 'log')})"
