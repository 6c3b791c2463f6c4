"""A text table's columns found and turned into numbers: times, inputs, poses, runs, rows to keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import FileFlaw, LogError
from oed.foundation.files import no_such_file
from oed.kernel.dynamics.system import System
from oed.logs.drive import Relative
from oed.logs.motions import QUANTITIES, inverted
from oed.logs.series import NotInLog, Rows, Series, together
from oed.logs.tables.columns import Column, PoseColumn, PoseColumns, TimeColumn, unit_factor
from oed.logs.tables.input_columns import InputColumn, input_columns
from oed.logs.tables.motion_columns import ENTRIES, RelativePoseColumns
from oed.logs.tables.table import Table, read_table
from oed.logs.tables.tum import read_tum

if TYPE_CHECKING:
    from oed.logs.tables.csv_form import CsvForm

Key = tuple[str, ...]
"""Path of a column's key in the study's key `log`."""
Clock = tuple[Key, TimeColumn]
Wanted = float | str | tuple[float, float]
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
    """

    table: Table | None
    series: Series
    clock: int = 0
    places: tuple[int, ...] = ()
    runs: list[str] | None = None

    def require_filled(self, series: Series, rows: Rows) -> None:
        """Refuse empty cells in these rows, whose numbers are `series`.

        Raises:
            LogError: names each of them.
        """
        empty = np.isnan(np.column_stack([series.times, series.values]))
        if self.table is None or not empty.any():
            return
        places = (self.clock, *self.places)
        raise LogError([self.table.cell_flaw(int(rows[row]), places[at]) for row, at in np.argwhere(empty)])


@dataclass(frozen=True)
class Sheet:
    """A log's table as numbers.

    Attributes:
        inputs: as logged, one column per input of the robot.
        poses: of the same table or of a file of their own, SI.
        quantities: the states that the poses are.
        columns: of the inputs, which know how to integrate them.
        same_rows: whether the poses are columns of the same table.
        own_clock: whether the poses have a clock of their own.
        relative: of motions in place of poses, as `RecordedDrive` has it.
        kept: rows of the table whose poses are wanted.
        cut_off: whether the table breaks off in its last line.
    """

    inputs: ColumnBlock
    poses: ColumnBlock
    quantities: tuple[str, ...]
    columns: tuple[InputColumn, ...]
    same_rows: bool
    own_clock: bool
    relative: Relative | None
    kept: Bools
    cut_off: bool


def read_sheet(table: Table, form: CsvForm, model: System) -> Sheet:
    """Find the columns and read them.

    Args:
        table: the log's.
        form: which columns are what.
        model: the robot that drove.

    Raises:
        LogError: columns that are not there, and cells that are no numbers.
    """
    beside, clock = form.reference.beside(Path(table.file)), form.reference.clock
    columns = dict(zip(model.input_names, input_columns(form.inputs, model), strict=True))
    own_clock = _skipping(form.skip_invalid_rows, beside is None and clock is not None)
    inputs, (quantities, poses), kept = together(
        [
            lambda: _read_block(table, _clock(form), _under("inputs", columns), form.runs, own_clock),
            lambda: _read_reference(table, beside, form, model),
            lambda: _kept(table, form.keep, form.skip_invalid_rows),
        ]
    )
    return Sheet(
        inputs=inputs,
        poses=poses,
        quantities=quantities,
        columns=tuple(columns.values()),
        same_rows=beside is None,
        own_clock=beside is not None or clock is not None,
        relative=_relative(form),
        kept=kept,
        cut_off=table.cut_off,
    )


def _read_block(
    table: Table, clock_of: Clock, columns: Mapping[Key, Column], runs: Column | None, own_clock: bool | None
) -> ColumnBlock:
    # Rows with cells that are no numbers are refused, or skipped where it is said whose clock it is.
    skip, (key, time) = own_clock is not None, clock_of
    read = [partial(_read, table, column, of_column, skip) for of_column, column in columns.items()]
    try:
        clock, *found, labels = together(
            [partial(_read, table, time, key, skip), *read, partial(_run_labels, table, runs)]
        )
    except LogError as error:
        raise LogError([*error.flaws, *_clock_flaws(table, time, runs)]) from None
    series = _series(table, time, clock, [numbers for _, numbers in found])
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
    for place in places:
        none = np.flatnonzero(np.isnan(table.numbers(place)[0]))
        cells = table.texts(place) if len(none) else []
        wrong[[row for row in none.tolist() if cells[row]]] = True
    missing = np.isnan(np.column_stack([series.times, series.values]))
    looked_at = missing if own_clock else missing[:, 1:]
    some = looked_at.any(axis=1) & ~looked_at.all(axis=1)
    return wrong | some | (missing[:, 0] & (not own_clock))


def _clock_flaws(table: Table, time: TimeColumn, runs: Column | None) -> list[FileFlaw]:
    # What is wrong with the times of a single run is named along with what is wrong with the numbers.
    with suppress(LogError):
        if _run_labels(table, runs) is not None:
            return []
    with suppress(LogError):
        clock = _read(table, time, ("time",))
        rows = distinct_rows(table, clock[1], np.arange(len(table.rows)))
        return _series(table, time, clock, ()).rows(rows).clock_flaws()
    return []


def _series(table: Table, time: TimeColumn, clock: tuple[int, Array], columns: Sequence[Array]) -> Series:
    values = np.array(columns).reshape(len(columns), len(table.rows)).T
    return Series(table.file, table.label(clock[0]), time.factor * clock[1], values, table.lines)


def _read(table: Table, column: Column, key: Key, skip: bool = False) -> tuple[int, Array]:
    place = table.place(column.column, *key, "column")
    return place, _numbers(table, place, skip)


def _numbers(table: Table, place: int, skip: bool = False) -> Array:
    values, flaws = table.numbers(place)
    if len(flaws) == len(values) or (flaws and not skip):
        raise LogError(flaws)
    return values


def _run_labels(table: Table, runs: Column | None) -> list[str] | None:
    if runs is None:
        return table.texts(table.header.index(RUN)) if RUN in table.header else None
    return table.texts(table.place(runs.column, "runs", "column"))


def _read_reference(
    table: Table, beside: Path | None, form: CsvForm, model: System
) -> tuple[tuple[str, ...], ColumnBlock]:
    given, key = form.reference, "poses" if form.relative_poses is None else "relative_poses"
    runs = form.runs
    if beside is not None and not beside.exists():
        named = ("log", key, "file")
        hint = "; `{stem}` stands for the log's own" if "{" in beside.name else ""
        raise LogError([NotInLog(str(beside), 0, 0, "file", f"{no_such_file(beside)}{hint}", named)])
    if beside is not None and isinstance(given, PoseColumns) and given.is_tum:
        return tuple(given.columns), _read_tum(beside, given, form.skip_invalid_rows)
    if beside is not None:
        table = read_table(beside, given.delimiter, given.header)
        # A file of poses need not know of runs, even where the log does.
        runs = runs if runs is not None and runs.column in table.header else None
    own_clock = _skipping(form.skip_invalid_rows, beside is not None or given.clock is not None)
    if isinstance(given, PoseColumns):
        columns = _pose_columns(table, given, model)
        block = _read_block(table, _reference_clock(form), _under(key, columns), runs, own_clock)
        units = dict(zip(model.states, model.state_units, strict=True))
        factors = [unit_factor(column.unit, units[name]) for name, column in columns.items()]
        return tuple(columns), replace(block, series=block.series.with_values(block.series.values * factors))
    block = _read_block(table, _reference_clock(form), _motion_columns(given), runs, own_clock)
    return QUANTITIES, replace(block, series=_motion_series(block, given))


def _motion_columns(given: RelativePoseColumns) -> dict[Key, Column]:
    columns: dict[Key, Column] = {} if given.t0 is None else {("relative_poses", "t0"): given.t0}
    columns |= _under("relative_poses", given.columns)
    for name, one in given.covariance or ():
        if one is not None:
            columns["relative_poses", "covariance", name] = one
    return columns


def _motion_series(block: ColumnBlock, given: RelativePoseColumns) -> Series:
    # When each motion began, what it was, and the entries of its covariance that there are no columns of.
    series = block.series
    if given.t0 is not None:
        begins, values = given.t0.factor * series.values[:, 0], series.values[:, 1:]
    else:
        begins, values = _before(series, block.runs), series.values
    if given.covariance is not None:
        names = [name for name, one in given.covariance if one is not None]
        none = np.where(np.isnan(values[:, 0]), np.nan, 0.0)
        own = dict(zip(names, values[:, 3:].T, strict=True))
        values = np.column_stack([values[:, :3], *(own.get(name, none) for name in ENTRIES)])
    values = values * given.factors
    if given.inverse:
        values[:, :3] = inverted(values[:, :3])
    return series.with_values(np.column_stack([begins, values]))


def _before(series: Series, runs: list[str] | None) -> Array:
    # The time of the row with numbers before each row of the same run; of the first its own.
    begins = np.full(len(series), np.nan)
    filled = np.flatnonzero(~np.isnan(np.column_stack([series.times, series.values])).any(axis=1))
    labels = np.array(runs)[filled] if runs is not None else np.zeros(len(filled))
    for label in np.unique(labels):
        rows = filled[labels == label]
        begins[rows] = series.times[np.concatenate([rows[:1], rows[:-1]])]
    return begins


def _read_tum(file: Path, poses: PoseColumns, skip: bool) -> ColumnBlock:
    factor = 1.0 if poses.time is None else poses.time.factor
    return ColumnBlock(None, read_tum(file, tuple(poses.columns), factor, skip=skip))


def _pose_columns(table: Table, poses: PoseColumns, model: System) -> dict[str, PoseColumn]:
    # Further states of the robot are read by their names where the table has them.
    by_name = {name: PoseColumn(column=name) for name in model.states[3:] if name in table.header}
    known = by_name | poses.columns
    return {name: known[name] for name in model.states if name in known}


def _kept(table: Table, keep: Mapping[str, Wanted], skip: bool) -> Bools:
    kept = np.ones(len(table.rows), dtype=bool)
    for name, wanted in keep.items():
        place = table.place(name, "keep", name)
        if isinstance(wanted, str):
            kept &= np.array([cell == wanted for cell in table.texts(place)])
            continue
        low, high = wanted if isinstance(wanted, tuple) else (wanted, wanted)
        values = _numbers(table, place, skip)
        kept &= (values >= low) & (values <= high)
    if not kept.any():
        said = (f"{name} {_in_words(one)}" for name, one in keep.items())
        text = f"no row has {' and '.join(said)}"
        raise LogError([NotInLog(table.file, 0, 0, "keep", text, ("log", "keep"))])
    return kept


def _in_words(wanted: Wanted) -> str:
    return f"from {wanted[0]:g} to {wanted[1]:g}" if isinstance(wanted, tuple) else f"= {wanted}"


def distinct_rows(table: Table, times: Array, rows: Rows) -> Rows:
    """The rows without those that repeat the one before, cell by cell, time and all.

    Args:
        table: the log's.
        times: of its rows, (n,).
        rows: to be looked at.
    """
    same = np.flatnonzero(np.diff(times[rows]) == 0) + 1
    return np.delete(rows, [row for row in same if table.rows[rows[row]] == table.rows[rows[row - 1]]])
