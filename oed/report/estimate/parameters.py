"""What was estimated, and what it is worth on the road: parameters, nuisance parameters, coefficients."""

from __future__ import annotations

from collections.abc import Iterable

from oed.foundation.text import (
    MISSING,
    decimals_of,
    error_text,
    nominal_text,
    own_unit,
    quantity,
    shown_unit,
    significant,
    to_error,
    unit_for,
    words,
)
from oed.records.stored.estimate import Estimated, EstimateRecord, FoundNoise, Unknown
from oed.report.estimate.gist import gains, notes, warnings
from oed.report.estimate.logs import MOST_ROWS, clock_label, clocks, offset_clocks
from oed.report.parts.prose import Prose
from oed.report.parts.section import Section
from oed.report.parts.tables import Cell, Column, Table, lasting, span_text

SAY = Prose("estimate/parameters")
PLACES = {
    "sensor_x": "pose sensor ahead of the robot's origin",
    "sensor_y": "pose sensor to the left of it",
    "sensor_heading": "pose sensor turned to the left",
}
"""Coordinates of the sensor in words."""
ESTIMATED = (
    Column("unit"),
    Column("estimate", "", significant(4)),
    Column("± standard error", "", significant(2)),
)


def summary(record: EstimateRecord) -> Section:
    """The estimates with their errors; warnings first."""
    parameters, logs, tested = record.parameters, record.logs, record.test_set
    origin = SAY(
        "origin",
        [one.name for one in parameters],
        record.robot,
        record.method or "",
        [log.name for log in logs],
        lasting(sum(log.seconds or 0.0 for log in logs)),
        sum(log.poses or 0 for log in logs),
        [] if tested is None else tested.logs,
    )
    outside = [one.name for one in parameters if one.nominal_outside]
    return Section(
        "Summary",
        notices=(*warnings(record), *notes(record)),
        paragraphs=tuple(
            filter(None, (origin, " ".join(gains(record)), SAY("nominal", outside, len(parameters))))
        ),
        tables=(estimates(record),),
    )


def estimates(record: EstimateRecord) -> Table:
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
    rows = tuple(estimate_cells(one) for one in record.parameters)
    return Table(columns, rows, "Estimates, rounded to their errors' second digit")


def estimate_cells(one: Estimated) -> tuple[str, ...]:
    """A parameter's name, unit, nominal value, estimate, error, interval and change [%], as text."""
    factor, error = own_unit(one.unit)[1], one.standard_error
    return (
        words(one.name),
        shown_unit(one.unit),
        MISSING if one.nominal is None else nominal_text(one.nominal * factor),
        to_error(one.value, error, factor),
        error_text(error, factor),
        span_text(*one.ends, error, factor),
        _change(one.value, error, one.nominal),
    )


def _change(value: float | None, error: float | None, nominal: float | None) -> str:
    if value is None or not nominal:
        return MISSING
    percent = 100.0 / abs(nominal)
    rounded = decimals_of(None if error is None else error * percent) is not None
    change = value - nominal
    text = to_error(change, error, percent) if rounded else significant(3)(percent * change)
    return text if text.startswith("-") or not change else f"+{text}"


def nuisances(record: EstimateRecord) -> Section | None:
    """Everything estimated beside the parameters, None where there is nothing."""
    tables = (_places(record), _clocks(record), _noise(record), _coefficients(record))
    found = tuple(table for table in tables if table.rows)
    if not found:
        return None
    warned = tuple(filter(None, [SAY("clocks", offset_clocks(record))]))
    return Section("Nuisance parameters", notices=warned, tables=found)


def _estimated(title: str, one: Unknown) -> tuple[str, ...]:
    factor, error = own_unit(one.unit)[1], one.standard_error
    return title, shown_unit(one.unit), to_error(one.value, error, factor), error_text(error, factor)


def _table(title: str, rows: Iterable[tuple[Cell, ...]], caption: str) -> Table:
    return Table((Column(title), *ESTIMATED), tuple(rows), caption)


def _places(record: EstimateRecord) -> Table:
    places = (one for one in record.nuisances if one.name != "clock_offset")
    rows = (_estimated(PLACES.get(one.name, words(one.name)), one) for one in places)
    return _table("place", rows, "Where the pose sensor sits")


def _clocks(record: EstimateRecord) -> Table:
    every, caption = clocks(record), "How far the wheels' clock is ahead of the poses'"
    if len(every) > MOST_ROWS:
        every = sorted(every, key=lambda one: -abs(one.value or 0.0))
        caption += ", the largest first"
    rows = [_estimated(clock_label(record, one), one) for one in every[:MOST_ROWS]]
    if len(every) > MOST_ROWS:
        rows.append((f"and {len(every) - MOST_ROWS} more", "", "", ""))
    return _table("log", rows, caption)


def _coefficients(record: EstimateRecord) -> Table:
    rows = (_estimated(words(one.name), one) for one in record.coefficients)
    return _table("coefficient", rows, "Coefficients that these give")


def _noise(record: EstimateRecord) -> Table:
    columns = ("at rest", "growth with speed", "growth with yaw rate")
    return Table(
        (Column("readings"), *(Column(title, "", significant(3)) for title in columns)),
        tuple(_noise_cells(one) for one in record.noise),
        "Noise of the poses",
    )


def _noise_cells(one: FoundNoise) -> tuple[str, ...]:
    still, factor = unit_for([one.at_rest], one.unit or "")
    return (
        words(one.about),
        MISSING if one.at_rest is None else quantity(one.at_rest * factor, still),
        _growth(one.per_speed, one.unit or "", "m/s"),
        _growth(one.per_yaw_rate, one.unit or "", "rad/s"),
    )


def _growth(growth: float | None, unit: str, per: str) -> str:
    shown, factor = unit_for([growth], unit)
    return quantity(growth * factor, f"{shown} per {per}") if growth else "none found"
