"""Text tables read: where the columns are, in which units, in how many runs."""

from __future__ import annotations

import math
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from builders import problem_of, random_drive
from logged import HEADER, INPUTS, PERIOD, ROBOT, cells, doubtful, drive, form, found, read_one, write

from oed.foundation.errors import LogError
from oed.kernel.dynamics.space import Spline
from oed.kernel.evaluation import evaluate
from oed.kernel.measurement.measurement import Measurement
from oed.logs import read_logs
from oed.records.path_file import write_trajectory
from oed.robots.models import DifferentialDrive, TractorTrailer, Tricycle
from oed.robots.sensors import Poses, Ranges, Several
from oed.robots.space import DesignSpace

TABLE = drive()


def integrals(table: np.ndarray) -> np.ndarray:
    """Wheel angles of speeds that hold to the next row."""
    turned = table[:-1, 1:3] * np.diff(table[:, 0])[:, None]
    return np.vstack([np.zeros(2), np.cumsum(turned, axis=0)])


def require_alike(log, table=TABLE):
    np.testing.assert_allclose(log.input_times, table[:, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(log.integrals, integrals(table), rtol=0, atol=1e-9)
    np.testing.assert_allclose(log.pose_times, table[:, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(log.poses, table[:, 3:], rtol=0, atol=1e-9)


class TestByDefault:
    def test_a_plain_table_is_read_without_a_word(self, tmp_path: Path):
        log = read_one(write(tmp_path / "a.csv", cells(TABLE)))
        require_alike(log)
        assert (log.name, log.file) == ("a", str(tmp_path / "a.csv"))
        assert log.quantities == ("x", "y", "heading")
        assert log.findings == ()

    @pytest.mark.parametrize("runs", [1, 2])
    def test_the_package_reads_the_drives_it_has_written(self, tmp_path: Path, runs: int):
        design = DesignSpace(duration=10, samples=40, runs=runs, spline=Spline(coefficients=8))
        problem = problem_of(design=design)
        planned = random_drive(problem, 3)
        write_trajectory(tmp_path / "drive.csv", problem, planned, evaluate(problem, planned).states)
        logs = read_logs([tmp_path / "drive.csv"], form(), problem.model)
        assert [log.name for log in logs] == (["drive"] if runs == 1 else ["drive[1]", "drive[2]"])
        for log, inputs in zip(logs, np.split(planned.inputs, runs), strict=True):
            means = log.inputs_between(log.input_times)
            np.testing.assert_allclose(means, inputs, rtol=0, atol=1e-9)
            assert len(log.poses) == len(inputs) + 1

    def test_further_states_are_read_where_the_table_has_them(self, tmp_path: Path):
        robot = TractorTrailer(wheel_radius=0.05, track=0.2, trailer_length=0.3)
        table = np.column_stack([TABLE, np.sin(TABLE[:, 0])])
        file = write(tmp_path / "a.csv", cells(table), (*HEADER, "trailer_angle"))
        log = read_one(file, robot)
        assert log.quantities == robot.states
        np.testing.assert_array_equal(log.poses[:, log.quantities.index("trailer_angle")], table[:, -1])
        short = write(tmp_path / "b.csv", cells(TABLE))
        assert read_one(short, robot).quantities == ("x", "y", "heading")


class TestTables:
    @pytest.mark.parametrize("mark", [",", ";", "\t", " ", "   ", ", "])
    def test_delimiters_are_found(self, tmp_path: Path, mark: str):
        require_alike(read_one(write(tmp_path / "a.csv", cells(TABLE), mark=mark)))

    @pytest.mark.parametrize(("given", "mark"), [("|", "|"), ("tab", "\t"), ("blanks", " "), (";", ";")])
    def test_delimiters_are_given(self, tmp_path: Path, given: str, mark: str):
        require_alike(read_one(write(tmp_path / "a.csv", cells(TABLE), mark=mark), delimiter=given))

    def test_columns_by_their_index(self, tmp_path: Path):
        file = write(tmp_path / "a.csv", cells(TABLE), None)
        keys = {"time": 0, "inputs": {name: index + 1 for index, name in enumerate(INPUTS)}}
        require_alike(read_one(file, **keys, poses={"x": 3, "y": 4, "heading": 5}))

    def test_a_header_of_numbers_is_one_where_it_is_said(self, tmp_path: Path):
        file = write(tmp_path / "a.csv", cells(TABLE), "012345")
        keys = {"time": 0, "inputs": {name: index + 1 for index, name in enumerate(INPUTS)}}
        require_alike(read_one(file, header=True, **keys, poses={"x": 3, "y": 4, "heading": 5}))

    @pytest.mark.parametrize(
        "header",
        [("t", *"01234"), (*HEADER[:4], "7", "3"), ("", *HEADER[1:])],
    )
    def test_a_header_may_have_a_few_numbers(self, tmp_path: Path, header: tuple[str, ...]):
        places = {"time": 0, "inputs": dict(zip(INPUTS, (1, 2), strict=True))}
        file = write(tmp_path / "a.csv", cells(TABLE), header)
        require_alike(read_one(file, **places, poses={"x": 3, "y": 4, "heading": 5}))

    def test_text_in_the_first_row_alone_makes_no_header(self, tmp_path: Path):
        rows = [[*row, "ok"] for row in cells(TABLE)]
        places = {"time": 0, "inputs": dict(zip(INPUTS, (1, 2), strict=True))}
        poses = {"x": 3, "y": 4, "heading": 5}
        require_alike(read_one(write(tmp_path / "a.csv", rows, None), **places, poses=poses))
        rows[0][3:6] = ["None"] * 3
        log = read_one(write(tmp_path / "a.csv", rows, None), **places, poses=poses, skip_invalid_rows=True)
        np.testing.assert_allclose(log.pose_times, TABLE[1:, 0])
        np.testing.assert_allclose(log.input_times, TABLE[:, 0])

    def test_comments_and_empty_lines_are_passed_over(self, tmp_path: Path):
        lines = [",".join(HEADER), "# begun", "", *(",".join(row) for row in cells(TABLE)), "# ended", ""]
        (tmp_path / "a.csv").write_text("\n".join(lines))
        require_alike(read_one(tmp_path / "a.csv"))

    @pytest.mark.parametrize("column", [0, 1, 3])
    @pytest.mark.parametrize("delimiter", [",", ";", " ", "\t"])
    def test_error_of_a_spreadsheet_is_refused_in_any_column(
        self, tmp_path: Path, column: int, delimiter: str
    ):
        rows = cells(TABLE)
        rows[5][column] = "#DIV/0!"
        text = "\n".join(map(delimiter.join, [HEADER, *rows]))
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(LogError) as caught:
            read_one(tmp_path / "a.csv")
        issues = [(issue.line, issue.key, "#DIV/0!" in issue.message) for issue in caught.value.issues]
        assert issues == [(7, HEADER[column], True)]

    def test_row_of_errors_alone_is_refused(self, tmp_path: Path):
        rows = cells(TABLE)
        rows[5] = ["#N/A"] * len(HEADER)
        with pytest.raises(LogError) as caught:
            read_one(write(tmp_path / "a.csv", rows))
        assert {issue.line for issue in caught.value.issues} == {7}
        log = read_one(write(tmp_path / "a.csv", rows), skip_invalid_rows=True)
        assert {"skipped_inputs", "skipped_poses"} <= set(found(log))

    def test_lines_marked_as_comments_are_passed_over(self, tmp_path: Path):
        rows = cells(TABLE)
        rows.insert(5, [f"// {rows[5][0]}", *rows[5][1:]])
        rows.insert(5, ["#", *rows[5][1:]])
        (tmp_path / "a.csv").write_text("\n".join(map(",".join, [HEADER, *rows])))
        with pytest.raises(LogError, match="comment: '#'"):
            read_one(tmp_path / "a.csv")
        rows.pop(5)
        (tmp_path / "a.csv").write_text("\n".join(map(",".join, [HEADER, *rows])))
        require_alike(read_one(tmp_path / "a.csv", comment="//"))

    def test_comment_of_as_many_words_as_columns_is_passed_over(self, tmp_path: Path):
        lines = [" ".join(row) for row in [HEADER, *cells(TABLE)]]
        lines.insert(4, "# the robot is lifted again")
        (tmp_path / "a.csv").write_text("\n".join(lines))
        assert len(lines[4].split()) == len(HEADER)
        require_alike(read_one(tmp_path / "a.csv"))

    def test_a_comment_above_the_numbers_may_be_the_header(self, tmp_path: Path):
        lines = ["# by a logger", "#" + ",".join(HEADER), *(",".join(row) for row in cells(TABLE))]
        (tmp_path / "a.csv").write_text("\n".join(lines))
        require_alike(read_one(tmp_path / "a.csv"))

    def test_quotes_and_a_byte_order_mark(self, tmp_path: Path):
        quoted = [[f'"{cell}"' for cell in row] for row in cells(TABLE)]
        write(tmp_path / "a.csv", quoted, [f'"{name}"' for name in HEADER])
        text = (tmp_path / "a.csv").read_text()
        (tmp_path / "a.csv").write_text("\ufeff" + text, encoding="utf-8")
        require_alike(read_one(tmp_path / "a.csv"))

    def test_half_a_last_line_is_left_out(self, tmp_path: Path):
        rows = [*cells(TABLE), ["10.0", "3.1", "2."]]
        log = read_one(write(tmp_path / "a.csv", rows))
        require_alike(log)
        assert set(found(log)) == {"cut_off"}


@pytest.mark.slow
def test_a_long_log_takes_little_more_memory_than_its_file(tmp_path: Path):
    file = write(tmp_path / "a.csv", cells(drive(5000)))
    tracemalloc.start()
    read_one(file)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # The lines, and the numbers a few times over: cells as objects of their own would take twice as much.
    assert peak < 6 * file.stat().st_size


class TestUnits:
    def test_each_column_has_its_own(self, tmp_path: Path):
        table = TABLE.copy()
        table[:, 0] = 1000 * TABLE[:, 0]
        table[:, 1:3] = np.degrees(TABLE[:, 1:3])
        table[:, 3:5] = 1000 * TABLE[:, 3:5]
        table[:, 5] = np.degrees(TABLE[:, 5])
        log = read_one(
            write(tmp_path / "a.csv", cells(table)),
            time={"column": "t", "unit": "ms"},
            inputs={name: {"column": name, "unit": "deg/s"} for name in INPUTS},
            poses={
                "x": {"column": "x", "unit": "mm"},
                "y": {"column": 4, "unit": "mm"},
                "heading": {"column": "heading", "unit": "deg"},
            },
        )
        require_alike(log)

    def test_a_wheel_that_counts_the_other_way_round(self, tmp_path: Path):
        table = TABLE.copy()
        table[:, 2] *= -1
        file = write(tmp_path / "a.csv", cells(table))
        require_alike(read_one(file, inputs={"wheel_speed_left": {"column": INPUTS[1], "sign": -1}}))

    def test_a_steering_angle_is_joined_by_straight_lines(self, tmp_path: Path):
        robot = Tricycle(wheel_radius=0.03, wheelbase=0.15)
        header = ("t", "wheel_speed", "steering_angle", "x", "y", "heading")
        table = TABLE.copy()
        table[:, 2] = np.degrees(0.1 * TABLE[:, 0])
        keys = {"inputs": {"steering_angle": {"column": "steering_angle", "unit": "deg", "form": "value"}}}
        log = read_one(write(tmp_path / "a.csv", cells(table), header), robot, **keys)
        np.testing.assert_allclose(log.integrals[:, 1], 0.05 * TABLE[:, 0] ** 2, atol=1e-9)

    def test_a_pose_may_lack_a_quantity(self, tmp_path: Path):
        file = write(tmp_path / "a.csv", cells(TABLE[:, :5]), HEADER[:5])
        log = read_one(file, poses={"heading": "none"})
        assert log.quantities == ("x", "y")
        assert log.poses.shape == (len(TABLE), 2)

    def test_a_column_that_the_study_does_not_measure_is_left_out_and_told(self, tmp_path: Path):
        file = write(tmp_path / "a.csv", cells(TABLE))
        measurement = Poses(quantities=("x", "y"), noise={"position": 0.01})
        (log,) = read_logs([file], form(poses={"x": "x", "y": "y"}), ROBOT, measurement)
        assert log.quantities == ("x", "y")
        np.testing.assert_allclose(log.poses, TABLE[:, 3:5], rtol=0, atol=1e-9)
        assert [finding.name for finding in log.findings] == ["not_measured"]

    @pytest.mark.parametrize(
        ("measurement", "poses"),
        [
            (Poses(quantities=("x", "y"), noise={"position": 0.01}), {"heading": "heading"}),
            (Poses(noise={"position": 0.01, "heading": 0.01}), {}),
            (Ranges(beacons=[(3.0, 0.0)], noise=0.02), {}),
            (None, {}),
        ],
        ids=["named in the log", "measured", "no sensor of poses", "no study"],
    )
    def test_a_column_is_used_where_the_log_or_the_study_has_it(
        self, tmp_path: Path, measurement: Measurement | None, poses: dict[str, str]
    ):
        file = write(tmp_path / "a.csv", cells(TABLE))
        (log,) = read_logs([file], form(poses=poses), ROBOT, measurement)
        assert log.quantities == ("x", "y", "heading")
        assert log.findings == ()

    def test_what_two_sensors_of_poses_measure_is_used(self, tmp_path: Path):
        file = write(tmp_path / "a.csv", cells(TABLE))
        positions = Poses(quantities=("x", "y"), noise={"position": 0.01})
        measurement = Several(sensors=[positions, Poses(quantities=("heading",), noise={"heading": 0.01})])
        (log,) = read_logs([file], form(), ROBOT, measurement)
        assert log.quantities == ("x", "y", "heading")


class TestRuns:
    """Rows that belong together, and rows that are wanted."""

    ROWS = tuple([name, *row] for name, seed in (("b", 1), ("a", 2)) for row in cells(drive(50, seed=seed)))

    def test_each_is_a_log_on_its_own_clock(self, tmp_path: Path):
        logs = read_logs(
            [write(tmp_path / "a.csv", self.ROWS, ("window", *HEADER))], form(runs="window"), ROBOT
        )
        assert [log.name for log in logs] == ["a[b]", "a[a]"]
        require_alike(logs[0], drive(50, seed=1))
        require_alike(logs[1], drive(50, seed=2))

    def test_rows_of_several_runs_may_alternate(self, tmp_path: Path):
        rows = [row for pair in zip(self.ROWS[:50], self.ROWS[50:], strict=True) for row in pair]
        logs = read_logs([write(tmp_path / "a.csv", rows, ("run", *HEADER))], form(), ROBOT)
        require_alike(logs[0], drive(50, seed=1))
        require_alike(logs[1], drive(50, seed=2))

    def test_a_run_of_too_few_rows_is_left_out(self, tmp_path: Path):
        logs = read_logs([write(tmp_path / "a.csv", self.ROWS[:51], ("run", *HEADER))], form(), ROBOT)
        assert [log.name for log in logs] == ["a[b]"]
        assert found(logs[0])["short_runs"].endswith("left out: a[a]")

    def test_so_is_one_without_inputs_whose_poses_are_in_a_file_of_their_own(self, tmp_path: Path):
        rows = [row if row[0] == "b" else [*row[:2], "", "", *row[4:]] for row in self.ROWS]
        write(tmp_path / "poses.csv", cells(drive(50, seed=1)))
        log = write(tmp_path / "a.csv", rows, ("run", *HEADER))
        logs = read_logs([log], form(poses={"file": "poses.csv"}), ROBOT)
        assert [log.name for log in logs] == ["a[b]"]
        assert found(logs[0])["short_runs"].endswith("left out: a[a]")

    @pytest.mark.parametrize("keep", [{"steady": 1}, {"steady": [0.5, 2]}, {"mode": "auto"}])
    def test_only_some_rows_are_kept(self, tmp_path: Path, keep: dict):
        rows = [[*row, *(("1", "auto") if row[0] == "a" else ("0", "hand"))] for row in self.ROWS]
        file = write(tmp_path / "a.csv", rows, ("run", *HEADER, "steady", "mode"))
        (log,) = read_logs([file], form(keep=keep), ROBOT)
        assert log.name == "a[a]"
        require_alike(log, drive(50, seed=2))

    def test_rows_are_kept_by_a_column_s_index(self, tmp_path: Path):
        file = write(tmp_path / "a.csv", [[*row[1:], row[0]] for row in self.ROWS], None)
        keys = {"time": 0, "inputs": dict(zip(INPUTS, (1, 2), strict=True)), "header": False}
        poses = {"x": 3, "y": 4, "heading": 5}
        log = read_one(file, **keys, poses=poses, runs=6, keep={6: "a"})
        require_alike(log, drive(50, seed=2))

    def test_what_is_not_kept_for_long_is_not_driven_across(self, tmp_path: Path):
        rows = [[*row, "0" if 80 <= index < 120 else "1"] for index, row in enumerate(cells(TABLE))]
        file = write(tmp_path / "a.csv", rows, (*HEADER, "good"))
        first, second = read_logs([file], form(keep={"good": 1}), ROBOT)
        assert (first.name, second.name) == ("a.1", "a.2")
        require_alike(first, TABLE[:80])
        require_alike(second, TABLE[120:])

    def test_the_wheels_turn_on_where_only_poses_are_not_kept(self, tmp_path: Path):
        rows = [[*row, str(index % 2 or int(60 < index < 90))] for index, row in enumerate(cells(TABLE))]
        file = write(tmp_path / "a.csv", rows, (*HEADER, "lost"))
        log = read_one(file, poses={"keep": {"lost": 0}})
        kept = [index for index, row in enumerate(rows) if row[-1] == "0"]
        np.testing.assert_allclose(log.poses, TABLE[kept, 3:])
        np.testing.assert_allclose(log.integrals, integrals(TABLE), atol=1e-9)

    def test_rows_that_are_not_kept_are_as_if_they_were_not_there(self, tmp_path: Path):
        rows = [[*row, "1"] for row in cells(TABLE)]
        for index in (0, 7, 8, 50, 199):
            rows[index] = ["nan", "lost", "", "1e99", "x", "", "0"]
        log = read_one(write(tmp_path / "a.csv", rows, (*HEADER, "good")), keep={"good": 1})
        require_alike(log, np.delete(TABLE, [0, 7, 8, 50, 199], axis=0))

    def test_ticks_are_not_counted_across_a_row_that_is_not_kept(self, tmp_path: Path):
        ticks = {name: {"column": name, "form": "ticks", "ticks_per_turn": 1000} for name in INPUTS}
        rows = [[*row, str(int(index != 60))] for index, row in enumerate(cells(TABLE))]
        file = write(tmp_path / "a.csv", rows, (*HEADER, "good"))
        first, second = read_logs([file], form(keep={"good": 1}, inputs=ticks), ROBOT)
        assert (len(first.input_times), len(second.input_times)) == (60, 139)
        adding_up = {name: {**one, "cumulative": True} for name, one in ticks.items()}
        assert len(read_one(file, keep={"good": 1}, inputs=adding_up).input_times) == 199

    def test_rows_of_other_runs_are_none_that_are_left_out(self, tmp_path: Path):
        rows = [row for pair in zip(self.ROWS[:50], self.ROWS[50:], strict=True) for row in pair]
        file = write(tmp_path / "a.csv", rows, ("name", *HEADER))
        ticks = {name: {"column": name, "form": "ticks", "ticks_per_turn": 1000} for name in INPUTS}
        log = read_one(file, runs="name", keep={"name": "a"}, inputs=ticks)
        assert (log.name, len(log.input_times)) == ("a[a]", 50)

    def test_logs_of_one_name_have_their_folder_s(self, tmp_path: Path):
        files = []
        for name in "pq":
            (tmp_path / name).mkdir()
            files.append(write(tmp_path / name / "a.csv", cells(TABLE)))
        assert [log.name for log in read_logs(files, form(), ROBOT)] == ["p/a", "q/a"]


class TestClocksOfPoses:
    POSES = drive(120, 0.1)

    def require_both(self, log):
        np.testing.assert_allclose(log.integrals, integrals(TABLE), atol=1e-9)
        np.testing.assert_allclose(log.pose_times, self.POSES[:, 0] + 0.3, atol=1e-9)
        np.testing.assert_allclose(log.poses, self.POSES[:, 3:], atol=1e-9)

    @pytest.fixture
    def pose_rows(self) -> np.ndarray:
        return np.column_stack([self.POSES[:, 0] + 0.3, self.POSES[:, 3:]])

    def test_columns_of_another_length(self, tmp_path: Path, pose_rows: np.ndarray):
        inputs, poses = cells(TABLE[:, :3]), cells(pose_rows)
        rows = [
            [*own, *(poses[index] if index < len(poses) else [""] * 4)] for index, own in enumerate(inputs)
        ]
        file = write(tmp_path / "a.csv", rows, ("t", *INPUTS, "t_pose", "x", "y", "heading"))
        self.require_both(read_one(file, poses={"time": "t_pose"}))

    def test_more_poses_than_inputs(self, tmp_path: Path, pose_rows: np.ndarray):
        inputs, poses = cells(TABLE[:50, :3]), cells(pose_rows)
        rows = [[*(inputs[index] if index < 50 else [""] * 3), *own] for index, own in enumerate(poses)]
        file = write(tmp_path / "a.csv", rows, ("t", *INPUTS, "t_pose", "x", "y", "heading"))
        log = read_one(file, poses={"time": "t_pose"})
        assert (len(log.input_times), len(log.pose_times)) == (50, 120)
        assert doubtful(log) == {"little_overlap"}

    def test_rows_of_inputs_and_rows_of_poses_on_one_clock(self, tmp_path: Path):
        shifted = self.POSES[:90, 0] + 0.0123
        rows = [(row[0], [*text, "", "", ""]) for row, text in zip(TABLE, cells(TABLE[:, :3]), strict=True)]
        for time, text in zip(shifted, cells(self.POSES[:90, 3:]), strict=True):
            rows.append((time, [repr(float(time)), "", "", *text]))
        rows.sort(key=lambda row: row[0])
        log = read_one(write(tmp_path / "a.csv", [text for _, text in rows]))
        np.testing.assert_allclose(log.integrals, integrals(TABLE), atol=1e-9)
        np.testing.assert_allclose(log.pose_times, shifted)
        assert "empty_poses" in found(log)

    def test_a_slower_clock_of_repeated_poses(self, tmp_path: Path):
        place = np.arange(len(TABLE)) // 2
        poses = np.column_stack([TABLE[place, 0], TABLE[place, 3:]])
        rows = cells(np.column_stack([TABLE[:, :3], poses]))
        file = write(tmp_path / "a.csv", rows, ("t", *INPUTS, "t_pose", "x", "y", "heading"))
        log = read_one(file, poses={"time": "t_pose"})
        np.testing.assert_allclose(log.pose_times, TABLE[:100, 0])

    @pytest.mark.parametrize("keys", [{}, {"form": "csv"}])
    def test_a_csv_beside_the_log(self, tmp_path: Path, pose_rows: np.ndarray, keys: dict):
        file = write(tmp_path / "a.csv", cells(TABLE[:, :3]), HEADER[:3])
        write(tmp_path / "a_mocap.csv", cells(pose_rows), ("t", "x", "y", "heading"), ";")
        self.require_both(read_one(file, poses={"file": "{stem}_mocap.csv", **keys}))

    @pytest.mark.parametrize(("name", "keys"), [("a.tum", {}), ("poses.dat", {"form": "tum"})])
    def test_a_tum_file_beside_the_log(self, tmp_path: Path, pose_rows: np.ndarray, name: str, keys: dict):
        file = write(tmp_path / "a.csv", cells(TABLE[:, :3]), HEADER[:3])
        write_tum(tmp_path / name, pose_rows)
        self.require_both(read_one(file, poses={"file": name.replace("a.", "{stem}."), **keys}))

    def test_a_run_has_the_poses_of_its_time(self, tmp_path: Path):
        rows = [[str(index // 100), *text] for index, text in enumerate(cells(TABLE[:, :3]))]
        file = write(tmp_path / "a.csv", rows, ("run", *HEADER[:3]))
        write_tum(tmp_path / "a.tum", TABLE[:, [0, 3, 4, 5]])
        first, second = read_logs([file], form(poses={"file": "{stem}.tum"}), ROBOT)
        np.testing.assert_allclose(first.pose_times, TABLE[:120, 0], atol=1e-9)
        np.testing.assert_allclose(second.pose_times, TABLE[80:, 0], atol=1e-9)

    def test_a_run_has_the_poses_of_its_name(self, tmp_path: Path):
        both = [("1", drive(50, seed=1)), ("2", drive(60, seed=2))]
        inputs = [[name, *row] for name, table in both for row in cells(table[:, :3])]
        poses = [[name, *row] for name, table in both for row in cells(table[:, [0, 3, 4, 5]])]
        file = write(tmp_path / "a.csv", inputs, ("run", *HEADER[:3]))
        write(tmp_path / "poses.csv", poses, ("run", "t", "x", "y", "heading"))
        logs = read_logs([file], form(poses={"file": "poses.csv"}), ROBOT)
        for log, (_, table) in zip(logs, both, strict=True):
            require_alike(log, table)


def write_tum(file: Path, poses: np.ndarray) -> None:
    """Rows t, x, y, heading as timestamp, position, quaternion."""
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    for time, x, y, heading in poses.tolist():
        lines.append(f"{time!r} {x!r} {y!r} 0.1 0 0 {math.sin(heading / 2)!r} {math.cos(heading / 2)!r}")
    file.write_text("\n".join(lines) + "\n")


def test_mean_inputs_add_up_to_the_angles_turned(tmp_path: Path):
    log = read_one(write(tmp_path / "a.csv", cells(TABLE)))
    edges = np.array([0.013, 0.4, 3.21, 7.0])
    means = log.inputs_between(edges, offset=0.11)
    turned = (means * np.diff(edges)[:, None]).sum(axis=0)
    ends = [np.interp(edges[[0, -1]] + 0.11, log.input_times, column) for column in log.integrals.T]
    np.testing.assert_allclose(turned, [after - before for before, after in ends])


def test_the_last_row_s_inputs_may_be_empty(tmp_path: Path):
    rows = cells(TABLE)
    rows[-1][1:3] = ["", ""]
    require_alike(read_one(write(tmp_path / "a.csv", rows)))


@pytest.mark.parametrize("held", ["next", "previous", "between"])
def test_speeds_hold_as_said(tmp_path: Path, held: str):
    inputs = {name: {"column": name, "held": held} for name in INPUTS}
    log = read_one(
        write(tmp_path / "a.csv", cells(TABLE)), DifferentialDrive(wheel_radius=1, track=1), inputs=inputs
    )
    before, after = TABLE[:-1, 1:3], TABLE[1:, 1:3]
    expected = {"next": before, "previous": after, "between": (before + after) / 2}[held]
    np.testing.assert_allclose(np.diff(log.integrals, axis=0), PERIOD * expected, atol=1e-12)
