"""Logs in text tables (CSV): the study's key `log` of kind csv."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from oed.foundation.errors import Flaw, LogError
from oed.kernel.dynamics.system import System
from oed.logs.drive import to_logs
from oed.logs.form import LogForm, is_bag
from oed.logs.log import Log
from oed.logs.tables.columns import Column, PoseColumns, Short, TimeColumn
from oed.logs.tables.csv_drives import drives_in
from oed.logs.tables.input_columns import AnyInputColumn, input_flaws
from oed.logs.tables.motion_columns import RelativePoseColumns
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
        poses: columns of the reference poses.
        relative_poses: instead of these, columns of how a sensor moved.
        runs: the column that says which run a row belongs to; "run" by default, where there is one.
        keep: only the poses of rows in which these columns have the value, or lie within [low, high].
    """

    kind: Literal["csv"] = "csv"
    delimiter: Delimiter | None = None
    header: bool | None = None
    time: Annotated[TimeColumn, Short("column")] = TimeColumn(column="t")
    inputs: dict[str, AnyInputColumn] = {}  # noqa: RUF012
    poses: PoseColumns = PoseColumns()
    relative_poses: RelativePoseColumns | None = None
    runs: Annotated[Column, Short("column")] | None = None
    keep: Annotated[dict[str, Wanted], BeforeValidator(_names)] = {}  # noqa: RUF012

    def flaws(self, model: System) -> list[Flaw]:
        """Inputs and states the robot does not have, units and forms that do not fit."""
        both = self.relative_poses is not None and "poses" in self.model_fields_set
        text = "a log has poses or relative_poses; omit one of them"
        twice = [Flaw(("log", "relative_poses"), text)] if both else []
        return [*input_flaws(self.inputs, model), *self.reference.flaws(model), *twice]

    @property
    def reference(self) -> PoseColumns | RelativePoseColumns:
        """What the wheels are compared with."""
        return self.relative_poses or self.poses

    def read(self, file: Path, model: System) -> list[Log]:
        """The drives in a CSV, one for each run.

        Raises:
            LogError: every mistake in the file, each with its line.
        """
        if is_bag(file):
            raise LogError.about(file, "is a ROS bag, not a CSV; say `kind: rosbag` under `log`")
        table = read_table(file, self.delimiter, self.header)
        drives = drives_in(read_sheet(table, self, model), model, self.gap)
        return to_logs(drives, self, self.reference.held)
