"""CSV files of experiments with systems without states: one row per setting of the inputs."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import FileIssue, PathFileError
from oed.foundation.files import text_of
from oed.foundation.quantities import plain_number
from oed.foundation.shown import written
from oed.kernel.dynamics.spline import clamped_knots
from oed.kernel.dynamics.trajectory import Trajectory

SETTING = "setting"
"""Column with the settings' numbers."""


def settings_csv(table: Array, inputs: Sequence[str]) -> str:
    """The CSV text of settings (n, inputs), SI, numbered from 1.

    Args:
        table: of the settings.
        inputs: their names.
    """
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow([SETTING, *inputs])
    for number, row in enumerate(table.tolist(), start=1):
        rows.writerow([number, *map(repr, row)])
    return text.getvalue()


def read_settings(file: str, inputs: Sequence[str]) -> Trajectory:
    """The experiment whose settings a CSV has, one after the other; other columns are passed over.

    Args:
        file: its name.
        inputs: names of the columns that are read.

    Raises:
        PathFileError: every mistake in the file, each with its line.
    """
    lines = list(csv.reader(text_of(file, PathFileError, "utf-8-sig").splitlines()))
    header = [cell.strip() for cell in lines[0]] if lines else []
    missing = [name for name in inputs if name not in header]
    if missing:
        raise PathFileError([FileIssue(file, 1, 0, "", f"the header lacks {', '.join(missing)}")])
    numbered = [(number, row) for number, row in enumerate(lines[1:], start=2) if row]
    if not numbered:
        raise PathFileError([FileIssue(file, 1, 0, "", "expected at least one row after the header")])
    places, table, issues = [header.index(name) for name in inputs], list[list[float]](), list[FileIssue]()
    for number, row in numbered:
        cells = [row[place].strip() if place < len(row) else "" for place in places]
        values = [plain_number(cell) for cell in cells]
        issues += [
            FileIssue(file, number, 0, name, f"expected a finite number, got {written(cell)}")
            for name, cell, value in zip(inputs, cells, values, strict=True)
            if value is None or not np.isfinite(value)
        ]
        table.append([value if value is not None else np.nan for value in values])
    if issues:
        raise PathFileError(issues)
    knots = clamped_knots(float(len(table)), len(table), 0)
    return Trajectory(knots, 0, np.array(table), np.zeros((1, 0)), len(table))
