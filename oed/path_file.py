"""Trajectory CSV files: one row per sample, the pose at its start and the inputs held during it."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from oed.errors import FileFlaw, PathFileError
from oed.files import write_text
from oed.problem import Problem
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]

EVEN = 1e-3
"""Share of the period by which a row's time may be off the even grid."""


def trajectory_csv(problem: Problem, trajectory: Trajectory, poses: Array) -> str:
    """The CSV text of a trajectory whose poses at the samples are `poses` (N + 1, states)."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["t", *problem.model.input_names, *problem.model.states])
    times = np.linspace(0.0, trajectory.duration, trajectory.samples + 1)
    inputs = trajectory.inputs
    for index, time in enumerate(times):
        held = (
            [repr(float(value)) for value in inputs[index]] if index < len(inputs) else [""] * inputs.shape[1]
        )
        writer.writerow([_time_text(float(time)), *held, *(repr(float(value)) for value in poses[index])])
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
    rows, name = _rows(file), str(file)
    names = problem.model.input_names
    _check_header(name, rows[0], names)
    header = [cell.strip() for cell in rows[0]]
    times = _column(name, rows, header, "t", last_may_be_empty=False)
    columns = [_column(name, rows, header, entry, last_may_be_empty=True) for entry in names]
    inputs = np.column_stack(columns)
    # The last row holds the final pose only, with empty inputs.
    inputs = inputs[:-1] if np.isnan(inputs[-1]).all() else inputs
    if np.isnan(inputs).any() or len(inputs) < 2:
        line = int(np.argwhere(np.isnan(inputs))[0][0]) + 2 if np.isnan(inputs).any() else 2
        text = f"expected numbers for {', '.join(names)} in at least two rows"
        raise PathFileError([FileFlaw(name, line, 0, "", text)])
    duration = _duration(name, times, len(inputs))
    return Trajectory.from_samples(
        inputs, duration, _start(name, rows, header, problem), rest_to_rest=problem.design.rest_to_rest
    )


def _rows(file: str | Path) -> list[list[str]]:
    name = str(file)
    try:
        with open(file, encoding="utf-8", newline="") as handle:
            rows = [row for row in csv.reader(handle) if row]
    except FileNotFoundError:
        raise PathFileError([FileFlaw(name, 0, 0, "", "no such file")]) from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise PathFileError([FileFlaw(name, 0, 0, "", f"cannot be read: {error}")]) from None
    if len(rows) < 3:
        raise PathFileError([FileFlaw(name, 1, 0, "", "expected a header and at least two rows")])
    return rows


def _check_header(name: str, header: Sequence[str], inputs: Sequence[str]) -> None:
    present = [cell.strip() for cell in header]
    missing = [column for column in ("t", *inputs) if column not in present]
    if missing:
        text = f"the header lacks {', '.join(missing)}; it has {', '.join(present)}"
        raise PathFileError([FileFlaw(name, 1, 0, "", text)])


def _column(
    name: str, rows: list[list[str]], header: Sequence[str], column: str, *, last_may_be_empty: bool
) -> Array:
    index, flaws, values = header.index(column), [], []
    for line, row in enumerate(rows[1:], start=2):
        cell = row[index].strip() if index < len(row) else ""
        if not cell and last_may_be_empty and line == len(rows):
            values.append(math.nan)
            continue
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            flaws.append(FileFlaw(name, line, 0, column, f"expected a finite number, got {cell!r}"))
        values.append(value)
    if flaws:
        raise PathFileError(flaws)
    return np.array(values)


def _duration(name: str, times: Array, samples: int) -> float:
    # With a last row for the final pose the times span the drive; without it one period is missing.
    steps = np.diff(times)
    period = float(steps.mean())
    uneven = np.flatnonzero((np.abs(steps - period) > EVEN * abs(period)) | (steps <= 0))
    if uneven.size:
        line = int(uneven[0]) + 3
        text = f"expected even steps in t of about {period:.6g} s, got {steps[uneven[0]]:.6g} s; resample"
        raise PathFileError([FileFlaw(name, line, 0, "t", text)])
    return period * samples


def _start(name: str, rows: list[list[str]], header: Sequence[str], problem: Problem) -> list[float]:
    states = problem.model.states
    if all(state in header for state in states):
        first = [rows[0], rows[1]]
        return [float(_column(name, first, header, state, last_may_be_empty=False)[0]) for state in states]
    fixed = problem.design.fixed_start
    return [0.0] * len(states) if fixed is None else list(fixed)
