"""Sensors beside the poses in CSVs: read to the last digit, and refused by file and line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from logged import HEADER, INPUTS, ROBOT, cells, drive, form, write

from oed.foundation.errors import FileIssue, LogError, ProblemError
from oed.logs import Log, read_logs
from oed.robots.sensors import Landmarks, Poses, Ranges, Several, Tags, YawRate

BEACONS = ((3.0, 0.0), (0.0, 3.0), (-3.0, -3.0))
SENSORS = Several(
    sensors=[
        Poses(noise={"position": 0.01, "heading": 0.01}),
        YawRate(noise=0.01),
        Ranges(beacons=BEACONS, noise=0.02),
        Landmarks(landmarks=BEACONS, ids=(7, 12, "door"), noise={"range": 0.02, "bearing": 0.01}),
        Tags(tags=[(3.0, 0.0, 3.1)], noise={"range": 0.02, "bearing": 0.01, "orientation": 0.02}),
    ]
)
TABLE = drive(60)
SIGHTS = [
    ["0.5", "7", "2.0", "90"],
    ["0.5", "12", "1.0", "-45"],
    ["1.0", "door", "3.0", "10.5"],
    ["1.5", "7.0", "2.5", ""],
]
LANDMARKS = {"id": "who", "range": "r", "bearing": {"column": "b", "unit": "deg"}, "file": "sights.csv"}


def files(
    folder: Path, sights: Sequence[Sequence[str]] = SIGHTS, more: np.ndarray | None = None, **columns: Any
) -> Path:
    """A log with further columns at random, and a file of sights beside it."""
    write(folder / "sights.csv", sights, ("t", "who", "r", "b"))
    extra = np.abs(np.random.default_rng(0).normal(size=(len(TABLE), 5))) if more is None else more
    return write(
        folder / "log.csv", cells(np.column_stack([TABLE, extra])), (*HEADER, "gz", "r1", "r2", "r3", "z")
    )


def read(file: Path, sensors: dict[str, Any], **keys: Any) -> Log:
    (log,) = read_logs([file], form(sensors=sensors, **keys), ROBOT, SENSORS)
    return log


def issues(file: Path, sensors: dict[str, Any], **keys: Any) -> Sequence[FileIssue]:
    with pytest.raises(LogError) as caught:
        read(file, sensors, **keys)
    return caught.value.issues


def test_columns_in_the_log_itself(tmp_path: Path):
    log = read(
        files(tmp_path),
        {"yaw_rate": {"column": "gz", "unit": "deg/s"}, "ranges": {"columns": ["r1", 8, "r3"]}},
    )
    extra = np.abs(np.random.default_rng(0).normal(size=(60, 5)))
    gyro, ranges = log.sensors
    assert (gyro.sensor, gyro.clock, ranges.sensor, ranges.clock) == ("yaw_rate", "inputs", "ranges", "poses")
    np.testing.assert_allclose(gyro.times, TABLE[:, 0])
    np.testing.assert_allclose(gyro.values[:, 0], np.radians(extra[:, 0]))
    np.testing.assert_allclose(ranges.values, extra[:, [1, 2, 3]])
    assert log.quantities == ("x", "y", "heading")


def test_rows_of_one_landmark_each_beside_the_log(tmp_path: Path):
    (seen,) = read(files(tmp_path), {"landmarks": LANDMARKS}).sensors
    np.testing.assert_allclose(seen.times, [0.5, 1.0, 1.5])
    expected = [
        [2.0, np.pi / 2, 1.0, -np.pi / 4, np.nan, np.nan],
        [np.nan, np.nan, np.nan, np.nan, 3.0, np.radians(10.5)],
        [2.5, np.nan, np.nan, np.nan, np.nan, np.nan],
    ]
    np.testing.assert_allclose(seen.values, expected)


def test_a_log_without_poses_has_the_times_of_what_it_saw(tmp_path: Path):
    keys = {"poses": "none", "sensors": {"landmarks": LANDMARKS, "yaw_rate": "gz"}}
    write(tmp_path / "bare.csv", cells(TABLE[:, [0, 1, 2, 3]]), ("t", *INPUTS, "gz"))
    files(tmp_path)
    (log,) = read_logs([tmp_path / "bare.csv"], form(**keys), ROBOT, SENSORS)
    assert log.quantities == ()
    np.testing.assert_allclose(log.pose_times, [0.5, 1.0, 1.5])
    assert log.poses.shape == (3, 0)


def test_readings_of_runs_are_theirs(tmp_path: Path):
    both = np.vstack([TABLE, TABLE])
    rows = [[run, *row, row[4]] for run, row in zip(["a"] * 60 + ["b"] * 60, cells(both), strict=True)]
    rows[70][-1] = ""
    file = write(tmp_path / "runs.csv", rows, ("run", *HEADER, "gz"))
    logs = read_logs([file], form(sensors={"yaw_rate": "gz"}), ROBOT, SENSORS)
    assert [len(log.sensors[0].times) for log in logs] == [60, 59]
    np.testing.assert_allclose(logs[0].sensors[0].values[:, 0], TABLE[:, 4])


@pytest.mark.parametrize(
    ("sensors", "change", "line", "words"),
    [
        ({"yaw_rate": "gyro_z"}, {}, 1, "the header lacks 'gyro_z'"),
        ({"yaw_rate": "gz"}, {(12, 0): np.nan}, 14, "expected a finite number, got 'nan'"),
        ({"yaw_rate": "gz"}, {(7, 0): 57.3}, 9, "57.3 rad/s is more than 30; in degrees say `unit: deg/s`"),
        ({"ranges": ["r1", "r2", "r3"]}, {(3, 2): -1.0}, 5, "a distance is not below 0, got -1 m"),
    ],
)  # fmt: skip
def test_faults_of_columns(tmp_path: Path, sensors: Any, change: dict, line: int, words: str):
    extra = np.abs(np.random.default_rng(0).normal(size=(60, 5)))
    for place, value in change.items():
        extra[place] = value
    given = {name: {"columns": one} if isinstance(one, list) else one for name, one in sensors.items()}
    (issue,) = issues(files(tmp_path, more=extra), given)
    assert (issue.line, Path(issue.file).name) == (line, "log.csv")
    assert words in issue.message


@pytest.mark.parametrize(
    ("row", "line", "words"),
    [
        (["1.7", "8", "1.0", "5"], 6, "landmarks has no id '8'; the study has 7, 12 and door"),
        (["1.5", "7", "1.0", "5"], 6, "7 is read a second time at t = 1.5 s (line 6)"),
        (["1.2", "12", "1.0", "5"], 6, "time goes back: 1.2 s after 1.5 s"),
        (["1.7", "12", "1.0", "500"], 6, "8.72665 rad is more than 6.28; in degrees say"),
        (["1.7", "12", "far", "5"], 6, "expected a finite number, got 'far'"),
        (["1.7", "12", "-2", "5"], 6, "a distance is not below 0, got -2 m"),
    ],
)
def test_faults_of_rows(tmp_path: Path, row: list[str], line: int, words: str):
    (issue,) = issues(files(tmp_path, [*SIGHTS, row]), {"landmarks": LANDMARKS})
    assert (issue.line, Path(issue.file).name) == (line, "sights.csv")
    assert words in issue.message


def test_readings_of_another_time_are_refused(tmp_path: Path):
    late = [[f"{1e9 + float(row[0])}", *row[1:]] for row in SIGHTS]
    (issue,) = issues(files(tmp_path, late), {"landmarks": LANDMARKS})
    assert "outside of the log's, from 0 to 2.95 s; are the units of time alike?" in issue.message
    (issue,) = issues(files(tmp_path), {"landmarks": LANDMARKS | {"file": "sight.csv"}})
    assert "no such file" in issue.message


@pytest.mark.parametrize(
    ("sensors", "key", "words"),
    [
        ({"lidar": "gz"}, "lidar", "the study's measurement has no lidar; it measures yaw_rate, ranges"),
        ({"yaw_rates": "gz"}, "yaw_rates", "did you mean yaw_rate?"),
        ({"poses": "x"}, "poses", "a key of their own"),
        ({"ranges": {"columns": ["r1", "r2"]}}, "ranges.columns", "expected 3 columns (ranges[1], ranges"),
        ({"yaw_rate": {"column": "gz", "unit": "mm"}}, "yaw_rate.unit", "'mm'"),
        ({"yaw_rate": {"column": "gz", "id": "who"}}, "yaw_rate.id", "no points that ids could tell apart"),
        ({"ranges": {"id": "who", "bearing": "b"}}, "ranges.bearing", "ranges measures range"),
        ({"yaw_rate": "gz", "tags": {"columns": ["r1", "r2", "gz"]}}, "tags", "is that of yaw_rate already"),
    ],
)  # fmt: skip
def test_keys_that_do_not_fit_the_study(sensors: dict[str, Any], key: str, words: str):
    with pytest.raises(ProblemError) as caught:
        read_logs(["log.csv"], form(sensors=sensors), ROBOT, SENSORS)
    (issue,) = caught.value.issues
    assert ".".join(map(str, issue.key)) == f"log.sensors.{key}"
    assert words in issue.message
