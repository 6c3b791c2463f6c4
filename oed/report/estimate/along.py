"""What was estimated along with the parameters: coefficients, the sensor's place, clocks, noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oed.foundation.text import quantity, significant, unit_text, words
from oed.report.estimate.gist import offset_clocks
from oed.report.estimate.numbers import error_text, known, own_unit, to_error, unit_for
from oed.report.estimate.reading import MOST_ROWS, Data, clock_label, clocks, entries
from oed.report.parts.section import Section
from oed.report.parts.tables import MISSING, Cell, Column, Table

PLACES = {
    "sensor_x": "pose sensor ahead of the robot's origin",
    "sensor_y": "pose sensor to the left of it",
    "sensor_heading": "pose sensor turned to the left",
}
"""Coordinates of the sensor in words."""
NUMBERS = (
    Column("unit"),
    Column("estimate", "", significant(4)),
    Column("± standard error", "", significant(2)),
)


def along(data: Data) -> Section | None:
    """Everything estimated beside the parameters, None where there is nothing."""
    tables = (_places(data), _clocks(data), _noise(data), _coefficients(data))
    found = tuple(table for table in tables if table is not None)
    if not found:
        return None
    return Section("Estimated along", notices=_notices(data), tables=found)


def _notices(data: Data) -> tuple[str, ...]:
    far = offset_clocks(data)
    if not far:
        return ()
    return (
        "The clocks of the wheels and of the poses are more than 0.1 s apart, which is taken into account "
        f"here, and has to be on the robot, too: {far}.",
    )


def _estimated(title: str, entry: Mapping[str, Any]) -> tuple[Cell, ...]:
    unit, factor = own_unit(str(entry.get("unit") or ""))
    value, error = known(entry.get("value")), known(entry.get("standard_error"))
    return title, unit_text(unit) or "1", to_error(value, error, factor), error_text(error, factor)


def _places(data: Data) -> Table | None:
    sits = [one for one in entries(data, "nuisances") if one["name"] != "clock_offset"]
    if not sits:
        return None
    rows = tuple(_estimated(PLACES.get(one["name"], words(one["name"])), one) for one in sits)
    return Table((Column("place"), *NUMBERS), rows, "Where the pose sensor sits")


def _clocks(data: Data) -> Table | None:
    every = clocks(data)
    if not every:
        return None
    caption = "How far the wheels' clock is ahead of the poses'"
    if len(every) > MOST_ROWS:
        every = sorted(every, key=lambda one: -abs(known(one.get("value")) or 0.0))
        caption += ", the largest first"
    rows = [_estimated(clock_label(data, one), one) for one in every[:MOST_ROWS]]
    if len(every) > MOST_ROWS:
        rows.append((f"and {len(every) - MOST_ROWS} more", "", "", ""))
    return Table((Column("log"), *NUMBERS), tuple(rows), caption)


def _noise(data: Data) -> Table | None:
    columns = (
        Column("readings"),
        Column("at rest", "", significant(3)),
        Column("growth with speed", "", significant(3)),
        Column("growth with yaw rate", "", significant(3)),
    )
    rows = tuple(_noise_cells(one) for one in entries(data, "noise"))
    return Table(columns, rows, "Noise of the poses") if rows else None


def _noise_cells(one: Mapping[str, Any]) -> tuple[Cell, ...]:
    rest, unit = known(one.get("at_rest")), str(one.get("unit") or "")
    still = unit_for([rest], unit)
    return (
        words(str(one["about"])),
        MISSING if rest is None else quantity(rest * still[1], still[0]),
        _growth(one, "per_speed", unit, "m/s"),
        _growth(one, "per_yaw_rate", unit, "rad/s"),
    )


def _growth(one: Mapping[str, Any], key: str, unit: str, per: str) -> str:
    growth = known(one.get(key))
    shown, factor = unit_for([growth], unit)
    return quantity(growth * factor, f"{shown} per {per}") if growth else "none found"


def _coefficients(data: Data) -> Table | None:
    rows = tuple(_estimated(words(str(one["name"])), one) for one in entries(data, "coefficients"))
    return Table((Column("coefficient"), *NUMBERS), rows, "Coefficients that these give") if rows else None
