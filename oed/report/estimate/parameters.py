"""What was estimated, and what it is worth on the road: parameters, nuisance parameters, coefficients."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from oed.foundation.text import (
    MISSING,
    decimals_of,
    nominal_text,
    own_unit,
    significant,
    size_text,
    to_error,
    words,
)
from oed.records.stored.estimate import Estimated, EstimateRecord, FoundNoise, Unknown
from oed.report.estimate.fit import segment_text
from oed.report.estimate.gist import gains, notes, warnings
from oed.report.estimate.logs import MOST_ROWS, clock_label, clocks, offset_clocks
from oed.report.estimate.models import model_lines
from oed.report.parts.prose import Prose
from oed.report.parts.section import Cell, Column, Section, Table, estimated, lasting, span_text

SAY = Prose("estimate/parameters")
PLACES = {
    "sensor_x": "pose sensor ahead of the robot's origin",
    "sensor_y": "pose sensor to the left of it",
    "sensor_heading": "pose sensor turned to the left",
}
"""Coordinates of the sensor in words."""
WORTH_A_LINE = 0.02
"""Offset of two clocks that is worth a line in a terminal [s]."""
DRIFT = {None: "", True: "; longer ones drift", False: "; no drift found"}
"""What is said of segments that drift, or do not."""


def summary(record: EstimateRecord) -> Section:
    """The estimates with their errors; warnings first."""
    origin = SAY("origin", record, lasting(sum(log.seconds or 0.0 for log in record.logs)))
    outside = [one.name for one in record.parameters if one.nominal_outside]
    said = (origin, " ".join(gains(record)), SAY("nominal", outside, len(record.parameters)))
    return Section.of("Summary", *said, estimates(record), notices=(*warnings(record), *notes(record)))


def estimates(record: EstimateRecord) -> Table:
    """Every parameter with its nominal value, estimate, error, interval and change."""
    unit, value, error = estimated()
    columns = (
        Column("parameter", cell=lambda one: words(one.name)),
        unit,
        Column("nominal", "", significant(5), _nominal),
        value,
        error,
        Column("95 % interval", "", significant(5), _interval),
        Column("change", "% of nominal", significant(3), _change),
    )
    return Table.of(record.parameters, columns, "Estimates, rounded to their errors' second digit")


def _nominal(one: Estimated) -> str:
    return MISSING if one.nominal is None else nominal_text(one.nominal * own_unit(one.unit)[1])


def _interval(one: Estimated) -> str:
    return span_text(*one.ends, one.standard_error, own_unit(one.unit)[1])


def _change(one: Estimated) -> str:
    if one.value is None or not one.nominal:
        return MISSING
    percent, error = 100.0 / abs(one.nominal), one.standard_error
    rounded = decimals_of(None if error is None else error * percent) is not None
    change = one.value - one.nominal
    text = to_error(change, error, percent) if rounded else significant(3)(percent * change)
    return text if text.startswith("-") or not change else f"+{text}"


def estimate_rows(record: EstimateRecord) -> list[list[str]]:
    """The table of estimates for a terminal."""
    return [[cell.replace(MISSING, "-") for cell in row] for row in estimates(record).cells]


def estimate_lines(record: EstimateRecord) -> list[str]:
    """For a terminal: what the errors rest on, clocks, dead reckoning, models compared, warnings."""
    drift = DRIFT[record.segments.drifts if record.segments else None]
    offset = offset_clocks(record, WORTH_A_LINE)
    return [
        f"standard errors: {record.covariance_kind}, from {segment_text(record)}{drift}",
        *([f"wheels' clock ahead of the poses': {offset}"] if offset else []),
        *gains(record),
        *model_lines(record),
        *(f"warning: {text}" for text in warnings(record)),
        *(f"note: {text}" for text in notes(record)),
    ]


def nuisances(record: EstimateRecord) -> Section | None:
    """Everything estimated beside the parameters, None where there is nothing."""
    places = (one for one in record.nuisances if one.name != "clock_offset")
    tables = (
        _table("place", places, "Where the pose sensor sits"),
        _clocks(record),
        _noise(record),
        _table("coefficient", record.coefficients, "Coefficients that these give"),
    )
    found = [table for table in tables if table.rows]
    warned = SAY("clocks", offset_clocks(record))
    return Section.of("Nuisance parameters", *found, notices=[warned]) if found else None


def _table(title: str, some: Iterable[Unknown], caption: str) -> Table:
    name = Column(title, cell=lambda one: PLACES.get(one.name, words(one.name)))
    return Table.of(some, (name, *estimated()), caption)


def _clocks(record: EstimateRecord) -> Table:
    every, caption = clocks(record), "How far the wheels' clock is ahead of the poses'"
    more = len(every) - MOST_ROWS
    if more > 0:
        every = sorted(every, key=lambda one: -abs(one.value or 0.0))[:MOST_ROWS]
        caption += ", the largest first"
    table = Table.of(every, (Column("log", cell=lambda one: clock_label(record, one)), *estimated()), caption)
    return table if more <= 0 else replace(table, rows=(*table.rows, (f"and {more} more", "", "", "")))


def _noise(record: EstimateRecord) -> Table:
    def at_rest(one: FoundNoise) -> Cell:
        return None if one.at_rest is None else size_text(one.at_rest, one.unit or "")

    def growth(name: str, per: str) -> Callable[[FoundNoise], str]:
        def text(one: FoundNoise) -> str:
            size = getattr(one, name)
            return f"{size_text(size, one.unit or '')} per {per}" if size else "none found"

        return text

    columns = (
        Column("readings", cell=lambda one: words(one.about)),
        Column("at rest", "", significant(3), at_rest),
        Column("growth with speed", "", significant(3), growth("per_speed", "m/s")),
        Column("growth with yaw rate", "", significant(3), growth("per_yaw_rate", "rad/s")),
    )
    return Table.of(record.noise, columns, "Noise of the poses")
