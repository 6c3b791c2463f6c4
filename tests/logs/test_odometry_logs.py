"""Odometry that exists only as poses, read as the speed and the yaw rate of a robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logged import ROBOT, cells, doubtful, drive, form, found, issues_of, read_one, write

from oed.robots.models import Unicycle

TABLE = drive(120)
WAY = 0.03 * np.diff(TABLE[:, 0]) * (4 + np.sin(TABLE[:-1, 0]))
TURN = 0.4 * np.diff(TABLE[:, 0]) * np.sin(0.7 * TABLE[:-1, 0])
"""Of arcs from row to row [m, rad]."""
HEADER = ("t", "ox", "oy", "oyaw", "x", "y", "heading")
KEYS = {"form": "poses", "x": "ox", "y": "oy", "heading": "oyaw"}


def odometry() -> np.ndarray:
    """Poses along the arcs, by a hundred small straight steps of each; headings wrapped."""
    parts = 100
    headings = 2.9 + np.concatenate([[0.0], np.cumsum(TURN)])
    middles = headings[:-1, None] + TURN[:, None] * (np.arange(parts) + 0.5) / parts
    moves = WAY * np.exp(1j * middles).mean(axis=1)
    places = 1 + 2j + np.concatenate([[0.0], np.cumsum(moves)])
    return np.column_stack([places.real, places.imag, np.angle(np.exp(1j * headings))])


def table(poses: np.ndarray) -> np.ndarray:
    return np.column_stack([TABLE[:, 0], poses, TABLE[:, 3:]])


def read(tmp_path: Path, poses: np.ndarray, **keys):
    return read_one(
        write(tmp_path / "a.csv", cells(table(poses)), HEADER), Unicycle(), inputs={**KEYS, **keys}
    )


def test_increments_are_the_exact_arcs(tmp_path: Path):
    log = read(tmp_path, odometry())
    np.testing.assert_allclose(np.diff(log.integrals, axis=0), np.column_stack([WAY, TURN]), atol=1e-7)
    assert found(log) == {}


def test_in_other_units(tmp_path: Path):
    poses = odometry() * [1000, 1000, 180 / np.pi]
    millimetres = {name: {"column": f"o{name}", "unit": "mm"} for name in ("x", "y")}
    log = read(tmp_path, poses, **millimetres, heading={"column": "oyaw", "unit": "deg"})
    np.testing.assert_allclose(np.diff(log.integrals, axis=0), np.column_stack([WAY, TURN]), atol=1e-7)


def test_rows_without_odometry_are_bridged(tmp_path: Path):
    rows = cells(table(odometry()))
    for row in range(40, 50):
        rows[row][1:4] = ["", "", ""]
    log = read_one(write(tmp_path / "a.csv", rows, HEADER), Unicycle(), inputs=KEYS)
    whole = log.integrals[-1] - log.integrals[0]
    np.testing.assert_allclose(whole, [WAY.sum(), TURN.sum()], atol=2e-4)


def test_odometry_that_began_anew_is_in_doubt(tmp_path: Path):
    poses = odometry()
    poses[70:, :2] -= poses[70, :2]
    log = read(tmp_path, poses)
    assert "odometry_jump" in doubtful(log)
    assert "after t = 3.45 s (line 71): cut where it began anew" in found(log)["odometry_jump"]


@pytest.mark.parametrize("wrong", [-1.0, np.pi / 180])
def test_a_heading_that_is_wrong_moves_sideways(tmp_path: Path, wrong: float):
    poses = odometry()
    poses[:, 2] *= wrong
    assert "odometry_sideways" in doubtful(read(tmp_path, poses))


def test_of_a_robot_with_wheels():
    (issue,) = form(inputs=KEYS).issues(ROBOT)
    assert issue.key == ("log", "inputs", "form")
    known = "wheel_speed_right, wheel_speed_left; take `robot: {kind: unicycle}`"
    assert issue.message.endswith(f"the inputs of differential_drive are {known}")


def test_a_unit_of_another_kind():
    (issue,) = form(inputs={**KEYS, "heading": {"column": "oyaw", "unit": "mm"}}).issues(Unicycle())
    assert issue.key == ("log", "inputs", "heading", "unit")
    assert issue.message == "expected an angle [rad], got 'mm', whose unit is of another kind"


def test_columns_that_are_not_there_and_cells_that_are_no_numbers(tmp_path: Path):
    rows = cells(table(odometry()))
    file = write(tmp_path / "a.csv", rows, HEADER)
    (issue,) = issues_of(file, model=Unicycle(), inputs={**KEYS, "y": "odom_y"})
    assert (issue.key, issue.named) == ("y", ("log", "inputs", "y", "column"))
    rows[5][3] = "abc"
    (issue,) = issues_of(write(tmp_path / "a.csv", rows, HEADER), model=Unicycle(), inputs=KEYS)
    assert (issue.line, issue.key) == (7, "oyaw")


@pytest.mark.parametrize(
    ("row", "column", "cell", "line", "words"),
    [
        (5, 1, "nan", 7, "finite number"),
        (5, 2, "inf", 7, "finite number"),
        (5, 1, "1,5", 7, "cells"),
        (5, 3, "left", 7, "finite number"),
        (5, 2, "1e308", 7, ""),
        (9, 0, "0.1", 11, "time goes back"),
        (9, 0, "", 11, "empty"),
        (9, 0, "noon", 11, ""),
    ],
)
def test_faults_have_their_line(tmp_path: Path, row: int, column: int, cell: str, line: int, words: str):
    rows = cells(table(odometry()))
    rows[row][column] = cell
    (issue,) = issues_of(write(tmp_path / "a.csv", rows, HEADER), model=Unicycle(), inputs=KEYS)
    assert issue.line == line, issue
    assert words in issue.message


def test_odometry_is_not_its_own_reference():
    (issue,) = form(inputs=KEYS, poses={"x": "ox", "y": "oy", "heading": "oyaw"}).issues(Unicycle())
    assert issue.key == ("log", "inputs")
    assert "name the columns of the odometry" in issue.message
    assert form(inputs=KEYS, poses={"x": "ox", "y": "oy", "file": "{stem}_b.csv"}).issues(Unicycle()) == []
    assert form(inputs=KEYS).issues(Unicycle()) == []
