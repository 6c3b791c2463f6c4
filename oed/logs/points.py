"""Readings of one beacon, landmark or tag each, which say by an id which it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import LogError
from oed.foundation.quantities import plain_number
from oed.foundation.text import listing
from oed.kernel.measurement.sensor import Sensor
from oed.logs.series import Rows, Series

ROWS = ("range", "bearing", "orientation")
"""What such readings may have."""


def quantity_of(entry: str) -> str:
    """What an entry of a sensor's reading is: `.range[7]` and `[2]` are ranges."""
    return entry.partition("[")[0].removeprefix(".") or "range"


def quantities_of(sensor: Sensor) -> tuple[str, ...]:
    """What a sensor reads of each point: ranges have no name of their own."""
    return tuple(dict.fromkeys(map(quantity_of, sensor.entries))) or ("range",)


def units_of(sensor: Sensor, by_id: bool) -> list[str]:
    """SI units of a reading's entries, or of the quantities of rows that have one point each (`by_id`)."""
    if not by_id:
        return list(sensor.units)
    table = dict(zip(_split(sensor), sensor.units, strict=True))
    first = next(iter(table))[1]
    return [table[one, first] for one in sorted(quantities_of(sensor), key=ROWS.index)]


def _split(sensor: Sensor) -> list[tuple[str, str]]:
    # Of every entry its quantity and which point: `.range[7]`, `[2]`.
    return [(quantity_of(entry), entry.rstrip("]").partition("[")[2]) for entry in sensor.entries]


def gathered(
    series: Series, ids: Sequence[str], runs: Sequence[str] | None, name: str, sensor: Sensor
) -> tuple[Series, list[str] | None]:
    """Rows of one point each, those of one time together, with what run each of these is of.

    Args:
        series: with a column for each quantity.
        ids: of its rows.
        runs: of its rows, where there are several.
        name: of the sensor.
        sensor: whose points they are.

    Raises:
        LogError: ids that the sensor does not know, points that are read twice at a time.
    """
    split = _split(sensor)
    quantities = sorted({one for one, _ in split}, key=ROWS.index)
    places = {pair: place for place, pair in enumerate(split)}
    known = list(dict.fromkeys(which for _, which in split))
    labels = [_plain(one) for one in ids]
    filled = np.isfinite(series.values).any(axis=1) & np.isfinite(series.times)
    issues = [
        series.issue(row, "id", f"{name} has no id {labels[row]!r}; the study has {listing(known)}")
        for row in np.flatnonzero(filled).tolist()
        if labels[row] not in known
    ]
    if issues:
        raise LogError(issues)
    kept = np.flatnonzero(filled)
    groups = _together(series.times[kept], None if runs is None else np.array(runs)[kept])
    values = np.full((groups[-1] + 1 if len(kept) else 0, len(split)), np.nan)
    for group, row in zip(groups.tolist(), kept.tolist(), strict=True):
        for column, quantity in enumerate(quantities):
            place = places[quantity, labels[row]]
            if np.isfinite(values[group, place]):
                issues.append(
                    series.issue(row, "id", f"{labels[row]} is read a second time at {series.at(row)}")
                )
            values[group, place] = series.values[row, column]
    if issues:
        raise LogError(issues)
    first = kept[np.unique(groups, return_index=True)[1]] if len(kept) else kept
    gathered = series.rows(first).with_values(values)
    return gathered, None if runs is None else [runs[row] for row in first]


def _together(times: Array, runs: Any) -> Rows:
    # The number of each row's time, as they follow each other.
    new = np.diff(times) != 0
    if runs is not None:
        new |= runs[1:] != runs[:-1]
    return np.concatenate([[0], np.cumsum(new)]).astype(np.intp) if len(times) else np.zeros(0, dtype=np.intp)


def _plain(text: str) -> str:
    # Numbers without a fraction as the study has them.
    value = plain_number(text)
    return str(int(value)) if value is not None and value.is_integer() else text.strip()
