"""Trajectory CSV files: one row per sample, the pose at its start and the inputs held during it."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from oed.errors import FileFlaw, PathFileError
from oed.files import write_text
from oed.problem import Problem
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]

EVEN = 1e-3
"""Share of the period by which a step in time may be off the even grid."""


def trajectory_csv(problem: Problem, trajectory: Trajectory, poses: Array) -> str:
    """The CSV text of a trajectory whose poses at the samples are `poses` (N + 1, states)."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["t", *problem.model.input_names, *problem.model.states])
    times = np.linspace(0.0, trajectory.duration, trajectory.samples + 1)
    held = [[repr(float(value)) for value in row] for row in trajectory.inputs]
    held.append([""] * len(problem.model.inputs))
    for time, inputs, pose in zip(times, held, poses, strict=True):
        writer.writerow([_time_text(float(time)), *inputs, *(repr(float(value)) for value in pose)])
    return buffer.getvalue()


def _time_text(time: float) -> str:
    return f"{time:.9f}".rstrip("0").rstrip(".") or "0"


def write_trajectory(path: Path, problem: Problem, trajectory: Trajectory, poses: Array) -> None:
    """Write a trajectory CSV."""
    write_text(path, trajectory_csv(problem, trajectory, poses))


def read_trajectory(file: str | Path, problem: Problem) -> Trajectory:
    """The drive in a CSV: its own duration and samples, started at its first pose (or the study's start).

    Needed are `t` and the robot's inputs; the poses of later rows follow from those and are not read.

    Raises:
        PathFileError: every mistake in the file, each with its line.
    """
    table = _read(file, ("t", *problem.model.input_names))
    first = _Table(table.name, table.header, table.lines[:1], table.rows[:1])
    states = [state for state in problem.model.states if state in table.header]
    given = states if len(states) == len(problem.model.states) else []
    columns, flaws = _columns(table, ("t",), last_may_be_empty=False)
    inputs, more = _columns(table, problem.model.input_names, last_may_be_empty=True)
    start, still_more = _columns(first, given, last_may_be_empty=False)
    if flaws or more or still_more:
        raise PathFileError(sorted([*flaws, *more, *still_more], key=lambda flaw: (flaw.line, flaw.key)))
    # The last row holds the final pose only, with empty inputs.
    rows = inputs[:-1] if np.isnan(inputs[-1]).all() else inputs
    if np.isnan(rows).any() or len(rows) < 2:
        text = f"expected numbers for {', '.join(problem.model.input_names)} in at least two rows"
        line = table.lines[-1] if np.isnan(rows).any() else table.lines[0]
        raise PathFileError([FileFlaw(table.name, line, 0, "", text)])
    duration = _period(table, columns[:, 0]) * len(rows)
    pose = start[0] if given else problem.design.fixed_start or np.zeros(len(problem.model.states))
    return Trajectory.from_samples(rows, duration, pose, rest_to_rest=problem.design.rest_to_rest)


@dataclass(frozen=True)
class _Table:
    """A CSV's header, and its rows with the lines they stand in."""

    name: str
    header: list[str]
    lines: list[int]
    rows: list[list[str]]


def _read(file: str | Path, needed: Sequence[str]) -> _Table:
    name = str(file)
    try:
        # Spreadsheets begin a file with a byte-order mark.
        with open(file, encoding="utf-8-sig", newline="") as handle:
            reader = csv.reader(handle)
            numbered = [(reader.line_num, row) for row in reader if row]
    except FileNotFoundError:
        raise PathFileError([FileFlaw(name, 0, 0, "", "no such file")]) from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise PathFileError([FileFlaw(name, 0, 0, "", f"cannot be read: {error}")]) from None
    if len(numbered) < 3:
        raise PathFileError([FileFlaw(name, 1, 0, "", "expected a header and at least two rows")])
    header = [cell.strip() for cell in numbered[0][1]]
    missing = [column for column in needed if column not in header]
    if missing:
        text = f"the header lacks {', '.join(missing)}; it has {', '.join(header)}"
        raise PathFileError([FileFlaw(name, numbered[0][0], 0, "", text)])
    lines, rows = zip(*numbered[1:], strict=True)
    return _Table(name, header, list(lines), list(rows))


def _columns(
    table: _Table, columns: Sequence[str], *, last_may_be_empty: bool
) -> tuple[Array, list[FileFlaw]]:
    # (rows, columns); not-a-number where the last row is empty.
    values, flaws = np.full((len(table.rows), len(columns)), math.nan), []
    for place, column in enumerate(columns):
        index = table.header.index(column)
        for number, (line, row) in enumerate(zip(table.lines, table.rows, strict=True)):
            cell = row[index].strip() if index < len(row) else ""
            if not cell and last_may_be_empty and number == len(table.rows) - 1:
                continue
            value = _number(cell)
            if value is None:
                flaws.append(FileFlaw(table.name, line, 0, column, f"expected a finite number, got {cell!r}"))
            else:
                values[number, place] = value
    return values, flaws


def _number(cell: str) -> float | None:
    try:
        value = float(cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _period(table: _Table, times: Array) -> float:
    # The median step is the period even where a row is missing or doubled, and tells which.
    steps = np.diff(times)
    period = float(np.median(steps))
    uneven = np.flatnonzero((np.abs(steps - period) > EVEN * abs(period)) | (steps <= 0))
    if uneven.size:
        step = int(uneven[0])
        text = f"expected even steps in t of {period:.6g} s, got {steps[step]:.6g} s; resample the path"
        raise PathFileError([FileFlaw(table.name, table.lines[step + 1], 0, "t", text)])
    return float(times[-1] - times[0]) / len(steps)
