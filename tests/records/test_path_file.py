"""Trajectory CSV files: written and read again, and every mistake named by its line."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from builders import ACCELERATION, BOX, RADIUS, SPEED, TRACK, problem_of, random_drive
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oed.foundation.errors import FileIssue, PathFileError
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.records.path_file import read_trajectory, trajectory_csv, write_trajectory
from oed.robots.limits import WheelJerk
from oed.robots.models import SkidSteer
from oed.robots.space import DesignSpace, StartPose

PROBLEM = problem_of()
HEADER = "t,wheel_speed_right,wheel_speed_left"
POSES = f"{HEADER},x,y,heading"
SPACES = {
    "small": DesignSpace(duration=10, samples=40, spline=Spline(coefficients=8)),
    "odd period": DesignSpace(duration=10 / 3, samples=23, spline=Spline(coefficients=8)),
    "midpoint": DesignSpace(duration=7, samples=31, integration="midpoint"),
    "held": DesignSpace(duration=6, samples=24, spline=Spline(degree=0, coefficients=8)),
    "free": DesignSpace(duration=10, samples=40, start="free", rest_to_rest=False),
    "elsewhere": DesignSpace(duration=5, samples=50, start=StartPose(x=0.5, y=-0.2, heading=2.0)),
}


@cache
def problem_in(space: str) -> Problem:
    """A problem of one of these spaces: its expressions are built once for all drives."""
    return problem_of(design=SPACES[space], limits=(SPEED, ACCELERATION, BOX))


def read(folder: Path, *lines: str, problem=PROBLEM) -> Trajectory:
    file = folder / "path.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_trajectory(file, problem)


def issues_of(folder: Path, *lines: str) -> tuple[FileIssue, ...]:
    with pytest.raises(PathFileError) as caught:
        read(folder, *lines)
    assert {issue.file for issue in caught.value.issues} == {str(folder / "path.csv")}
    return caught.value.issues


class TestRoundTrip:
    """A drive and what is read from its file hold the same inputs, so they score alike."""

    @pytest.mark.parametrize("space", SPACES)
    @settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(seed=st.integers(0, 2**32 - 1))
    @pytest.mark.slow
    def test_the_score_is_the_same(self, tmp_path: Path, space: str, seed: int):
        problem = problem_in(space)
        drive = random_drive(problem, seed)
        before = evaluate(problem, drive)
        write_trajectory(tmp_path / "path.csv", problem, drive, before.states)
        again = read_trajectory(tmp_path / "path.csv", problem)
        after = evaluate(problem, again)
        np.testing.assert_allclose(again.inputs, drive.inputs, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(again.start, drive.start)
        assert again.samples == drive.samples
        assert again.duration == pytest.approx(drive.duration, rel=1e-9)
        assert after.objective == pytest.approx(before.objective, rel=1e-9, abs=1e-9 * before.lambda_max)
        np.testing.assert_allclose(after.states, before.states, rtol=0, atol=1e-8)
        assert after.path_length == pytest.approx(before.path_length, rel=1e-9)

    def test_a_design_stays_feasible(self, tmp_path: Path):
        drive = random_drive(PROBLEM, 3, amplitude=1.0)
        evaluation = evaluate(PROBLEM, drive)
        assert evaluation.feasible
        write_trajectory(tmp_path / "path.csv", PROBLEM, drive, evaluation.states)
        assert evaluate(PROBLEM, read_trajectory(tmp_path / "path.csv", PROBLEM)).feasible

    def test_the_jerk_of_a_drive_is_that_of_its_reverse(self, tmp_path: Path):
        # Of a robot that jumps from rest, and of one that jumps to it.
        problem = problem_of(limits=(SPEED, WheelJerk(bounds=5.0)))
        rows = [f"{speed:.1f},{speed:.1f}" for speed in np.linspace(4, 0.4, 10)]
        found = [
            evaluate(problem, read(tmp_path, HEADER, *(f"{time},{row}" for time, row in enumerate(order))))
            for order in (rows, rows[::-1])
        ]
        # From 0 to 4 rad/s in half a second, then down by 0.4 rad/s^2.
        assert [one.violations["wheel_jerk"] for one in found] == pytest.approx([3.4, 3.4])

    @pytest.mark.slow
    def test_another_robots_slip_is_not_in_the_file(self, tmp_path: Path):
        robot = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=0.1)
        problem = problem_of(model=robot)
        drive = random_drive(problem, 1)
        text = trajectory_csv(problem, drive, evaluate(problem, drive).states)
        again = read(tmp_path, *text.splitlines(), problem=problem)
        assert evaluate(problem, again).objective == pytest.approx(
            evaluate(problem, drive).objective, rel=1e-9
        )


def test_the_files_form():
    drive = random_drive(PROBLEM, 0)
    evaluation = evaluate(PROBLEM, drive)
    text = trajectory_csv(PROBLEM, drive, evaluation.states)
    assert "\r" not in text
    rows = list(csv.reader(text.splitlines()))
    assert rows[0] == ["t", "wheel_speed_right", "wheel_speed_left", "x", "y", "heading"]
    assert len(rows) == 1 + 40 + 1
    assert rows[-1][1:3] == ["", ""]
    assert [float(row[0]) for row in rows[1:]] == pytest.approx(np.linspace(0, 10, 41))
    poses = np.array([[float(cell) for cell in row[3:]] for row in rows[1:]])
    np.testing.assert_array_equal(poses, evaluation.states)
    inputs = np.array([[float(cell) for cell in row[1:3]] for row in rows[1:-1]])
    np.testing.assert_array_equal(inputs, drive.inputs)


class TestReading:
    def test_without_poses_the_studys_start_is_taken(self, tmp_path: Path):
        problem = problem_of(design=SPACES["elsewhere"])
        drive = read(tmp_path, HEADER, "0,1,2", "0.5,3,4", "1,5,6", problem=problem)
        assert drive.start.tolist() == [0.5, -0.2, 2.0]
        assert drive.inputs.tolist() == [[1, 2], [3, 4], [5, 6]]
        assert (drive.duration, drive.samples) == (1.5, 3)

    def test_without_poses_a_free_start_is_the_origin(self, tmp_path: Path):
        problem = problem_of(design=SPACES["free"])
        assert read(tmp_path, HEADER, "0,1,2", "1,3,4", problem=problem).start.tolist() == [0, 0, 0]

    def test_the_first_pose_is_the_start(self, tmp_path: Path):
        drive = read(tmp_path, POSES, "0,1,2,0.3,-0.4,1.5", "1,3,4,9,9,9", "2,,,9,9,9")
        assert drive.start.tolist() == [0.3, -0.4, 1.5]
        assert drive.inputs.tolist() == [[1, 2], [3, 4]]
        assert (drive.duration, drive.samples) == (2.0, 2)

    def test_later_poses_are_not_read(self, tmp_path: Path):
        drive = read(tmp_path, POSES, "0,1,2,0.3,-0.4,1.5", "1,3,4,,nan,7", "2,,,,,")
        assert drive.start.tolist() == [0.3, -0.4, 1.5]

    def test_but_what_is_no_number_in_them_shows_damage(self, tmp_path: Path):
        with pytest.raises(PathFileError, match=r"expected a finite number, got '-0\.9837;58'"):
            read(tmp_path, POSES, "0,1,2,0.3,-0.4,1.5", "1,3,4,-0.9837;58,0,0", "2,,,,,")

    def test_columns_in_any_order_and_others_among_them(self, tmp_path: Path):
        header = "battery, wheel_speed_left ,t,wheel_speed_right"
        drive = read(tmp_path, header, "full, 2 ,0,1", "low,4,0.1,3", ",,0.2,")
        assert drive.inputs.tolist() == [[1, 2], [3, 4]]
        assert drive.duration == pytest.approx(0.2)

    @pytest.mark.parametrize("times", [(0, 1, 2), (5, 6, 7), (-1, 0, 1)])
    def test_times_may_begin_anywhere(self, tmp_path: Path, times):
        drive = read(tmp_path, HEADER, *(f"{time},1,1" for time in times))
        assert drive.duration == 3.0

    def test_times_may_be_rounded(self, tmp_path: Path):
        times = [f"{index / 30:.5f}" for index in range(31)]
        drive = read(tmp_path, HEADER, *(f"{time},1,1" for time in times[:-1]), f"{times[-1]},,")
        assert drive.duration == pytest.approx(1.0)

    def test_windows_line_ends(self, tmp_path: Path):
        drive = read(tmp_path, f"{HEADER}\r", "0,1,2\r", "1,3,4\r", "2,,\r")
        assert drive.inputs.tolist() == [[1, 2], [3, 4]]

    def test_the_mark_that_spreadsheets_put_first(self, tmp_path: Path):
        drive = read(tmp_path, f"\ufeff{HEADER}", "0,1,2", "1,3,4", "2,,")
        assert drive.inputs.tolist() == [[1, 2], [3, 4]]

    def test_rest_is_the_studys(self, tmp_path: Path):
        lines = (HEADER, "0,1,2", "1,3,4")
        moving = problem_of(design=SPACES["free"])
        ends = [read(tmp_path, *lines, problem=one).inputs_at(np.array([0.0])) for one in (PROBLEM, moving)]
        assert [end.tolist() for end in ends] == [[[0, 0]], [[1, 2]]]


class TestCutShort:
    """A file that ends too early is refused, wherever it breaks off."""

    WHOLE = trajectory_csv(
        PROBLEM, random_drive(PROBLEM, 0), evaluate(PROBLEM, random_drive(PROBLEM, 0)).states
    )

    def test_anywhere(self, tmp_path: Path):
        for share in np.linspace(0.1, 0.99, 40):
            text = self.WHOLE[: int(share * len(self.WHOLE))]
            (tmp_path / "path.csv").write_text(text)
            with pytest.raises(PathFileError) as caught:
                read_trajectory(tmp_path / "path.csv", PROBLEM)
            assert caught.value.issues[0].line == len(text.splitlines()), share

    def test_between_two_rows(self, tmp_path: Path):
        rows = self.WHOLE.splitlines()
        (issue,) = issues_of(tmp_path, *rows[:20])
        assert issue.line == 20
        assert "the last row, with the final pose and no inputs, is missing" in issue.message
        (issue,) = issues_of(tmp_path, *rows[:-1])
        assert issue.line == len(rows) - 1

    def test_of_a_path_without_poses_within_a_number(self, tmp_path: Path):
        (tmp_path / "path.csv").write_text(f"{HEADER}\n0,1.5,1.5\n1,1.5,1.5\n2,1.5,1.")
        with pytest.raises(PathFileError, match="is the file cut short"):
            read_trajectory(tmp_path / "path.csv", PROBLEM)

    def test_a_row_of_other_length(self, tmp_path: Path):
        (issue,) = issues_of(tmp_path, POSES, "0,1,2,0,0,0", "1,3,4,0", "2,,,0,0,0")
        assert issue.line == 3
        assert "expected 6 cells, as in the header, got 4" in issue.message


class TestMistakes:
    @pytest.mark.parametrize(
        ("header", "missing"),
        [
            ("wheel_speed_right,wheel_speed_left", "t"),
            ("t,wheel_speed_right", "wheel_speed_left"),
            ("time,right,left", "t, wheel_speed_right, wheel_speed_left"),
        ],
    )
    def test_missing_columns(self, tmp_path: Path, header: str, missing: str):
        (issue,) = issues_of(tmp_path, header, "0,1,2", "1,2,3")
        assert issue.line == 1
        assert issue.message.startswith(f"the header lacks {missing};")
        assert header.split(",")[-1] in issue.message

    def test_another_text_is_not_told(self, tmp_path: Path):
        (issue,) = issues_of(tmp_path, "secret,secret,secret", "one,secret,2", "two,secret,3")
        assert "secret" not in issue.message
        (issue,) = issues_of(tmp_path, HEADER, f"0,{'z' * 10_000},1", "1,1,1", "2,0,0")
        assert len(issue.message) < 120

    @pytest.mark.parametrize("column", ["t", "wheel_speed_right", "wheel_speed_left"])
    def test_bad_numbers(self, tmp_path: Path, column: str):
        for cell in ("oops", "1.2.3", "nan", "inf", "-inf", "1e999", "1_0", "\u0663"):
            row = [cell if name == column else "1" for name in HEADER.split(",")]
            (issue,) = issues_of(tmp_path, HEADER, "0,1,1", ",".join(row), "2,1,1", "3,,")
            assert (issue.line, issue.key) == (3, column), cell
            assert issue.message == f"expected a finite number, got {cell!r}"

    def test_a_bad_start(self, tmp_path: Path):
        (issue,) = issues_of(tmp_path, POSES, "0,1,1,0,here,0", "1,1,1,0,0,0", "2,,,0,0,0")
        assert (issue.line, issue.key) == (2, "y")

    def test_every_bad_number_of_a_column_is_named(self, tmp_path: Path):
        issues = issues_of(tmp_path, HEADER, "0,a,1", "1,1,1", "2,b,1", "3,1,1")
        assert [(issue.line, issue.key) for issue in issues] == [
            (2, "wheel_speed_right"),
            (4, "wheel_speed_right"),
        ]

    def test_and_of_all_columns(self, tmp_path: Path):
        issues = issues_of(tmp_path, HEADER, "0,1,1", "x,1,1", "2,a,1", "3,1,b", "4,1,1")
        assert sorted((issue.line, issue.key) for issue in issues) == [
            (3, "t"),
            (4, "wheel_speed_right"),
            (5, "wheel_speed_left"),
        ]

    def test_empty_inputs_in_the_middle(self, tmp_path: Path):
        issues = issues_of(tmp_path, HEADER, "0,1,1", "1,,1", "2,1,1", "3,,")
        assert [(issue.line, issue.key) for issue in issues] == [(3, "wheel_speed_right")]
        assert "got ''" in issues[0].message

    def test_a_row_cut_short(self, tmp_path: Path):
        issues = issues_of(tmp_path, HEADER, "0,1,1", "1,1", "2,1,1", "3,,")
        assert [(issue.line, issue.key) for issue in issues] == [(3, "wheel_speed_left")]

    def test_a_last_row_half_empty(self, tmp_path: Path):
        (issue,) = issues_of(tmp_path, HEADER, "0,1,1", "1,1,1", "2,,1")
        assert issue.line == 4
        assert "expected numbers for wheel_speed_right, wheel_speed_left" in issue.message

    def test_blank_lines_do_not_shift_the_count(self, tmp_path: Path):
        (issue,) = issues_of(tmp_path, HEADER, "0,1,1", "", "", "1,1,oops", "2,1,1")
        assert issue.line == 5

    @pytest.mark.parametrize(
        ("times", "line"),
        [
            ((0, 1, 2.1, 3, 4), 4),
            ((0, 1, 2, 2, 3), 5),
            ((0, 1, 2, 3, 5), 6),
            ((0, 1, 2, 1, 2), 5),
        ],
        ids=["late", "stopped", "gap", "back"],
    )
    def test_uneven_times(self, tmp_path: Path, times, line: int):
        lines = [f"{time},1,1" for time in times]
        (issue,) = issues_of(tmp_path, HEADER, *lines)
        assert (issue.line, issue.key) == (line, "t")
        assert "expected even steps" in issue.message

    @pytest.mark.parametrize("times", [(0, 0, 0), (3, 2, 1)], ids=["still", "backwards"])
    def test_times_that_do_not_rise(self, tmp_path: Path, times):
        (issue,) = issues_of(tmp_path, HEADER, *(f"{time},1,1" for time in times))
        assert (issue.line, issue.key) == (3, "t")

    def test_times_that_fall_are_said_to(self, tmp_path: Path):
        (issue,) = issues_of(tmp_path, HEADER, "0.3,1,1", "0.2,1,1", "0.1,,")
        assert issue.message == "expected t to rise, got 0.2 s after 0.3 s"

    @pytest.mark.parametrize("cell", ["1e13", "-1e29"])
    def test_numbers_beyond_all_robots(self, tmp_path: Path, cell: str):
        (issue,) = issues_of(tmp_path, HEADER, "0,1,1", f"1,{cell},1", "2,1,1")
        assert (issue.line, issue.key) == (3, "wheel_speed_right")
        assert "at most 1e+12" in issue.message

    @pytest.mark.parametrize("column", ["t", "wheel_speed_left", "x", "note"])
    def test_a_column_twice(self, tmp_path: Path, column: str):
        (issue,) = issues_of(tmp_path, f"{POSES},note,{column}", *["0,1,1,0,0,0,,1"] * 3)
        assert issue.line == 1
        assert f"has {column} twice" in issue.message

    @pytest.mark.parametrize(("header", "lacking"), [("t,RL,x,y", "heading"), ("t,RL,heading", "x, y")])
    def test_a_start_in_part(self, tmp_path: Path, header: str, lacking: str):
        header = header.replace("RL", "wheel_speed_right,wheel_speed_left")
        (issue,) = issues_of(tmp_path, header, *["0,1,1,0,0"] * 3)
        assert issue.line == 1
        assert f"but not {lacking}: give all or none" in issue.message

    def test_a_stray_quote(self, tmp_path: Path):
        (issue,) = issues_of(tmp_path, HEADER, "0,1,1", '1,"1,1', "2,1,1", '3,"1,1', "4,1,1")
        assert issue.line == 3

    @pytest.mark.parametrize("rows", [[], ["0,1,1"]])
    def test_too_few_rows(self, tmp_path: Path, rows: list[str]):
        (issue,) = issues_of(tmp_path, HEADER, *rows)
        assert "at least two rows" in issue.message

    def test_too_few_rows_with_inputs(self, tmp_path: Path):
        (issue,) = issues_of(tmp_path, HEADER, "0,1,1", "1,,")
        assert issue.line == 2
        assert "at least two rows" in issue.message

    def test_an_empty_file(self, tmp_path: Path):
        (tmp_path / "path.csv").write_text("")
        with pytest.raises(PathFileError, match="expected a header"):
            read_trajectory(tmp_path / "path.csv", PROBLEM)

    def test_no_file(self, tmp_path: Path):
        with pytest.raises(PathFileError, match="no such file"):
            read_trajectory(tmp_path / "nowhere.csv", PROBLEM)

    def test_a_folder(self, tmp_path: Path):
        with pytest.raises(PathFileError, match="expected a file, got a folder"):
            read_trajectory(tmp_path, PROBLEM)

    def test_no_text(self, tmp_path: Path):
        (tmp_path / "path.csv").write_bytes(b"\xff\xfe\x00t")
        with pytest.raises(PathFileError, match="cannot be read"):
            read_trajectory(tmp_path / "path.csv", PROBLEM)
