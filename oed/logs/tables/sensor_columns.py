"""Columns of sensors beside the poses: one for every entry of a reading, or rows of one point with its id."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, model_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Flaw, LogError
from oed.foundation.files import no_such_file
from oed.foundation.quantities import plain_number
from oed.foundation.text import count, listing
from oed.kernel.measurement.sensor import Sensor
from oed.logs.sensors import Clock, Sensed, checked, default_clock, name_flaws
from oed.logs.series import NotInLog, Rows, Series, together
from oed.logs.tables.columns import ColumnPlace, PoseColumn, Short, TimeColumn, unit_factor, unit_reason
from oed.logs.tables.table import Delimiter, Table, read_table

if TYPE_CHECKING:
    from oed.logs.tables.csv_form import CsvForm

RUN = "run"
ROWS = ("range", "bearing", "orientation")
"""What rows of one point each may have."""


def _as_list(value: Any) -> Any:
    return value if isinstance(value, list | tuple) else [value]


class SensorColumns(Component):
    """Where a sensor's readings are.

    Attributes:
        column, columns: of the entries of a reading, in their order; or, with `id`, of the only quantity.
        unit: of all of them, e.g. "deg/s"; SI by default. A column may have its own.
        id: column that says which beacon, landmark or tag a row is of; a row then has one of them.
        range, bearing, orientation: columns in such rows; of their own names by default.
        time: column of their own clock, where it is not that of the rest.
        clock: "inputs" or "poses", whose clock the times are on; by default a gyroscope's are on the inputs',
            those of what sees places on the poses'.
        file: they are in a file of their own, beside the log; "{stem}" stands for the log's stem.
        delimiter, header: of that file, as of the log's own.
    """

    columns: Annotated[tuple[Annotated[PoseColumn, Short("column")], ...], BeforeValidator(_as_list)] = ()
    unit: str | None = None
    id: ColumnPlace | None = None
    range: Annotated[PoseColumn, Short("column")] | None = None
    bearing: Annotated[PoseColumn, Short("column")] | None = None
    orientation: Annotated[PoseColumn, Short("column")] | None = None
    time: Annotated[TimeColumn, Short("column")] | None = None
    clock: Literal["inputs", "poses"] | None = None
    file: str | None = None
    delimiter: Delimiter | None = None
    header: bool | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_column(cls, value: Any) -> Any:
        if isinstance(value, Mapping) and "column" in value:
            if "columns" in value:
                raise ValueError("give `column` or `columns`, not both")
            return {"columns" if key == "column" else key: one for key, one in value.items()}
        return value

    def beside(self, log: Path) -> Path | None:
        """Where the readings of a log are; None where they are in the log itself."""
        return None if self.file is None else log.parent / self.file.replace("{stem}", log.stem)

    def flaws(self, name: str, sensor: Sensor) -> list[Flaw]:
        """Numbers of columns and units that do not fit the sensor."""
        key, flaws = ("log", "sensors", name), []
        quantities = _quantities(sensor)
        if self.id is not None:
            given = [one for one in ROWS if getattr(self, one) is not None]
            strangers = [one for one in given if one not in quantities]
            if not all("[" in entry for entry in sensor.entries):
                flaws.append(
                    Flaw((*key, "id"), f"{name} sees no points that ids could tell apart; leave it out")
                )
            flaws += [Flaw((*key, one), f"{name} measures {listing(quantities)}") for one in strangers]
        elif len(self.columns) != len(sensor.entries):
            wanted = listing([f"{name}{entry}" for entry in sensor.entries[:8]])
            text = f"expected {count(len(sensor.entries), 'column')} ({wanted}), got {len(self.columns)}"
            hint = "; or `id`, for rows of one each" if len(sensor.entries) > 1 else ""
            flaws.append(Flaw((*key, "columns"), f"{text}{hint}"))
        for column, unit in zip(self._columns(sensor), _units(sensor, self.id is not None), strict=False):
            reason = unit_reason(column.unit or self.unit, unit)
            if reason:
                flaws.append(Flaw((*key, "unit"), reason))
        return flaws

    def read(self, name: str, sensor: Sensor, log: Table, form: CsvForm) -> Sensed:
        """All that the sensor read.

        Raises:
            LogError: columns that are not there, cells that are no numbers, ids that the study does not know.
        """
        table, key = self._table(Path(log.file), log), ("sensors", name)
        time, where = (form.time, ("time",)) if self.time is None else (self.time, (*key, "time"))
        columns, units = self._columns(sensor), _units(sensor, self.id is not None)
        times, *values = together(
            partial(_numbers, table, column, place, form.skip_invalid_rows)
            for column, place in [(time, where), *((one, (*key, self._key(one))) for one in columns)]
        )
        factors = [unit_factor(one.unit or self.unit, unit) for one, unit in zip(columns, units, strict=True)]
        clock = table.label(table.place(time.column, *where, "column"))
        rows = np.column_stack(values) * factors
        series, runs = Series(table.file, clock, time.factor * times, rows, table.lines), _runs(table, form)
        if self.id is not None:
            ids = table.texts(table.place(self.id, *key, "id"))
            series, runs = _gathered(series, ids, runs, name, sensor)
        kept = np.isfinite(series.times)
        labels = None if runs is None else tuple(np.array(runs)[kept].tolist())
        chosen: Clock = self.clock or default_clock(sensor)
        return checked(Sensed(name, series.rows(kept), chosen, labels), sensor)

    def _key(self, column: PoseColumn) -> str:
        return next((one for one in ROWS if getattr(self, one) is column), "columns")

    def _table(self, log: Path, table: Table) -> Table:
        beside = self.beside(log)
        if beside is None:
            return table
        if not beside.exists():
            raise LogError([NotInLog(str(beside), 0, 0, "file", no_such_file(beside), ("log", "sensors"))])
        return read_table(beside, self.delimiter, self.header)

    def _columns(self, sensor: Sensor) -> tuple[PoseColumn, ...]:
        if self.id is None or self.columns:
            return self.columns
        wanted = [one for one in ROWS if one in _quantities(sensor)] or ["range"]
        return tuple(getattr(self, one) or PoseColumn(column=one) for one in wanted)


def _quantities(sensor: Sensor) -> tuple[str, ...]:
    # What is read of each point: range and bearing, or () of a sensor that has no name for it.
    found = dict.fromkeys(entry.partition("[")[0].removeprefix(".") for entry in sensor.entries)
    return tuple(name for name in found if name) or ("range",)


def _units(sensor: Sensor, by_id: bool) -> list[str]:
    if not by_id:
        return list(sensor.units)
    table = dict(zip(_split(sensor), sensor.units, strict=True))
    first = next(iter(table))[1]
    return [table[one, first] for one in sorted(_quantities(sensor), key=ROWS.index)]


def _split(sensor: Sensor) -> list[tuple[str, str]]:
    # Of every entry its quantity and which point: `.range[7]`, `[2]`.
    parts = (entry.rstrip("]").partition("[") for entry in sensor.entries)
    return [(quantity.removeprefix(".") or "range", which) for quantity, _, which in parts]


def _numbers(table: Table, column: Any, key: Sequence[str], skip: bool) -> Array:
    values, flaws = table.numbers(table.place(column.column, *key, "column"))
    if flaws and (not skip or len(flaws) == len(values)):
        raise LogError(flaws)
    return values


def _runs(table: Table, form: CsvForm) -> list[str] | None:
    column = RUN if form.runs is None else form.runs.column
    return table.texts(table.place(column, "runs", "column")) if column in table.header else None


def _gathered(
    series: Series, ids: Sequence[str], runs: Sequence[str] | None, name: str, sensor: Sensor
) -> tuple[Series, list[str] | None]:
    # Rows of one point each, those of one time together.
    split = _split(sensor)
    quantities = sorted({one for one, _ in split}, key=ROWS.index)
    places = {pair: place for place, pair in enumerate(split)}
    known = list(dict.fromkeys(which for _, which in split))
    labels = [_plain(one) for one in ids]
    filled = np.isfinite(series.values).any(axis=1) & np.isfinite(series.times)
    flaws = [
        series.flaw(row, "id", f"{name} has no id {labels[row]!r}; the study has {listing(known)}")
        for row in np.flatnonzero(filled).tolist()
        if labels[row] not in known
    ]
    if flaws:
        raise LogError(flaws)
    kept = np.flatnonzero(filled)
    groups = _together(series.times[kept], None if runs is None else np.array(runs)[kept])
    values = np.full((groups[-1] + 1 if len(kept) else 0, len(split)), np.nan)
    for group, row in zip(groups.tolist(), kept.tolist(), strict=True):
        for column, quantity in enumerate(quantities):
            place = places[quantity, labels[row]]
            if np.isfinite(values[group, place]):
                flaws.append(
                    series.flaw(row, "id", f"{labels[row]} is read a second time at {series.at(row)}")
                )
            values[group, place] = series.values[row, column]
    if flaws:
        raise LogError(flaws)
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
    return str(int(value)) if value is not None and value == int(value) else text.strip()


def sensor_flaws(columns: Mapping[str, SensorColumns], sensors: dict[str, Sensor]) -> list[Flaw]:
    """What in `log: sensors:` does not fit the study's measurement."""
    wrong = dict(name_flaws(list(columns), sensors))
    flaws = list(wrong.values())
    for name, one in columns.items():
        if name not in wrong:
            flaws += one.flaws(name, sensors[name])
    return [*flaws, *_twice(columns)]


def _twice(columns: Mapping[str, SensorColumns]) -> list[Flaw]:
    # A column that two sensors share.
    seen: dict[tuple[str | None, int | str], str] = {}
    flaws = []
    for name, one in columns.items():
        for column in one.columns if one.id is None else ():
            place = (one.file, column.column)
            if place in seen:
                text = f"the column {column.column} is that of {seen[place]} already"
                flaws.append(Flaw(("log", "sensors", name), text))
            seen[place] = name
    return flaws
