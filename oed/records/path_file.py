"""Trajectory CSV files: one row per sample, the pose at its start and the inputs held during it."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.errors import FileIssue, PathFileError
from oed.foundation.files import text_of, write_text
from oed.foundation.quantities import LARGEST, plain_number, too_large
from oed.foundation.shown import written
from oed.kernel.dynamics.spline import clamped_knots, repeated_knots
from oed.kernel.dynamics.system import System
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.problem import Problem
from oed.records.settings_file import read_settings, settings_csv

EVEN = 1e-3
"""Share of the period by which a step in time may be off the even grid."""


def trajectory_csv(problem: Problem, trajectory: Trajectory, poses: Array) -> str:
    """The CSV text of a trajectory whose poses at the samples are `poses` (N + runs, states).

    Several runs follow each other, told apart by a first column `run`, each on its own clock.

    Args:
        problem: that names inputs and states.
        trajectory: the drive.
        poses: at the samples, (N + runs, states).
    """
    return drive_csv(trajectory, poses, problem.model.input_names, problem.model.states)


def clock_of(names: Sequence[str]) -> str:
    """What the column of times is called beside columns of these names: "t", unless one of them is."""
    return "time" if "t" in names else "t"


def drive_csv(trajectory: Trajectory, poses: Array, inputs: Sequence[str], states: Sequence[str]) -> str:
    """The CSV text of a trajectory, as `trajectory_csv` writes it.

    Args:
        trajectory: the drive.
        poses: at the samples, (N + runs, states).
        inputs: their names.
        states: their names.
    """
    if not states:
        return settings_csv(trajectory.inputs, inputs)
    buffer, runs = io.StringIO(), trajectory.runs
    writer = csv.writer(buffer, lineterminator="\n")
    first = ["run"] if runs > 1 else []
    writer.writerow([*first, clock_of([*inputs, *states]), *inputs, *states])
    times = np.linspace(0.0, trajectory.duration / runs, trajectory.samples // runs + 1)
    nothing = [[""] * len(inputs)]
    each = zip(np.split(trajectory.inputs, runs), np.split(poses, runs), strict=True)
    for run, (rows, own_poses) in enumerate(each, start=1):
        held = [*([repr(float(value)) for value in row] for row in rows), *nothing]
        number = [str(run)] if runs > 1 else []
        for time, inputs, pose in zip(times, held, own_poses, strict=True):
            numbers = (repr(float(value)) for value in pose)
            writer.writerow([*number, f"{time:.9f}".rstrip("0").rstrip(".") or "0", *inputs, *numbers])
    return buffer.getvalue()


@typed
def write_trajectory(path: Path, problem: Problem, trajectory: Trajectory, poses: Array) -> None:
    """Write a trajectory CSV.

    Args:
        path: of the file.
        problem: that names inputs and states.
        trajectory: the drive.
        poses: at the samples, (N + runs, states).

    Raises:
        UserMistake, Failure: as `write_text` does.
    """
    write_text(path, trajectory_csv(problem, trajectory, poses))


@typed
def read_trajectory(file: str | Path, problem: Problem) -> Trajectory:
    """The drive in a CSV: its own duration and samples, started at its first pose (or the study's start).

    Needed are `t` and the robot's inputs, for a study with several runs also `run`; the poses of later rows
    follow from those and are not read.

    Raises:
        PathFileError: every mistake in the file, each with its line.
    """
    model, space = problem.model, problem.design
    if not model.states:
        return read_settings(str(file), model.input_names)
    clock = clock_of([*model.input_names, *model.states])
    table = _read(file, (clock, *model.input_names), model)
    parts = _by_run(table, problem.design.runs)
    read = [_read_run(part, problem, clock) for part in parts]
    issues = [issue for one in read if isinstance(one, list) for issue in one]
    if issues:
        raise PathFileError(sorted(issues, key=lambda issue: (issue.line, issue.key)))
    runs = [one for one in read if isinstance(one, _Run)]
    for part, run in zip(parts[1:], runs[1:], strict=True):
        _require_alike(part, run, runs[0])
    given = [run.start for run in runs if run.start is not None]
    starts = np.array(given) if len(given) == len(runs) else problem.fixed_starts
    inputs, duration = np.vstack([run.inputs for run in runs]), sum(run.duration for run in runs)
    if starts is None:
        starts = problem.start_states(np.zeros((len(runs), model.chosen_states)))
    if space.stores_steps or space.only is not None:
        # Such experiments are steps, which a file has all of.
        own = clamped_knots(duration / len(runs), len(inputs) // len(runs), 0)
        return Trajectory(
            repeated_knots(own, 0, len(runs)), 0, inputs, np.asarray(starts), len(inputs), len(runs)
        )
    return Trajectory.from_samples(inputs, duration, starts, rest_to_rest=space.rest_to_rest, runs=len(runs))


@dataclass(frozen=True)
class _Run:
    """One run of a path: inputs (N, inputs) held, duration [s], start state where the file gives one."""

    inputs: Array
    duration: float
    start: Array | None


def _require_alike(table: _Table, run: _Run, first: _Run) -> None:
    # All runs share one duration and number of periods.
    count, expected = len(run.inputs), len(first.inputs)
    if count != expected:
        text = f"expected {expected} periods, as in the first run, got {count}"
    elif abs(run.duration - first.duration) > EVEN * first.duration / expected:
        text = f"expected {first.duration:.6g} s, as in the first run, got {run.duration:.6g} s"
    else:
        return
    raise PathFileError([table.issue(0, "run", text)])


def _by_run(table: _Table, expected: int) -> list[_Table]:
    # The rows of each run, in the order of their first appearance.
    if "run" not in table.header:
        numbers = [""] * len(table.rows)
    else:
        place = table.header.index("run")
        numbers = [row[place].strip() if place < len(row) else "" for row in table.rows]
    names = list(dict.fromkeys(numbers))
    if len(names) != expected:
        text = f"expected {expected} run(s), as the study has, told apart by a column `run`; got {len(names)}"
        raise PathFileError([table.issue(0, "run", text)])
    chosen = [[index for index, number in enumerate(numbers) if number == name] for name in names]
    return [table.some(rows) for rows in chosen]


def _read_run(table: _Table, problem: Problem, clock: str) -> _Run | list[FileIssue]:
    model = problem.model
    if len(table.rows) < 2:
        return [FileIssue(table.name, table.lines[0], 0, "run", "expected at least two rows of a run")]
    states = [state for state in model.states if state in table.header]
    given = states if len(states) == len(model.states) else []
    last = len(table.rows) - 1
    times, issues = _columns(table, (clock,))
    inputs, more = _columns(table, model.input_names, may_be_empty=range(last, last + 1))
    # Only the start counts; but what is no number shows that the file is damaged.
    starts, still_more = _columns(table, given, may_be_empty=range(1, last + 1), blanks=("", "nan"))
    issues = [*issues, *more, *still_more] or _cut_short(table, inputs, states, problem)
    if issues:
        return issues
    # The last row holds the final pose only, with empty inputs.
    rows = inputs[:-1] if np.isnan(inputs[-1]).all() else inputs
    if np.isnan(rows).any() or len(rows) < 2:
        text = f"expected numbers for {', '.join(model.input_names)} in at least two rows"
        return [table.issue(-1 if np.isnan(rows).any() else 0, "", text)]
    return _Run(rows, _period(table, times[:, 0]) * len(rows), starts[0] if given else None)


def _cut_short(table: _Table, inputs: Array, states: Sequence[str], problem: Problem) -> list[FileIssue]:
    # Rows of other lengths than the header, and a file that does not end as a whole one does.
    width = len(table.header)
    uneven = [row for row, cells in enumerate(table.rows) if len(cells) != width]
    if uneven:
        text = "expected {} cells, as in the header, got {}; is the file cut short?"
        return [table.issue(row, "", text.format(width, len(table.rows[row]))) for row in uneven]
    if np.isnan(inputs[-1]).any() or (table.ended and not states):
        return []
    # Exported commands end with the one to stop.
    drives = np.array([entry.drives for entry in problem.model.inputs], dtype=bool)
    if table.ended and drives.any() and not inputs[-1, drives].any():
        return []
    final = "pose" if problem.model.velocity_signal else "state"
    held = f"the final {final}" if states else "the time of the end"
    text = f"the last row, with {held} and no inputs, is missing: is the file cut short?"
    return [table.issue(-1, "", text)]


@dataclass(frozen=True)
class _Table:
    """A CSV's header, and its rows with the lines they stand in; whether its last line is ended."""

    name: str
    header: list[str]
    lines: list[int]
    rows: list[list[str]]
    ended: bool

    def some(self, chosen: Sequence[int]) -> _Table:
        """Some of its rows."""
        lines, rows = [self.lines[index] for index in chosen], [self.rows[index] for index in chosen]
        return replace(self, lines=lines, rows=rows)

    def issue(self, row: int, key: str, message: str) -> FileIssue:
        """An issue in a row."""
        return FileIssue(self.name, self.lines[row], 0, key, message)


def _read(file: str | Path, needed: Sequence[str], model: System) -> _Table:
    name, text = str(file), text_of(file, PathFileError, "utf-8-sig")
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line]
    numbered = [(number, _cells(name, number, line)) for number, line in lines]
    if len(numbered) < 3:
        raise PathFileError([FileIssue(name, 1, 0, "", "expected a header and at least two rows")])
    header = [cell.strip() for cell in numbered[0][1]]
    reason = _reason_against(header, needed, model)
    if reason:
        raise PathFileError([FileIssue(name, numbered[0][0], 0, "", reason)])
    places, rows = zip(*numbered[1:], strict=True)
    return _Table(name, header, list(places), list(rows), text.endswith("\n"))


def _cells(name: str, number: int, line: str) -> list[str]:
    # Line by line: a quote that is not closed would swallow the lines after it.
    try:
        return next(csv.reader([line], strict=True))
    except csv.Error as error:
        raise PathFileError([FileIssue(name, number, 0, "", f"cannot be read: {error}")]) from None


def _reason_against(header: Sequence[str], needed: Sequence[str], model: System) -> str:
    missing = [column for column in needed if column not in header]
    # What the file says instead is not repeated: it may be no path at all, and nobody's business.
    what = "a path" if model.velocity_signal else "an experiment"
    lacking = f"the header lacks {', '.join(missing)}; expected {what} with the columns {', '.join(needed)}"
    if missing:
        return lacking
    twice = sorted({column for column in header if column and header.count(column) > 1})
    if twice:
        return f"the header has {', '.join(twice)} twice; which column counts?"
    # A start that is given in part would be taken for one that is not given.
    given = [state for state in model.states if state in header]
    others = [state for state in model.states if state not in header]
    text = f"the header has {', '.join(given)} of the start, but not {', '.join(others)}: give all or none"
    return text if given and others else ""


def _columns(
    table: _Table,
    columns: Sequence[str],
    *,
    may_be_empty: range = range(0),
    blanks: Sequence[str] = ("",),
) -> tuple[Array, list[FileIssue]]:
    # (rows, columns); not-a-number where a row that may be is empty.
    values, issues = np.full((len(table.rows), len(columns)), math.nan), []
    for place, column in enumerate(columns):
        index = table.header.index(column)
        for number, (line, row) in enumerate(zip(table.lines, table.rows, strict=True)):
            cell = row[index].strip() if index < len(row) else ""
            if number in may_be_empty and cell.lower() in blanks:
                continue
            value = _number(cell)
            if value is None:
                issues.append(
                    FileIssue(table.name, line, 0, column, f"expected a finite number, got {written(cell)}")
                )
            elif abs(value) > LARGEST:
                issues.append(FileIssue(table.name, line, 0, column, too_large(value)))
            else:
                values[number, place] = value
    return values, issues


def _number(cell: str) -> float | None:
    value = plain_number(cell)
    return value if value is not None and math.isfinite(value) else None


def _period(table: _Table, times: Array) -> float:
    # The median step is the period even where a row is missing or doubled, and tells which.
    steps = np.diff(times)
    period = float(np.median(steps))
    if period <= 0:
        text = f"expected t to rise, got {times[1]:.6g} s after {times[0]:.6g} s"
        raise PathFileError([table.issue(1, "t", text)])
    uneven = np.flatnonzero((np.abs(steps - period) > EVEN * period) | (steps <= 0))
    if uneven.size:
        step = int(uneven[0])
        text = f"expected even steps in t of {period:.6g} s, got {steps[step]:.6g} s; resample it"
        raise PathFileError([table.issue(step + 1, "t", text)])
    return float(times[-1] - times[0]) / len(steps)
