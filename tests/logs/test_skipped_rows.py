"""Rows without finite numbers: refused, or on request skipped and counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logged import HEADER, cells, drive, issues_of, read_one, write

WHOLE = drive()


@pytest.fixture
def rows() -> list[list[str]]:
    return cells(WHOLE)


def found(log) -> list[str]:
    return [one.message for one in log.findings if one.name.startswith("skipped_")]


def test_without_the_key_they_are_refused(tmp_path: Path, rows: list[list[str]]):
    rows[10][3] = "nan"
    (issue,) = issues_of(write(tmp_path / "a.csv", rows))
    assert (issue.line, issue.message) == (12, "expected a finite number, got 'nan'")


@pytest.mark.parametrize("cell", ["nan", "inf", "NaN", "-"])
def test_poses_are_left_out_and_the_wheels_kept(tmp_path: Path, rows: list[list[str]], cell: str):
    for row in (10, 11, 40):
        rows[row][4] = cell
    log = read_one(write(tmp_path / "a.csv", rows), skip_invalid_rows=True)
    kept = np.delete(np.arange(len(WHOLE)), [10, 11, 40])
    np.testing.assert_allclose(log.poses, WHOLE[kept, 3:])
    np.testing.assert_allclose(log.input_times, WHOLE[:, 0])
    assert found(log) == [
        "the poses of 3 of 200 rows of a.csv are skipped, as the study asks: they have no finite number "
        "there (the first in line 12)"
    ]


def test_inputs_are_left_out_and_the_poses_kept(tmp_path: Path, rows: list[list[str]]):
    rows[10][1] = "nan"
    log = read_one(write(tmp_path / "a.csv", rows), skip_invalid_rows=True)
    np.testing.assert_allclose(log.poses, WHOLE[:, 3:])
    np.testing.assert_allclose(log.input_times, np.delete(WHOLE[:, 0], 10))
    assert found(log)[0].startswith("the inputs of 1 of 200 rows of a.csv are skipped")


@pytest.mark.parametrize("row", [0, 10, 199])
def test_whole_rows(tmp_path: Path, rows: list[list[str]], row: int):
    rows[row] = ["nan"] * len(HEADER)
    log = read_one(write(tmp_path / "a.csv", rows), skip_invalid_rows=True)
    np.testing.assert_allclose(log.poses, np.delete(WHOLE, row, axis=0)[:, 3:])
    assert len(found(log)) == 2


def test_poses_of_a_clock_of_their_own(tmp_path: Path, rows: list[list[str]]):
    rows = [[*row[:3], row[0], *row[3:]] for row in rows]
    rows[10][5] = "nan"
    header = (*HEADER[:3], "stamp", *HEADER[3:])
    file = write(tmp_path / "a.csv", rows, header)
    log = read_one(file, skip_invalid_rows=True, poses={"time": "stamp"})
    np.testing.assert_allclose(log.pose_times, np.delete(WHOLE[:, 0], 10))
    assert len(found(log)) == 1


def test_a_log_without_such_rows_is_read_as_ever(tmp_path: Path, rows: list[list[str]]):
    file = write(tmp_path / "a.csv", rows)
    one, other = read_one(file), read_one(file, skip_invalid_rows=True)
    np.testing.assert_array_equal(one.poses, other.poses)
    np.testing.assert_array_equal(one.integrals, other.integrals)
    assert one.findings == other.findings


def test_a_column_of_no_numbers_is_refused_all_the_same(tmp_path: Path, rows: list[list[str]]):
    for row in rows:
        row[4] = "nan"
    assert issues_of(write(tmp_path / "a.csv", rows), skip_invalid_rows=True)


def test_rows_to_keep_that_have_no_time(tmp_path: Path, rows: list[list[str]]):
    rows = [[*row, str(int(50 <= number < 150))] for number, row in enumerate(rows)]
    rows[50][0], rows[60][6] = "nan", "nan"
    keys = {"keep": {"steady": 1}}
    file = write(tmp_path / "a.csv", rows, (*HEADER, "steady"))
    log = read_one(file, skip_invalid_rows=True, **keys)
    np.testing.assert_allclose(log.pose_times, np.delete(WHOLE[51:150, 0], 9))


def test_a_time_that_is_none(tmp_path: Path, rows: list[list[str]]):
    rows[10][0] = ""
    log = read_one(write(tmp_path / "a.csv", rows), skip_invalid_rows=True)
    np.testing.assert_allclose(log.poses, np.delete(WHOLE, 10, axis=0)[:, 3:])
    assert len(found(log)) == 2


def test_rows_of_two_clocks_that_have_only_one_are_not_among_them(tmp_path: Path, rows: list[list[str]]):
    wheels = [[*row[:3], "", "", "", ""] for row in rows]
    poses = [["", "", "", row[0], *row[3:]] for row in rows]
    poses[7][6] = "nan"
    mixed = [row for pair in zip(wheels, poses, strict=True) for row in pair]
    file = write(tmp_path / "a.csv", mixed, (*HEADER[:3], "stamp", *HEADER[3:]))
    log = read_one(file, skip_invalid_rows=True, poses={"time": "stamp"})
    np.testing.assert_allclose(log.input_times, WHOLE[:, 0])
    np.testing.assert_allclose(log.pose_times, np.delete(WHOLE[:, 0], 7))
    assert [text[:36] for text in found(log)] == ["the poses of 1 of 400 rows of a.csv "]


@pytest.mark.parametrize("form", ["tum", "csv"])
def test_poses_of_a_file_of_their_own(tmp_path: Path, rows: list[list[str]], form: str):
    beside = tmp_path / f"a.poses.{form}"
    if form == "tum":
        turns = [(0, 0, np.sin(row[5] / 2), np.cos(row[5] / 2)) for row in WHOLE]
        lines = [
            [row[0], row[3], row[4], "0", *map(str, turn)] for row, turn in zip(rows, turns, strict=True)
        ]
        lines[10][1] = lines[12][7] = "nan"
        write(beside, lines, None, " ")
    else:
        lines = [[row[0], *row[3:]] for row in rows]
        lines[10][1] = lines[12][3] = "inf"
        write(beside, lines, ("t", "x", "y", "heading"))
    file = write(tmp_path / "a.csv", [row[:3] for row in rows], HEADER[:3])
    keys = {"poses": {"file": beside.name}}
    assert {Path(issue.file).name for issue in issues_of(file, **keys)} == {beside.name}
    log = read_one(file, skip_invalid_rows=True, **keys)
    np.testing.assert_allclose(log.poses, np.delete(WHOLE, [10, 12], axis=0)[:, 3:], atol=1e-12)
    np.testing.assert_allclose(log.input_times, WHOLE[:, 0])
    (said,) = found(log)
    assert said.startswith(f"the poses of 2 of 200 rows of {beside.name} are skipped")
    assert f"(the first in line {11 + (form == 'csv')})" in said


def test_a_file_of_drives_says_it_once(tmp_path: Path, rows: list[list[str]]):
    # The first run is too short, and left out.
    rows = [[*row, str(int(number > 1))] for number, row in enumerate(rows)]
    rows[0][4] = rows[50][4] = "nan"
    log = read_one(write(tmp_path / "a.csv", rows, (*HEADER, "run")), skip_invalid_rows=True)
    (said,) = found(log)
    assert said.startswith("the poses of 2 of 200 rows of a.csv are skipped")
