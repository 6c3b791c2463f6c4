"""Times as loggers write them: seconds, other units, since 1970, dates with a time zone and without."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from logged import HEADER, ROBOT, cells, drive, form, issue_of, issues_of, read_one, write

from oed.foundation.errors import ProblemError
from oed.logs import Log, read_logs

TABLE = drive()
START = datetime(2024, 3, 10, 23, 59, 57, tzinfo=UTC)
"""The drive goes on into the next day."""
EAST = timezone(timedelta(hours=2))

Stamp = Callable[[float], str]


def moment(time: float) -> datetime:
    return START + timedelta(seconds=time)


def stamped(file: Path, stamp: Stamp, broken: dict[int, str] | None = None) -> Path:
    """The log with its times written so, but for some of its rows."""
    rows = cells(TABLE)
    for index, row in enumerate(rows):
        row[0] = (broken or {}).get(index, stamp(float(row[0])))
    return write(file, rows, HEADER, ";")


def require_times(log: Log, kept: np.ndarray | None = None) -> None:
    times = TABLE[:, 0] if kept is None else TABLE[kept, 0]
    np.testing.assert_allclose(log.pose_times - log.pose_times[0], times - times[0], atol=1e-6)
    np.testing.assert_array_equal(log.input_times, log.pose_times)


def iso(time: float) -> str:
    return moment(time).isoformat()


def plain(time: float) -> str:
    return moment(time).strftime("%Y-%m-%d %H:%M:%S.%f")


def since(time: float, factor: float) -> str:
    return str(round((START.timestamp() + time) * factor))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "a.csv"


@pytest.mark.parametrize(
    "stamp",
    [
        iso,
        plain,
        lambda time: iso(time).replace("+00:00", "Z"),
        lambda time: f"{plain(time)}000 UTC",
        lambda time: f"{plain(time)} +0000".replace("-", "/"),
        lambda time: moment(time).astimezone(EAST).isoformat(),
        lambda time: (moment(time).astimezone(EAST) if time > 1 else moment(time)).isoformat(),
        lambda time: plain(time).replace(".", ","),
        lambda time: since(time, 1e3),
        lambda time: since(time, 1e6),
        lambda time: since(time, 1e9),
        lambda time: f"{START.timestamp() + time:.6f}",
    ],
)
def test_are_found_by_themselves(file: Path, stamp: Stamp):
    require_times(read_one(stamped(file, stamp)))


def test_dates_are_seconds_since_1970(file: Path):
    np.testing.assert_allclose(read_one(stamped(file, iso)).pose_times, START.timestamp() + TABLE[:, 0])


def test_large_numbers_that_go_on_slowly_are_seconds(file: Path):
    log = read_one(stamped(file, lambda time: str(9.9e11 + 1e7 * time)))
    assert np.ptp(log.pose_times) == pytest.approx(1e7 * np.ptp(TABLE[:, 0]))


def test_a_unit_that_is_said_counts(file: Path):
    log = read_one(stamped(file, lambda time: since(time, 1e3)), time={"column": "t", "unit": "us"})
    assert np.ptp(log.pose_times) == pytest.approx(1e-3 * np.ptp(TABLE[:, 0]))


def test_poses_may_have_dates_and_wheels_numbers(file: Path):
    rows = [[*row, iso(float(row[0]))] for row in cells(TABLE)]
    for row in rows:
        row[0] = str(START.timestamp() + float(row[0]))
    write(file, rows, (*HEADER, "stamp"))
    log = read_one(file, poses={"time": {"column": "stamp", "form": "date"}})
    np.testing.assert_allclose(log.pose_times, log.input_times, atol=1e-6)


def test_no_dates_are_skipped_on_request(file: Path):
    broken = {3: "lost", 9: "", 12: "nan"}
    log = read_one(stamped(file, iso, broken), skip_invalid_rows=True)
    require_times(log, np.delete(np.arange(200), [*broken]))


@pytest.mark.parametrize(
    ("stamp", "broken", "line", "message"),
    [
        (iso, {4: "31.05.2024 10:00"}, 6, "expected a date and time as 2024-05-31 14:03:07.25"),
        (iso, {4: "12.5"}, 6, "(ISO 8601), got '12.5'"),
        (iso, {4: ""}, 6, "the cell is empty"),
        (iso, {4: "nan"}, 6, "(ISO 8601), got 'nan'"),
        (iso, {4: "2024-03-11T25:00:00Z"}, 6, "got '2024-03-11T25:00:00Z'"),
        (iso, {4: "2024-02-30 10:00:00"}, 6, "got '2024-02-30 10:00:00'"),
        (iso, {4: plain(0.2)}, 6, "lacks the time zone that other rows have"),
        (plain, {4: iso(0.2)}, 6, "has a time zone, which other rows lack"),
        (plain, {4: plain(0.1)}, 6, "time goes back"),
        (str, {4: iso(0.2)}, 6, "expected a finite number, got '2024-03-10T23:59:57"),
        (lambda time: since(time, 1e3), {4: plain(0.2)}, 6, "expected a finite number, got '2024-03-10"),
    ],
)
def test_what_is_no_time_as_the_others(
    file: Path, stamp: Stamp, broken: dict[int, str], line: int, message: str
):
    issues = issues_of(stamped(file, stamp, broken))
    assert [issue.line for issue in issues] == [line]
    assert message in issues[0].message


def test_another_form_than_the_study_says(file: Path):
    issue = issue_of(stamped(file, str), time={"column": "t", "form": "date"})
    assert issue.line == 2
    assert "(ISO 8601), got 200 that are none, such as '0.0'" in issue.message
    issue = issue_of(stamped(file, iso), time={"column": "t", "form": "number"})
    assert "expected finite numbers, and the column has none" in issue.message


@pytest.mark.parametrize(
    ("form", "said", "broken"),
    [
        ("%d.%m.%Y %H:%M:%S.%f", {}, {}),
        ("%m/%d/%Y %H:%M:%S", {"form": "date"}, {}),
        ("%d %b %Y %H:%M:%S", {}, {0: "", 5: "?"}),
        ("%H:%M:%S.%f", {"form": "date"}, {0: "", 5: "?"}),
        ("%b %d, %Y %H:%M:%S", {}, {}),
    ],
)
def test_one_issue_of_dates_in_another_form(file: Path, form: str, said: dict, broken: dict[int, str]):
    stamps = stamped(file, lambda time: moment(time).strftime(form), broken)
    issue = issue_of(stamps, time={"column": "t", **said})
    assert (issue.line, issue.key, issue.column) == (3 if broken else 2, "t", 1)
    assert "expected dates and times as 2024-05-31 14:03:07.25" in issue.message
    assert "(ISO 8601), got" in issue.message
    assert "write them so, or as seconds" in issue.message


@pytest.mark.parametrize("place", ["time", "poses"])
def test_a_date_has_no_unit(file: Path, place: str):
    time = {"column": "t", "form": "date", "unit": "ms"}
    keys = {"time": time} if place == "time" else {"poses": {"time": time}}
    with pytest.raises(ProblemError, match="a date has no unit; leave it out"):
        read_logs([file], form(**keys), ROBOT)


def test_every_row_of_another_kind_is_counted(file: Path):
    issues = issues_of(stamped(file, iso, {row: plain(0.05 * row) for row in range(20, 60)}))
    assert len(issues) == 10
    assert issues[-1].message.endswith("(and 30 more like it)")


def test_clocks_hours_apart_do_not_overlap(file: Path):
    poses = [
        [moment(float(row[0])).astimezone(EAST).strftime("%Y-%m-%d %H:%M:%S.%f"), *row[3:]]
        for row in cells(TABLE)
    ]
    write(file.with_name("poses.csv"), poses, ("t", *HEADER[3:]))
    issue = issues_of(stamped(file, iso), poses={"file": "poses.csv", "time": "t"})[0]
    assert "the clocks do not overlap" in issue.message
    assert "time zones" in issue.message


def test_one_issue_of_a_column_that_is_no_clock(file: Path):
    rows = [[f"s{row[0]}", *row[1:]] for row in cells(TABLE)]
    assert "the column has none: is it the right one" in issue_of(write(file, rows)).message
