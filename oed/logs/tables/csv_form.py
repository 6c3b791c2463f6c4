"""Logs in text tables (CSV): the study's key `log` of kind csv."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from oed.foundation.errors import Flaw, LogError
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.measurement import Measurement
from oed.logs.drive import to_logs
from oed.logs.form import LogForm, is_bag
from oed.logs.log import Log
from oed.logs.sensors import labelled, with_sensors
from oed.logs.series import together
from oed.logs.tables.columns import Column, MayBeNone, PoseColumns, Short, TimeColumn
from oed.logs.tables.csv_drives import drives_in
from oed.logs.tables.input_columns import AnyInputColumn, input_flaws
from oed.logs.tables.sensor_columns import SensorColumns, sensor_flaws
from oed.logs.tables.sheet import Wanted, read_sheet
from oed.logs.tables.table import Delimiter, read_table


def _names(value: Any) -> Any:
    return {str(key): entry for key, entry in value.items()} if isinstance(value, Mapping) else value


class CsvForm(LogForm):
    """Columns of a text table; by default those of the package's own trajectory CSVs.

    Attributes:
        delimiter: between cells; found by itself by default.
        header: whether the first row has the columns' names; by default it has if it is not all numbers.
        time: column of the times.
        inputs: columns of the robot's inputs by their names; a column of the same name by default.
        poses: columns of the reference poses; "none" where other sensors say where the robot was.
        sensors: columns of the study's other sensors, by their names: their kinds, and of a second one of a
            kind `ranges_2` and so on.
        runs: the column that says which run a row belongs to; "run" by default, where there is one.
        keep: only the poses of rows in which these columns have the value, or lie within [low, high].
    """

    kind: Literal["csv"] = "csv"
    delimiter: Delimiter | None = None
    header: bool | None = None
    time: Annotated[TimeColumn, Short("column")] = TimeColumn(column="t")
    inputs: dict[str, AnyInputColumn] = {}  # noqa: RUF012
    poses: Annotated[PoseColumns, MayBeNone()] = PoseColumns()
    sensors: dict[str, Annotated[SensorColumns, Short("column")]] = {}  # noqa: RUF012
    runs: Annotated[Column, Short("column")] | None = None
    keep: Annotated[dict[str, Wanted], BeforeValidator(_names)] = {}  # noqa: RUF012

    def flaws(self, model: System) -> list[Flaw]:
        """Inputs and states the robot does not have, units and forms that do not fit."""
        return [*input_flaws(self.inputs, model), *self.poses.flaws(model, needed=not self.sensors)]

    def sensor_flaws(self, measurement: Measurement | None) -> list[Flaw]:
        """Sensors that the study has not, numbers of columns and units that do not fit."""
        return sensor_flaws(self.sensors, labelled(measurement))

    def sensed(self, file: Path, logs: list[Log], measurement: Measurement | None) -> list[Log]:
        """The drives with what sensors beside the poses read.

        Args:
            file: that was read.
            logs: the drives in it.
            measurement: the study's.

        Raises:
            LogError: every mistake in their columns, each with its line.
        """
        if not self.sensors:
            return logs
        table, known = read_table(file, self.delimiter, self.header), labelled(measurement)
        found = together(
            partial(one.read, name, known[name], table, self) for name, one in self.sensors.items()
        )
        return with_sensors(logs, found)

    def read(self, file: Path, model: System) -> list[Log]:
        """The drives in a CSV, one for each run.

        Raises:
            LogError: every mistake in the file, each with its line.
        """
        if is_bag(file):
            raise LogError.about(file, "is a ROS bag, not a CSV; say `kind: rosbag` under `log`")
        table = read_table(file, self.delimiter, self.header)
        drives = drives_in(read_sheet(table, self, model), model, self.gap)
        return to_logs(drives, self, self.poses.held)
