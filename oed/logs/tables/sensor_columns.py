"""Columns of sensors beside the poses: one for every entry of a reading, or rows of one point with its id."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import model_validator

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue, LogError
from oed.foundation.files import no_such_file
from oed.foundation.text import count, listing
from oed.kernel.measurement.sensor import Sensor
from oed.logs.points import ROWS, gathered, quantities_of, units_of
from oed.logs.sensors import AS_LIST, Sensed, SensorSource, checked
from oed.logs.series import NotInLog, Series, shortened, together
from oed.logs.tables.columns import ColumnPlace, MaybeBeside, PoseColumn, Short, TimeColumn
from oed.logs.tables.stamps import read_times
from oed.logs.tables.table import Table, read_table

if TYPE_CHECKING:
    from oed.logs.tables.csv_form import CsvForm

RUN = "run"


class SensorColumns(MaybeBeside, SensorSource):
    """Where a sensor's readings are.

    Attributes:
        column, columns: of the entries of a reading, in their order; or, with `id`, of the only quantity.
        unit: of all of them; a column may have its own.
        id: column that says which beacon, landmark or tag a row is of; a row then has one of them.
        range, bearing, orientation: columns in such rows; of their own names by default.
        time: column of their own clock, where it is not that of the rest.
    """

    columns: Annotated[tuple[Annotated[PoseColumn, Short("column")], ...], AS_LIST] = ()
    id: ColumnPlace | None = None
    range: Annotated[PoseColumn, Short("column")] | None = None
    bearing: Annotated[PoseColumn, Short("column")] | None = None
    orientation: Annotated[PoseColumn, Short("column")] | None = None
    time: Annotated[TimeColumn, Short("column")] | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_column(cls, value: Any) -> Any:
        if isinstance(value, Mapping) and "column" in value:
            if "columns" in value:
                raise ValueError("give `column` or `columns`, not both")
            return {"columns" if key == "column" else key: one for key, one in value.items()}
        return value

    def issues(self, name: str, sensor: Sensor) -> list[Issue]:
        """Numbers of columns and units that do not fit the sensor."""
        key, issues = ("log", "sensors", name), []
        quantities = quantities_of(sensor)
        if self.id is not None:
            given = [one for one in ROWS if getattr(self, one) is not None]
            strangers = [one for one in given if one not in quantities]
            if not all("[" in entry for entry in sensor.entries):
                issues.append(
                    Issue((*key, "id"), f"{name} sees no points that ids could tell apart; leave it out")
                )
            issues += [Issue((*key, one), f"{name} measures {listing(quantities)}") for one in strangers]
        elif len(self.columns) != len(sensor.entries):
            wanted = listing([f"{name}{entry}" for entry in sensor.entries[:8]])
            text = f"expected {count(len(sensor.entries), 'column')} ({wanted}), got {len(self.columns)}"
            hint = "; or `id`, for rows of one each" if len(sensor.entries) > 1 else ""
            issues.append(Issue((*key, "columns"), f"{text}{hint}"))
        units = units_of(sensor, self.id is not None)
        return [*issues, *self.unit_issues(name, self._columns(sensor), units)]

    def read(self, name: str, sensor: Sensor, log: Table, form: CsvForm) -> Sensed:
        """All that the sensor read.

        Raises:
            LogError: columns that are not there, cells that are no numbers, ids that the study does not know.
        """
        table, key = self._table(name, Path(log.file), log, form.comment), ("sensors", name)
        time, where = (form.time, ("time",)) if self.time is None else (self.time, (*key, "time"))
        columns, units = self._columns(sensor), units_of(sensor, self.id is not None)
        skip = form.skip_invalid_rows
        (place, times), *values = together(
            [
                partial(_times, table, time, where, skip),
                *(partial(_numbers, table, one, (*key, self._key(one)), skip) for one in columns),
            ]
        )
        _require_times(table, place, times, np.column_stack(values), skip)
        rows = np.column_stack(values) * self.factors(columns, units)
        series, runs = Series(table.file, table.label(place), times, rows, table.lines), _runs(table, form)
        if self.id is not None:
            ids = table.texts(table.place(self.id, *key, "id"))
            series, runs = gathered(series, ids, runs, name, sensor)
        kept = np.isfinite(series.times)
        labels = None if runs is None else tuple(np.array(runs)[kept].tolist())
        return checked(Sensed(name, series.rows(kept), self.clock_of(sensor), labels), sensor)

    def _key(self, column: PoseColumn) -> str:
        return next((one for one in ROWS if getattr(self, one) is column), "columns")

    def _table(self, name: str, log: Path, table: Table, comment: str | None) -> Table:
        own = self.beside(log)
        if own is None:
            return table
        if not own.exists():
            named = ("log", "sensors", name, "file")
            raise LogError([NotInLog(str(own), 0, 0, "file", no_such_file(own, log), named)])
        return read_table(own, self.delimiter, self.header, comment=comment)

    def _columns(self, sensor: Sensor) -> tuple[PoseColumn, ...]:
        if self.id is None or self.columns:
            return self.columns
        wanted = [one for one in ROWS if one in quantities_of(sensor)] or ["range"]
        return tuple(getattr(self, one) or PoseColumn(column=one) for one in wanted)


def _times(table: Table, column: TimeColumn, key: Sequence[str], skip: bool) -> tuple[int, Array]:
    place = table.place(column.column, *key, "column")
    return place, read_times(table, place, column, skip=skip)


def _numbers(table: Table, column: Any, key: Sequence[str], skip: bool) -> Array:
    return table.finite(table.place(column.column, *key, "column"), skip)


def _require_times(table: Table, place: int, times: Array, values: Array, skip: bool) -> None:
    # Readings without a time are none, but where the study lets them go.
    lost = np.flatnonzero(np.isnan(times) & ~np.isnan(values).all(axis=1)).tolist()
    if lost and not skip:
        raise LogError(shortened(table.cell_issue(row, place) for row in lost))


def _runs(table: Table, form: CsvForm) -> list[str] | None:
    column = RUN if form.runs is None else form.runs.column
    return table.texts(table.place(column, "runs", "column")) if column in table.header else None


def shared_columns(columns: Mapping[str, SensorColumns]) -> list[Issue]:
    """Columns that two sensors share."""
    seen: dict[tuple[str | None, int | str], str] = {}
    issues = []
    for name, one in columns.items():
        for column in one.columns if one.id is None else ():
            place = (one.file, column.column)
            if place in seen:
                text = f"the column {column.column} is that of {seen[place]} already"
                issues.append(Issue(("log", "sensors", name), text))
            seen[place] = name
    return issues
