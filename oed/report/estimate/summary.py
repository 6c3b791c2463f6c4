"""What was estimated, from which logs, and what it is worth on the road."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oed.foundation.text import count, listing, significant, unit_text, words
from oed.report.estimate.gist import gains, notes, warnings
from oed.report.estimate.numbers import (
    decimals_of,
    error_text,
    known,
    lasting,
    own_unit,
    plain,
    span_text,
    to_error,
)
from oed.report.estimate.reading import Data, entries, held_out_runs, logs_text, robot_text
from oed.report.parts.section import Section
from oed.report.parts.tables import MISSING, Cell, Column, Table

METHODS = {
    "joint": "by nonlinear least squares on all poses together",
    "gls": "by generalised least squares on the motion between poses",
    "two_stage": "in two stages, first from the headings, then from the positions",
}
"""Method -> what it does."""
NAMED = 4
"""Logs that are all named."""


def summary(data: Data) -> Section:
    """The estimates with their errors; warnings first."""
    return Section(
        "Summary",
        notices=(*warnings(data), *notes(data)),
        paragraphs=tuple(filter(None, (_logs(data), " ".join(gains(data)), _changed(data)))),
        tables=(estimates(data),),
    )


def _logs(data: Data) -> str:
    logs, apart = entries(data, "logs"), [run.log for run in held_out_runs(data)]
    seconds = sum(known(log.get("seconds")) or 0.0 for log in logs)
    poses = sum(int(log.get("poses") or 0) for log in logs)
    method = METHODS.get(str(data.get("method")), words(str(data.get("method", ""))))
    names = [words(str(one["name"])) for one in entries(data, "parameters")]
    verb = "is" if len(apart) == 1 else "are"
    kept = (
        f" {count(len(apart), 'more log')}{_named(apart)} {verb} kept apart to try this on." if apart else ""
    )
    return (
        f"{listing(names).capitalize()} of this {robot_text(data)} robot, estimated {method}, from "
        f"{logs_text(data)}{_named([str(log['name']) for log in logs])}: "
        f"{lasting(seconds)}, {count(poses, 'pose')}.{kept}"
    )


def _named(names: list[str]) -> str:
    return f" ({', '.join(names)})" if len(names) <= NAMED else f" ({names[0]} to {names[-1]})"


def _changed(data: Data) -> str:
    parameters = entries(data, "parameters")
    outside = [words(str(one["name"])) for one in parameters if _outside(one)]
    if not outside:
        return "All nominal values lie within the 95 % intervals of their estimates."
    if len(outside) == len(parameters) > 1:
        return "No nominal value lies within its estimate's 95 % interval."
    values, verb = ("values", "lie") if len(outside) > 1 else ("value", "lies")
    return f"The nominal {values} of {listing(outside)} {verb} outside of the 95 % interval."


def _outside(one: Mapping[str, Any]) -> bool:
    low, high = (known(end) for end in one.get("interval") or (None, None))
    nominal = known(one.get("nominal"))
    return None not in (low, high, nominal) and not low <= nominal <= high  # type: ignore[operator]


def estimates(data: Data) -> Table:
    """Every parameter with its nominal value, estimate, error, interval and change."""
    columns = (
        Column("parameter"),
        Column("unit"),
        Column("nominal", "", significant(5)),
        Column("estimate", "", significant(5)),
        Column("± standard error", "", significant(2)),
        Column("95 % interval", "", significant(5)),
        Column("change", "% of nominal", significant(3)),
    )
    rows = tuple(estimate_cells(one) for one in entries(data, "parameters"))
    return Table(columns, rows, "Estimates, rounded to their errors' second digit")


def estimate_cells(one: Mapping[str, Any]) -> tuple[Cell, ...]:
    """A parameter's name, unit, nominal value, estimate, error, interval and change [%], as text."""
    unit, factor = own_unit(str(one.get("unit") or ""))
    value, error, nominal = (known(one.get(key)) for key in ("value", "standard_error", "nominal"))
    low, high = (known(end) for end in one.get("interval") or (None, None))
    return (
        words(str(one["name"])),
        unit_text(unit) or "1",
        plain(nominal, factor),
        to_error(value, error, factor),
        error_text(error, factor),
        span_text(low, high, error, factor),
        _change(value, error, nominal),
    )


def _change(value: float | None, error: float | None, nominal: float | None) -> str:
    if value is None or not nominal:
        return MISSING
    percent = 100.0 / abs(nominal)
    told = decimals_of(None if error is None else error * percent) is not None
    text = to_error(value - nominal, error, percent) if told else significant(3)(percent * (value - nominal))
    return text if text.startswith("-") or value == nominal else f"+{text}"
