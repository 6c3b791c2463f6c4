"""Times of a log: seconds since some moment, in other units, since 1970, or written as dates."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import FileIssue, LogError
from oed.foundation.quantities import plain_number
from oed.foundation.shown import written
from oed.logs.tables.columns import TIME_UNITS, TimeColumn
from oed.logs.tables.table import Table

SINCE_1970 = (9.8e8, 4.1e9)
"""Seconds since 1970 from 2001 to 2099."""
STEPS = (1e-6, 60.0)
"""Steps between readings [s], by which milliseconds since 1970 are known from other large numbers."""
LIKE = "2024-05-31 14:03:07.25, with a time zone or without (ISO 8601)"
_ZONE = re.compile(r"\s*(UTC|GMT|Z)$", re.IGNORECASE)
_DATE = re.compile(r"\d[-./: ]+\w+[-./: ]+\d")
"""Dates and times of day in any form have three parts."""
_BLANK = re.compile(r"\s+(?=[+-]\d\d:?\d\d$)")


def read_times(table: Table, place: int, column: TimeColumn, *, skip: bool = False) -> Array:
    """A column of times (rows,) [s], not-a-number in empty cells.

    Dates without a time zone are taken for UTC: they differ by the same from each other.

    Args:
        table: of the log.
        place: of the column in it.
        column: what the study says of it.
        skip: whether some cells may be no times.

    Raises:
        LogError: cells that are no times, or not as the others are.
    """
    values, issues = table.numbers(place)
    if not issues and column.form != "date":
        return seconds(values, column.unit)
    cells = table.texts(place)
    number = [column.form != "date" and plain_number(cell) is not None for cell in cells]
    moments = [None if known else _moment(cell) for known, cell in zip(number, cells, strict=True)]
    dated, filled = sum(map(bool, moments)), sum(map(bool, cells))
    odd = [row for row, cell in enumerate(cells) if cell and not moments[row] and not number[row]]
    likely = column.form == "date" or (column.form is None and odd and _DATE.search(cells[odd[0]]))
    if likely and 1 < len(odd) > filled / 2:
        # One issue is enough where they all are in another form.
        got = f"got {len(odd)} that are none, such as {written(cells[odd[0]])}: write them so"
        text = f"expected dates and times as {LIKE}, {got}, or as seconds"
        raise LogError([_issue(table, odd[0], place, text)])
    if column.form == "number" or (column.form is None and 2 * dated < filled):
        return seconds(table.finite(place, skip), column.unit)
    wrong = {
        row: f"expected a date and time as {LIKE}, got {written(cell)}"
        for row, (cell, moment) in enumerate(zip(cells, moments, strict=True))
        if cell and moment is None
    } | _of_two_kinds(moments)
    if wrong and (not skip or len(wrong) == filled):
        raise LogError([_issue(table, row, place, wrong[row]) for row in sorted(wrong)])
    known = [None if row in wrong else moment for row, moment in enumerate(moments)]
    return np.array([math.nan if moment is None else _seconds(moment) for moment in known])


def seconds(values: Array, unit: str | None) -> Array:
    """Numbers as seconds: in a unit, or in the one since 1970 in which they are from this century."""
    if unit is not None:
        return TIME_UNITS[unit] * values
    known = values[~np.isnan(values)]
    usual = float(np.median(known)) if len(known) else 0.0
    step = float(np.median(np.abs(np.diff(known)))) if len(known) > 1 else 0.0
    for factor in TIME_UNITS.values():
        low, high = SINCE_1970
        if low <= factor * usual <= high and (factor == 1.0 or STEPS[0] < factor * step < STEPS[1]):
            return factor * values
    return values


def _moment(cell: str) -> datetime | None:
    text = _BLANK.sub("", _ZONE.sub("+00:00", cell)).replace("/", "-")
    try:
        return datetime.fromisoformat(text) if cell else None
    except ValueError:
        return None


def _seconds(moment: datetime) -> float:
    return (moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp()


def _of_two_kinds(moments: Sequence[datetime | None]) -> dict[int, str]:
    # Without its time zone a date may be hours off those that have one.
    bare = [row for row, moment in enumerate(moments) if moment is not None and moment.tzinfo is None]
    zoned = [row for row, moment in enumerate(moments) if moment is not None and moment.tzinfo is not None]
    if not (bare and zoned):
        return {}
    if len(bare) <= len(zoned):
        return dict.fromkeys(bare, "lacks the time zone that other rows have")
    return dict.fromkeys(zoned, "has a time zone, which other rows lack")


def _issue(table: Table, row: int, place: int, text: str) -> FileIssue:
    return FileIssue(table.file, int(table.lines[row]), place + 1, table.label(place), text)
