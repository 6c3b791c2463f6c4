"""A text table's columns found and turned into numbers: times, inputs, poses, runs, rows to keep."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import FileIssue, LogError
from oed.foundation.files import no_such_file
from oed.kernel.dynamics.system import System
from oed.logs.drive import Relative
from oed.logs.input_forms import unit_factor
from oed.logs.motions import QUANTITIES
from oed.logs.series import NotInLog, Rows, Series, together
from oed.logs.tables.chosen_rows import kept_rows, of_type, without
from oed.logs.tables.columns import TIME_UNITS, Column, PoseColumn, PoseColumns, TimeColumn
from oed.logs.tables.input_columns import InputColumns, OdometryColumns
from oed.logs.tables.motion_columns import motion_columns, motion_series
from oed.logs.tables.stamps import read_times
from oed.logs.tables.table import Table, read_table
from oed.logs.tables.tum import read_tum

if TYPE_CHECKING:
    from oed.logs.tables.csv_form import CsvForm

Key = tuple[str, ...]
"""Path of a column's key in the study's key `log`."""
Clock = tuple[Key, TimeColumn]
RUN = "run"
"""The column that says which run a row belongs to, in the package's own files."""


@dataclass(frozen=True)
class ColumnBlock:
    """Some columns of a table on one clock.

    Attributes:
        table: they are from; None where it is not a plain table.
        series: their numbers, time in s; not-a-number in empty cells.
        clock: the time's column.
        places: of the columns in the table.
        runs: value of the run column in each row; None without one.
        logged: the numbers in these columns, where those of `series` are made of them.
    """

    table: Table | None
    series: Series
    clock: int = 0
    places: tuple[int, ...] = ()
    runs: list[str] | None = None
    logged: Series | None = None

    def require_filled(self, series: Series, rows: Rows) -> None:
        """Refuse empty cells in these rows, whose numbers are `series`.

        Raises:
            LogError: names each of them.
        """
        if self.logged is not None:
            series = self.logged.rows(rows)
        empty = np.isnan(np.column_stack([series.times, series.values]))
        if self.table is None or not empty.any():
            return
        places = (self.clock, *self.places)
        raise LogError([self.table.cell_issue(int(rows[row]), places[at]) for row, at in np.argwhere(empty)])


@dataclass(frozen=True)
class Sheet:
    """A log's table as numbers.

    Attributes:
        inputs: as logged: a column for each input of the robot, or for each of x, y and heading.
        poses: of the same table or of a file of their own, SI.
        quantities: the states that the poses are.
        columns: of the inputs, which know how to integrate them; as logged, one of `inputs` each.
        same_rows: whether the poses are columns of the same table.
        own_clock: whether the poses have a clock of their own.
        kept: rows of the poses' table whose poses are wanted.
        relative: of motions in place of poses, as `RecordedDrive` has it.
    """

    inputs: ColumnBlock
    poses: ColumnBlock
    quantities: tuple[str, ...]
    columns: InputColumns | OdometryColumns
    same_rows: bool
    own_clock: bool
    relative: Relative | None
    kept: Bools

    @property
    def cut_off(self) -> bool:
        """Whether the file breaks off in its last line."""
        return any(one.table is not None and one.table.cut_off for one in (self.inputs, self.poses))


def read_sheet(table: Table, form: CsvForm, model: System) -> Sheet:
    """Find the columns and read them.

    Args:
        table: the log's.
        form: which columns are what.
        model: the robot that drove.

    Raises:
        LogError: columns that are not there, and cells that are no numbers.
    """
    wheels = _of_inputs(table, form)
    try:
        wheels = _kept(wheels, form)
    except LogError as error:
        # What else is wrong is said along with it.
        together(
            [partial(_refuse, error), lambda: read_sheet(table, form.model_copy(update={"keep": {}}), model)]
        )
        raise
    beside = form.reference.beside(Path(table.file))
    columns = form.input_columns.columns(model)
    same_rows = beside is None and form.types_of_poses is None
    own_clock = _skipping(form.skip_invalid_rows, same_rows and form.reference.clock is not None)
    inputs, (quantities, poses, kept) = together(
        [
            lambda: _read_block(wheels, _clock(form), _under("inputs", columns), form.runs, own_clock),
            lambda: _read_reference(wheels if same_rows else table, beside, form, model),
        ]
    )
    return Sheet(
        inputs=inputs,
        poses=poses,
        quantities=quantities,
        columns=form.input_columns,
        same_rows=same_rows,
        own_clock=not same_rows or form.reference.clock is not None,
        relative=_relative(form),
        kept=kept,
    )


def kept_inputs(table: Table, form: CsvForm) -> Table:
    """The rows of the inputs that are kept.

    Raises:
        LogError: every reason against the columns that say so.
    """
    return _kept(_of_inputs(table, form), form)


def _of_inputs(table: Table, form: CsvForm) -> Table:
    return table if form.records is None else of_type(table, form.records, "inputs")


def _kept(table: Table, form: CsvForm) -> Table:
    kept, labels = together(
        [
            lambda: kept_rows(table, form.keep, form.skip_invalid_rows, "keep"),
            lambda: _run_labels(table, form.runs) if form.keep else None,
        ]
    )
    return without(table, kept, labels)


def _refuse(error: LogError) -> None:
    raise error


def _read_block(
    table: Table, clock_of: Clock, columns: Mapping[Key, Column], runs: Column | None, own_clock: bool | None
) -> ColumnBlock:
    # Rows with cells that are no numbers are refused, or skipped where it is said whose clock it is.
    skip, (key, time) = own_clock is not None, clock_of
    read = [_reader(table, column, of_column, skip) for of_column, column in columns.items()]
    try:
        clock, *found, labels = together(
            [partial(_read_clock, table, time, key, skip), *read, partial(_run_labels, table, runs)]
        )
    except LogError as error:
        raise LogError([*error.issues, *_clock_issues(table, time, runs)]) from None
    series = _series(table, clock, [numbers for _, numbers in found])
    places = tuple(place for place, _ in found)
    if own_clock is not None:
        series = series.emptied(_invalid(table, (clock[0], *places), series, own_clock), own_clock=own_clock)
    return ColumnBlock(table, series, clock[0], places, labels)


def _relative(form: CsvForm) -> Relative | None:
    own = form.relative_poses
    return None if own is None else "follows" if own.t1 is None else "pairs"


def _clock(form: CsvForm) -> Clock:
    return (("time",), form.time)


def _reference_clock(form: CsvForm) -> Clock:
    own = form.reference.clock
    if own is None:
        return _clock(form)
    if form.relative_poses is None:
        return (("poses", "time"), own)
    return (("relative_poses", "time" if form.relative_poses.t1 is None else "t1"), own)


def _under(key: str, columns: Mapping[str, Column]) -> dict[Key, Column]:
    return {(key, name): column for name, column in columns.items()}


def _skipping(skip: bool, own_clock: bool) -> bool | None:
    return own_clock if skip else None


def _invalid(table: Table, places: Sequence[int], series: Series, own_clock: bool) -> Bools:
    # Rows with a cell in one of these columns that is neither empty nor a number, or with some numbers only.
    wrong = np.zeros(len(series), dtype=bool)
    missing = np.isnan(np.column_stack([series.times, series.values]))
    for place, none in zip(places, missing.T, strict=True):
        cells = table.texts(place) if none.any() else []
        wrong[[row for row in np.flatnonzero(none).tolist() if cells[row]]] = True
    looked_at = missing if own_clock else missing[:, 1:]
    some = looked_at.any(axis=1) & ~looked_at.all(axis=1)
    return wrong | some | (missing[:, 0] & (not own_clock))


def _clock_issues(table: Table, time: TimeColumn, runs: Column | None) -> list[FileIssue]:
    # What is wrong with the times of a single run is named along with what is wrong with the numbers.
    with suppress(LogError):
        if _run_labels(table, runs) is not None:
            return []
    with suppress(LogError):
        clock = _read_clock(table, time, ("time",))
        rows = distinct_rows(table, clock[1], np.arange(len(table.rows)))
        return _series(table, clock, ()).rows(rows).clock_issues()
    return []


def _series(table: Table, clock: tuple[int, Array], columns: Sequence[Array]) -> Series:
    values = np.array(columns).reshape(len(columns), len(table.rows)).T
    return Series(table.file, table.label(clock[0]), clock[1], values, table.lines)


def _read_clock(table: Table, time: TimeColumn, key: Key, skip: bool = False) -> tuple[int, Array]:
    place = table.place(time.column, *key, "column")
    return place, read_times(table, place, time, skip=skip)


def _reader(table: Table, column: Column, key: Key, skip: bool) -> Callable[[], tuple[int, Array]]:
    if isinstance(column, TimeColumn):
        return partial(_read_clock, table, column, key, skip)
    return partial(_read, table, column, key, skip)


def _read(table: Table, column: Column, key: Key, skip: bool = False) -> tuple[int, Array]:
    place = table.place(column.column, *key, "column")
    return place, table.finite(place, skip)


def _run_labels(table: Table, runs: Column | None) -> list[str] | None:
    if runs is None:
        return table.texts(table.header.index(RUN)) if RUN in table.header else None
    return table.texts(table.place(runs.column, "runs", "column"))


def _read_reference(
    table: Table, beside: Path | None, form: CsvForm, model: System
) -> tuple[tuple[str, ...], ColumnBlock, Bools]:
    given, runs, types = form.reference, form.runs, form.types_of_poses
    key, apart = (
        "poses" if form.relative_poses is None else "relative_poses",
        beside is not None or types is not None,
    )
    if beside is not None and not beside.exists():
        named = ("log", key, "file")
        hint = "; `{stem}` stands for the log's own" if "{" in beside.name else ""
        raise LogError(
            [NotInLog(str(beside), 0, 0, "file", f"{no_such_file(beside, Path(table.file))}{hint}", named)]
        )
    if beside is not None and isinstance(given, PoseColumns) and given.is_tum:
        block = _read_tum(beside, given, form)
        return tuple(given.columns), block, np.ones(len(block.series), dtype=bool)
    if beside is not None:
        table = read_table(beside, given.delimiter, given.header, comment=form.comment)
    elif types is not None:
        table = of_type(table, types, "poses")
    if apart:
        # Poses of their own need not know of runs, even where the log does.
        runs = runs if runs is not None and runs.column in table.header else None
    own_clock = _skipping(form.skip_invalid_rows, apart or given.clock is not None)
    if not isinstance(given, PoseColumns):
        block = _read_block(table, _reference_clock(form), motion_columns(given), runs, own_clock)
        series = motion_series(block.series, block.runs, given)
        return (
            QUANTITIES,
            replace(block, series=series, logged=block.series),
            np.ones(len(series), dtype=bool),
        )
    kept = kept_rows(table, given.keep, form.skip_invalid_rows, key, "keep")
    columns = _pose_columns(table, given, model)
    block = _read_block(table, _reference_clock(form), _under(key, columns), runs, own_clock)
    units = dict(zip(model.states, model.state_units, strict=True))
    factors = [unit_factor(column.unit, units[name]) for name, column in columns.items()]
    values = block.series.values * factors
    return tuple(columns), replace(block, series=block.series.with_values(values)), kept


def _read_tum(file: Path, poses: PoseColumns, form: CsvForm) -> ColumnBlock:
    unit = "s" if poses.time is None else poses.time.unit or "s"
    named, factor, skip = tuple(poses.columns), TIME_UNITS[unit], form.skip_invalid_rows
    return ColumnBlock(None, read_tum(file, named, factor, skip=skip, comment=form.comment))


def _pose_columns(table: Table, poses: PoseColumns, model: System) -> dict[str, PoseColumn]:
    # Further states of the robot are read by their names where the table has them.
    by_name = {name: PoseColumn(column=name) for name in model.states[3:] if name in table.header}
    known = by_name | poses.columns
    return {name: known[name] for name in model.states if name in known}


def distinct_rows(table: Table, times: Array, rows: Rows) -> Rows:
    """The rows without those that repeat the one before, cell by cell, time and all.

    Args:
        table: the log's.
        times: of its rows, (n,).
        rows: to be looked at.
    """
    same = np.flatnonzero(np.diff(times[rows]) == 0) + 1
    return np.delete(rows, [row for row in same if table.rows[rows[row]] == table.rows[rows[row - 1]]])
