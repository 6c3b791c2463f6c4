"""Rows without finite numbers: refused, or on request skipped and counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logged import HEADER, cells, drive, flaws_of, read_one, write

WHOLE = drive()


@pytest.fixture
def rows() -> list[list[str]]:
    return cells(WHOLE)


def found(log) -> list[str]:
    return [one.message for one in log.findings if one.name == "skipped_rows"]


def test_without_the_key_they_are_refused(tmp_path: Path, rows: list[list[str]]):
    rows[10][3] = "nan"
    (flaw,) = flaws_of(write(tmp_path / "a.csv", rows))
    assert (flaw.line, flaw.message) == (12, "expected a finite number, got 'nan'")


@pytest.mark.parametrize("cell", ["nan", "inf", "NaN", "-"])
def test_poses_are_left_out_and_the_wheels_kept(tmp_path: Path, rows: list[list[str]], cell: str):
    for row in (10, 11, 40):
        rows[row][4] = cell
    log = read_one(write(tmp_path / "a.csv", rows), skip_invalid_rows=True)
    kept = np.delete(np.arange(len(WHOLE)), [10, 11, 40])
    np.testing.assert_allclose(log.poses, WHOLE[kept, 3:])
    np.testing.assert_allclose(log.input_times, WHOLE[:, 0])
    assert found(log) == [
        "the poses of 3 of 200 rows are skipped, as the study asks: they have no finite number there "
        "(the first in line 12)"
    ]


def test_inputs_are_left_out_and_the_poses_kept(tmp_path: Path, rows: list[list[str]]):
    rows[10][1] = "nan"
    log = read_one(write(tmp_path / "a.csv", rows), skip_invalid_rows=True)
    np.testing.assert_allclose(log.poses, WHOLE[:, 3:])
    np.testing.assert_allclose(log.input_times, np.delete(WHOLE[:, 0], 10))
    assert found(log)[0].startswith("the inputs of 1 of 200 rows are skipped")


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
    assert flaws_of(write(tmp_path / "a.csv", rows), skip_invalid_rows=True)
