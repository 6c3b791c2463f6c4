"""Rows of several types in one file, each with columns of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from logged import INPUTS, ROBOT, cells, drive, form, found, issue_of, issues_of, read_one

from oed.foundation.errors import ProblemError
from oed.logs import read_logs

WHEELS, POSES = drive(200), drive(100, period=0.1)
RECORDS = {"column": 0, "inputs": "odom", "poses": "mocap"}
PLACES: dict[str, Any] = {"time": 1, "inputs": dict(zip(INPUTS, (2, 3), strict=True))}
RAGGED: dict[str, Any] = {**PLACES, "records": RECORDS, "poses": {"x": 4, "y": 3, "heading": 2}}
"""Poses are in the order heading, y, x, so that no column is that of another type."""


def lines() -> list[list[str]]:
    """Rows of both types by their times, and others."""
    odom = [["odom", *row[:3]] for row in cells(WHEELS)]
    mocap = [["mocap", row[0], row[5], row[4], row[3], "7"] for row in cells(POSES)]
    others = [["battery", row[0], "full"] for row in cells(POSES)[::30]]
    return sorted([*odom, *mocap, *others], key=lambda row: float(row[1]))


def write(file: Path, rows: list[list[str]]) -> Path:
    file.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return file


@pytest.fixture
def rows() -> list[list[str]]:
    return lines()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "a.csv"


def require_both(log: Any, wheels: np.ndarray = WHEELS, poses: np.ndarray = POSES) -> None:
    np.testing.assert_allclose(log.input_times, wheels[:, 0])
    np.testing.assert_allclose(np.diff(log.integrals, axis=0), 0.05 * wheels[:-1, 1:3])
    np.testing.assert_allclose(log.pose_times, poses[:, 0])
    np.testing.assert_allclose(log.poses, poses[:, 3:])


def test_each_has_its_own_columns_and_width(file: Path, rows: list[list[str]]):
    require_both(read_one(write(file, rows), **RAGGED))


def test_types_may_be_numbers(file: Path, rows: list[list[str]]):
    numbers = {"odom": "1", "mocap": "2", "battery": "9"}
    numbered = [[numbers[row[0]], *row[1:]] for row in rows]
    types = {"column": 0, "inputs": 1, "poses": 2}
    require_both(read_one(write(file, numbered), **{**RAGGED, "records": types}))


def test_one_header_for_all(file: Path):
    header = ["kind", "t", *INPUTS, "x", "y", "heading"]
    odom = [["odom", *row[:3], "", "", ""] for row in cells(WHEELS)]
    mocap = [["mocap", row[0], "", "", *row[3:]] for row in cells(POSES)]
    own = {"records": {**RECORDS, "column": "kind"}}
    require_both(read_one(write(file, [header, *odom, *mocap]), **own))


def test_one_type_may_have_both(file: Path):
    rows = [["odom", *row] if index % 3 else ["note"] for index, row in enumerate(cells(WHEELS))]
    poses = {"x": 4, "y": 5, "heading": 6}
    log = read_one(
        write(file, rows), **PLACES, records={"column": 0, "inputs": "odom"}, poses=poses, delimiter=","
    )
    np.testing.assert_allclose(log.poses, np.delete(WHEELS, np.s_[::3], axis=0)[:, 3:])


def test_poses_may_be_in_a_file_of_their_own(file: Path, rows: list[list[str]]):
    write(
        file.with_name("poses.csv"),
        [["t", "x", "y", "heading"], *([row[0], *row[3:]] for row in cells(POSES))],
    )
    keys = {"records": {"column": 0, "inputs": "odom"}, "poses": {"file": "poses.csv", "time": "t"}}
    require_both(read_one(write(file, rows), **{**RAGGED, **keys}))


def test_half_a_last_line_is_left_out(file: Path, rows: list[list[str]]):
    log = read_one(write(file, [*rows, ["odom", "10.0", "3."]]), **RAGGED)
    require_both(log)
    assert "cut_off" in found(log)
    require_both(read_one(write(file, [*rows, ["od"]]), **RAGGED))


def test_rows_that_are_no_numbers_are_skipped_on_request(file: Path, rows: list[list[str]]):
    poses = [row for row in rows if row[0] == "mocap"]
    poses[4][2] = poses[9][1] = "nan"
    log = read_one(write(file, rows), **RAGGED, skip_invalid_rows=True)
    require_both(log, poses=np.delete(POSES, [4, 9], axis=0))


def test_rows_are_kept_of_each_type(file: Path, rows: list[list[str]]):
    for row in rows:
        if row[0] == "mocap":
            row[5] = str(int(float(row[1]) < 4.95))
    own = {**RAGGED["poses"], "keep": {5: 1}}
    log = read_one(write(file, rows), **{**RAGGED, "poses": own})
    require_both(log, poses=POSES[:50])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"inputs": "odm"},
            "no row is of type 'odm'; the types are odom (200 rows), mocap (100 rows), battery (4 rows); "
            "did you mean odom?",
        ),
        ({"poses": "vicon"}, "no row is of type 'vicon'; the types are odom"),
        ({"inputs": 3}, "no row is of type 3; the types are odom"),
        ({"column": 1}, "no row is of type 'odom'"),
        ({"column": 9}, "there is no column 9; the last one is 5, from 0"),
        ({"column": "kind"}, "the file has no header, so 'kind' is not known"),
    ],
)
def test_what_is_not_there(file: Path, rows: list[list[str]], change: dict[str, Any], message: str):
    issue = issue_of(write(file, rows), **{**RAGGED, "records": {**RECORDS, **change}})
    assert message in issue.message
    assert issue.named[:2] == ("log", "records")


@pytest.mark.parametrize(
    ("broken", "line", "message"),
    [
        (["odom", "9.", "1", "2", "3"], 9, "expected 4 cells, as in the first line, got 5"),
        (["odom", "lost", "1", "2"], 9, "expected a finite number, got 'lost'"),
        (["odom", "0.001", "1"], 9, "expected a finite number, the cell is empty"),
        (["mocap", "0.101", "1", "x", "3", "7"], 9, "expected a finite number, got 'x'"),
        (["mocap", "0.101", "1", "2"], 9, "expected a finite number, the cell is empty"),
        (["odom", "-5", "1", "2"], 9, "time goes back: -5 s after 0.2 s (line 8)"),
    ],
)
def test_faults_within_a_type_have_their_line(
    file: Path, rows: list[list[str]], broken: list[str], line: int, message: str
):
    issues = issues_of(write(file, [*rows[:8], broken, *rows[8:]]), **RAGGED)
    assert message in issues[0].message
    assert issues[0].line == line


def test_poses_are_in_one_place(file: Path, rows: list[list[str]]):
    keys = {**RAGGED, "poses": {"file": "{stem}.tum"}}
    with pytest.raises(ProblemError, match=r"log\.records\.poses: the poses are in a file of their own"):
        read_logs([write(file, rows)], form(**keys), ROBOT)


def test_values_of_another_text_are_not_named(file: Path):
    file.write_text("root:x:0:0:root\nuucp:x:10:10:uucp\n")
    issues = issues_of(file, records={**RECORDS, "column": 0}, delimiter=";")
    assert "root" not in " ".join(one.message for one in issues)
