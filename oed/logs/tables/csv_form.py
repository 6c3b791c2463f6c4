"""Logs in text tables (CSV): the study's key `log` of kind csv."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from oed.foundation.errors import Issue, LogError
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.measurement import Measurement
from oed.logs.drive import to_logs
from oed.logs.form import LogForm, is_bag, read_twice
from oed.logs.log import Log
from oed.logs.sensors import labelled, source_issues, with_sensors
from oed.logs.series import together
from oed.logs.tables.chosen_rows import Records
from oed.logs.tables.columns import Column, ColumnPlace, Kept, MayBeNone, PoseColumns, Short, TimeColumn
from oed.logs.tables.csv_drives import drives_in
from oed.logs.tables.input_columns import AnyInputColumns, InputColumns, OdometryColumns
from oed.logs.tables.motion_columns import RelativePoseColumns
from oed.logs.tables.sensor_columns import SensorColumns, shared_columns
from oed.logs.tables.sheet import kept_inputs, read_sheet
from oed.logs.tables.table import Delimiter, Table, read_table


class CsvForm(LogForm):
    """Columns of a text table; by default those of the package's own trajectory CSVs.

    Attributes:
        delimiter: between cells; found by itself by default.
        header: whether the first row has the columns' names; by default it has if it is not all numbers.
        comment: text that comment lines begin with wherever they stand, in files beside the log as well;
            by default lines that begin with # or % are, above the first row or with fewer or more cells.
        time: column of the times.
        inputs: columns of the robot's inputs by their names; a column of the same name by default.
        poses: columns of the reference poses; "none" where other sensors say where the robot was.
        relative_poses: instead of these, columns of how a sensor moved.
        sensors: columns of the study's other sensors, by their names: their kinds, and of a second one of a
            kind `ranges_2` and so on.
        runs: the column that says which run a row belongs to; "run" by default, where there is one.
        records: where rows are of several types, the column that says so, and which have inputs and poses.
        keep: only rows in which these columns have the value, or lie within [low, high]; where others are
            left out for longer than a gap, or ticks with them, a drive of its own begins.
    """

    kind: Literal["csv"] = "csv"
    delimiter: Delimiter | None = None
    header: bool | None = None
    comment: Annotated[str, Field(min_length=1)] | None = None
    time: Annotated[TimeColumn, Short("column")] = TimeColumn(column="t")
    inputs: AnyInputColumns = {}  # noqa: RUF012
    poses: Annotated[PoseColumns, MayBeNone()] = PoseColumns()
    relative_poses: RelativePoseColumns | None = None
    sensors: dict[str, Annotated[SensorColumns, Short("column")]] = {}  # noqa: RUF012
    runs: Annotated[Column, Short("column")] | None = None
    records: Records | None = None
    keep: Kept = {}  # noqa: RUF012

    @property
    def clock_hint(self) -> str:
        """Which keys may mend times that do not rise."""
        return (
            "times have to rise within a run: sort the rows, or say with `runs` which column tells runs "
            "apart, with `time` which one has the times"
        )

    @property
    def named_states(self) -> frozenset[str]:
        """States of the robot whose columns are named."""
        return frozenset(self.poses.columns) & self.poses.model_fields_set

    @property
    def types_of_poses(self) -> Records | None:
        """Types of rows where the poses have one of their own, else None."""
        return None if self.records is None or self.records.poses is None else self.records

    def issues(self, model: System) -> list[Issue]:
        """Inputs and states the robot does not have, units and forms that do not fit."""
        issues = [*self.time.issues("time"), *self.input_columns.issues(model)]
        if self.types_of_poses is not None and self.reference.file is not None:
            text = "the poses are in a file of their own (`poses.file`); leave one of the two out"
            issues.append(Issue(("log", "records", "poses"), text))
        if self.relative_poses is None:
            own = self.poses.issues(model, needed=not self.sensors)
            return [*issues, *own, *self._own_reference(), *self._read_twice(model)]
        if "poses" in self.model_fields_set:
            text = "a log has poses or relative_poses; omit one of them"
            issues.append(Issue(("log", "relative_poses"), text))
        if self.sensors:
            text = "motions of relative_poses are fitted one by one, without other sensors; omit these"
            issues.append(Issue(("log", "sensors"), text))
        return [*issues, *self.relative_poses.issues(model)]

    def _own_reference(self) -> list[Issue]:
        # Compared with itself odometry is right, whatever it is.
        odometry, poses = self.inputs, self.reference
        if isinstance(odometry, dict) or isinstance(poses, RelativePoseColumns) or poses.file is not None:
            return []
        if self.types_of_poses is not None or any(
            getattr(odometry, name).column != getattr(poses, name).column for name in ("x", "y")
        ):
            return []
        return [Issue(("log", "inputs"), "the poses are those of `poses`; name the columns of the odometry")]

    def _read_twice(self, model: System) -> list[Issue]:
        each: dict[tuple[str, ...], ColumnPlace] = {("log", "time"): self.time.column}
        inputs = self.input_columns.columns(model).items()
        each |= {("log", "inputs", name): one.column for name, one in inputs}
        # Poses of odometry are looked at beside it.
        if isinstance(self.inputs, dict) and self.poses.file is None and self.types_of_poses is None:
            each |= {("log", "poses", name): one.column for name, one in self.poses.columns.items()}
        return read_twice({key: ("column", column) for key, column in each.items()})

    @property
    def input_columns(self) -> InputColumns | OdometryColumns:
        """The columns of the inputs."""
        return InputColumns(self.inputs) if isinstance(self.inputs, dict) else self.inputs

    @property
    def reference(self) -> PoseColumns | RelativePoseColumns:
        """What the wheels are compared with."""
        return self.relative_poses or self.poses

    def beside(self, log: Path) -> dict[str, Path]:
        """Files beside a log that are read along with it, by the keys within `log` that name them."""
        key = "poses" if self.relative_poses is None else "relative_poses"
        named = {key: self.reference, **{f"sensors.{name}": one for name, one in self.sensors.items()}}
        found = {f"{key}.file": one.beside(log) for key, one in named.items()}
        return {key: file for key, file in found.items() if file is not None}

    def sensor_issues(self, measurement: Measurement | None) -> list[Issue]:
        """Sensors that the study has not, numbers of columns and units that do not fit."""
        return [*source_issues(self.sensors, measurement), *shared_columns(self.sensors)]

    def sensed(self, file: Path, logs: list[Log], measurement: Measurement | None) -> list[Log]:
        """The drives with what sensors beside the poses read.

        Raises:
            LogError: every mistake in their columns, each with its line.
        """
        if not self.sensors:
            return logs
        table, known = kept_inputs(self._table(file), self), labelled(measurement)
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
        drives = drives_in(read_sheet(self._table(file), self, model), model, self.gap)
        return to_logs(drives, self, self.reference.held)

    def _table(self, file: Path) -> Table:
        ragged = self.records is not None
        return read_table(file, self.delimiter, self.header, ragged=ragged, comment=self.comment)
