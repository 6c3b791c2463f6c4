"""The drives in a table of numbers: its rows split into runs and kept stretches, its inputs integrated."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from oed.foundation.arrays import Bools
from oed.foundation.errors import LogError
from oed.kernel.dynamics.system import System
from oed.logs.drive import CUT_OFF, FEWEST, MARGIN, RecordedDrive
from oed.logs.findings import gap_limit
from oed.logs.log import Finding
from oed.logs.series import Rows, Series, together
from oed.logs.tables.sheet import Sheet, distinct_rows


def drives_in(sheet: Sheet, model: System, gap: float | None = None) -> list[RecordedDrive]:
    """Every run of a table, and every stretch of it of which nothing is left out.

    Args:
        sheet: the table's numbers.
        model: the robot.
        gap: a longer time of rows left out ends a stretch [s]; five median steps if None.

    Raises:
        LogError: empty cells where numbers are needed, clocks that do not rise, counters that jump.
    """
    found = list(_runs(sheet.inputs.runs, len(sheet.inputs.series)))
    runs = [_Run(sheet, model, label, rows, len(found)) for label, rows in found]
    drives: list[RecordedDrive] = [*itertools.chain(*together(partial(run.drives, gap) for run in runs))]
    if sheet.cut_off:
        drives[-1] = drives[-1].with_found(Finding("cut_off", CUT_OFF))
    return drives


def _runs(labels: list[str] | None, count: int) -> Iterator[tuple[str | None, Rows]]:
    # In the order of their first appearance.
    if labels is None:
        yield None, np.arange(count)
        return
    names, numbers = np.unique(np.array(labels), return_inverse=True)
    together = np.split(np.argsort(numbers, kind="stable"), np.cumsum(np.bincount(numbers))[:-1])
    for rows in sorted(together, key=lambda rows: int(rows[0])):
        yield str(names[numbers[rows[0]]]), rows


class _Run:
    """Rows of a sheet that are one run."""

    def __init__(self, sheet: Sheet, model: System, label: str | None, rows: Rows, runs: int) -> None:
        """Keep what it is, and how many runs there are in all."""
        self.sheet, self.model, self.label, self.runs = sheet, model, label, runs
        stem = Path(sheet.inputs.series.file).stem
        self.name = stem if label is None else f"{stem}[{label}]"
        assert sheet.inputs.table is not None
        self.table = sheet.inputs.table
        self.rows = distinct_rows(self.table, sheet.inputs.series.times, rows)
        self.repeated = len(rows) - len(self.rows)

    def drives(self, gap: float | None) -> list[RecordedDrive]:
        """The run whole, or the stretches of it that are kept."""
        inputs, poses = together([self._inputs, self._poses])
        if len(inputs) and self.runs > 1 and not self.sheet.same_rows and self.sheet.poses.runs is None:
            poses = _within(poses, inputs.times[0] - MARGIN, inputs.times[-1] + MARGIN)
        whole = self._integrated(inputs, poses).with_found(*self._found(poses))
        return self._stretches(whole, gap)

    def _found(self, poses: Series) -> Iterator[Finding]:
        if self.repeated:
            text = f"{self.repeated} row(s) repeat the one before, time and all; left out"
            yield Finding("duplicate_rows", text)
        empty = int(self.sheet.kept[self.rows].sum()) - len(poses) if self.sheet.same_rows else 0
        if not self.sheet.own_clock and empty:
            yield Finding("empty_poses", f"{empty} of {len(self.rows)} rows have no pose")

    def _inputs(self) -> Series:
        # Rows of another clock have no time of the inputs; rows that have only a pose have no inputs.
        block, rows = self.sheet.inputs, self.rows
        if (self.sheet.own_clock and self.sheet.same_rows) or block.series.skipped:
            rows = _with_anything(block.series, rows)
        first, last = _ends_needed(self.sheet, self.model)
        rows = _with_inputs(block.series.values[rows], rows, bool(first.any()), bool(last.any()))
        series = block.series.rows(rows)
        if len(series):
            values = series.values.copy()
            values[0, ~first & np.isnan(values[0])] = 0.0
            values[-1, ~last & np.isnan(values[-1])] = 0.0
            series = series.with_values(values)
        block.require_filled(series, rows)
        return series

    def _poses(self) -> Series:
        block = self.sheet.poses
        if self.sheet.same_rows:
            rows = self.rows
        elif block.runs is not None:
            rows = np.flatnonzero(np.array(block.runs) == self.label)
        else:
            rows = np.arange(len(block.series))
        rows = rows[self.sheet.kept[rows]]
        if self.sheet.own_clock:
            rows = _with_anything(block.series, rows)
        elif self.sheet.quantities:
            rows = rows[~np.isnan(block.series.values[rows]).all(axis=1)]
        else:
            # Without poses the times alone, until those of other sensors are known.
            rows = rows[~np.isnan(block.series.times[rows])]
        series = block.series.rows(rows)
        block.require_filled(series, rows)
        return series.without_repeats() if self.sheet.own_clock else series

    def _integrated(self, inputs: Series, poses: Series) -> RecordedDrive:
        sheet, model = self.sheet, self.model
        # Without rows there is nothing to integrate.
        turned, said = sheet.columns.turned(inputs, model) if len(inputs) else ([], ())
        issues = inputs.clock_issues() + [issue for one in turned for issue in one.issues]
        if issues:
            raise LogError(issues)
        values = np.zeros((0, len(model.inputs)))
        if turned:
            values = np.column_stack([one.integral for one in turned])
        wraps = sum(one.wraps for one in turned)
        found = (Finding("counter_wrapped", f"counters began anew {wraps} times; unwrapped"),)
        return RecordedDrive(
            name=self.name,
            names=model.input_names,
            inputs=inputs.with_values(values),
            poses=poses,
            quantities=sheet.quantities,
            driving=np.array([entry.drives for entry in model.inputs]),
            bridged=np.array([one.bridges for one in turned] or [False] * len(model.inputs)),
            one_clock=not sheet.own_clock,
            found=found if wraps else (),
            relative=sheet.relative,
        ).with_found(*said)

    def _stretches(self, whole: RecordedDrive, gap: float | None) -> list[RecordedDrive]:
        # What is left out for a while is not driven across: what comes after it is a drive of its own.
        left_out = self.table.left_out
        if left_out is None or len(whole.inputs) < FEWEST:
            return [whole]
        times, before = self.sheet.inputs.series.times[self.rows], left_out[self.rows]
        timed = ~np.isnan(times)
        times, before = times[timed], before[timed]
        lost = np.diff(before) > 0
        if not self.sheet.columns.needs_every_row:
            lost &= np.diff(times) > gap_limit(whole.inputs.times, gap)
        spans = [(own[0], own[-1]) for own in np.split(times, np.flatnonzero(lost) + 1)]
        many = len(spans) > 1
        return [
            _cut(whole, start, end, f"{whole.name}.{number}" if many else whole.name)
            for number, (start, end) in enumerate(spans, start=1)
        ]


def _with_anything(series: Series, rows: Rows) -> Rows:
    # Rows of another clock have neither time nor values; those that have one of them lack the other.
    return rows[~(np.isnan(series.times[rows]) & np.isnan(series.values[rows]).all(axis=1))]


def _ends_needed(sheet: Sheet, model: System) -> tuple[Bools, Bools]:
    first, last = np.array(sheet.columns.ends_needed(model), dtype=bool).T
    return first, last


def _with_inputs(values: np.typing.NDArray[np.float64], rows: Rows, first: bool, last: bool) -> Rows:
    # The rows that have inputs, and the time at which those begin or end where that needs no inputs.
    filled = np.flatnonzero(~np.isnan(values).all(axis=1))
    if not len(filled):
        return rows[:0]
    begin = filled[0] - (not first and filled[0] > 0)
    end = filled[-1] + (not last and filled[-1] + 1 < len(rows))
    wanted = np.zeros(len(rows), dtype=bool)
    wanted[[begin, end]] = wanted[filled] = True
    return np.asarray(rows[wanted])


def _within(series: Series, start: float, end: float) -> Series:
    return series.rows((series.times >= start) & (series.times <= end))


def _cut(drive: RecordedDrive, start: float, end: float, name: str) -> RecordedDrive:
    inputs = _within(drive.inputs, start, end)
    inputs = inputs.with_values(inputs.values - inputs.values[:1])
    return replace(drive, name=name, inputs=inputs, poses=_within(drive.poses, start, end))
