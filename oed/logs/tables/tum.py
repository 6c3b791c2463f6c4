"""Trajectories in TUM format, as evo and many trackers write them: timestamp, position, quaternion."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import FileIssue, LogError
from oed.logs.series import Series, shortened
from oed.logs.tables.table import BLANKS, read_table

NAMES = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
"""Columns of the format."""
OFF_UNIT = 0.05
"""Difference of a quaternion's length from 1 beyond which it is none: far above rounding in files."""


def read_tum(
    file: Path,
    quantities: tuple[str, ...],
    factor: float = 1.0,
    *,
    skip: bool = False,
    comment: str | None = None,
) -> Series:
    """Poses in the plane from a TUM file.

    Args:
        file: rows `timestamp tx ty tz qx qy qz qw`, blanks between; comments are as `read_table` has them.
        quantities: which of x, y, heading to keep.
        factor: seconds in a unit of the timestamps.
        skip: whether rows without finite numbers are emptied instead of refused.
        comment: text that lines begin with which are comments.

    Raises:
        LogError: every mistake in the file, each with its line.
    """
    table = read_table(file, BLANKS, header=False, comment=comment)
    if table.width != len(NAMES):
        text = f"expected {len(NAMES)} columns ({' '.join(NAMES)}), got {table.width}"
        raise LogError([FileIssue(str(file), int(table.lines[0]), 0, "", text)])
    unknown = [name for name in quantities if name not in ("x", "y", "heading")]
    if unknown:
        raise LogError.about(file, f"a TUM file has no {', '.join(unknown)}, only x, y and heading")
    read = [table.numbers(place) for place in range(len(NAMES))]
    issues = [issue for _, found in read for issue in found]
    values = np.column_stack([column for column, _ in read])
    if not issues:
        issues = [table.cell_issue(row, place) for row, place in np.argwhere(np.isnan(values)).tolist()]
    invalid = np.asarray(np.isnan(values).any(axis=1))
    if skip and not invalid.all():
        issues = []
    with np.errstate(over="ignore"):
        sizes = np.linalg.norm(values[:, 4:], axis=1)
    for row in np.flatnonzero(np.abs(sizes - 1) > OFF_UNIT):
        text = "expected a unit quaternion in qx qy qz qw"
        issues.append(FileIssue(str(file), int(table.lines[row]), 5, "qx", text))
    if issues:
        raise LogError(shortened(issues))
    known = {"x": values[:, 1], "y": values[:, 2], "heading": heading_of(values[:, 4:])}
    poses = np.column_stack([known[name] for name in quantities])
    return Series(str(file), NAMES[0], factor * values[:, 0], poses, table.lines).emptied(invalid)


def heading_of(quaternions: Array) -> Array:
    """Yaw (n,) [rad] of unit quaternions (n, 4) in the order x, y, z, w."""
    x, y, z, w = quaternions.T
    return np.asarray(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
