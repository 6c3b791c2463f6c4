"""Every fault of a log, each broken into a sound one: named with its file, line and column."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logged import HEADER, INPUTS, ROBOT, cells, drive, form, issue_of, issues_of, read_one, write
from pydantic import ValidationError

from oed.foundation.errors import LogError, ProblemError
from oed.logs import read_logs
from oed.robots.models import Tricycle

TABLE = drive()
TICKS = {
    name: {"column": name, "form": "ticks", "ticks_per_turn": 1000, "cumulative": True} for name in INPUTS
}


@pytest.fixture
def rows() -> list[list[str]]:
    return cells(TABLE)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "a.csv"


class TestFiles:
    def test_missing(self, file: Path):
        assert issue_of(file).message == "no such file"

    def test_a_folder(self, file: Path):
        file.mkdir()
        assert issue_of(file).message == "expected a file, got a folder"

    @pytest.mark.parametrize("text", ["", "\n\n", "# nothing\n"])
    def test_empty(self, file: Path, text: str):
        file.write_text(text)
        assert issue_of(file).message == "the file has no rows"

    def test_not_text(self, file: Path):
        file.write_bytes(b"\xff\xfe\x00\x81" * 10)
        said = "cannot be read: not UTF-8 text; if it is text, save it as UTF-8"
        assert issue_of(file).message == said
        file.write_bytes(b"t,x\n0,0\n# Gr\xf6\xdfe\n")
        assert (issue_of(file).line, issue_of(file).message) == (3, said)

    def test_not_a_table(self, file: Path):
        file.write_text('t,x\n"' + "a" * 200_000 + '",1\n')
        assert issue_of(file).message.startswith("is not a table: field larger")

    @pytest.mark.parametrize("place", [0, 3, 5])
    def test_a_stray_quote_swallows_nothing(self, file: Path, rows: list[list[str]], place: int):
        rows[4][place] = '"' + rows[4][place]
        rows[9][place] = rows[9][place] + '"'
        write(file, rows)
        issue = issue_of(file)
        assert issue.line == 6
        assert "a stray double quote" in issue.message

    def test_a_quote_within_a_cell_is_no_number(self, file: Path, rows: list[list[str]]):
        rows[4][3] = '1"2'
        write(file, rows)
        assert issue_of(file).line == 6

    def test_a_quote_in_the_last_cell_of_all(self, file: Path, rows: list[list[str]]):
        rows[-1][-1] = f'"{rows[-1][-1]}'
        write(file, rows)
        assert issue_of(file).line == len(rows) + 1

    @pytest.mark.parametrize(("place", "key"), [(0, "t"), (3, "x"), (4, "y"), (5, "heading")])
    def test_numbers_beyond_all_robots(self, file: Path, rows: list[list[str]], place: int, key: str):
        rows[-1][place] = "1e29"
        write(file, rows)
        poses = {"x": {"column": "x", "unit": "mm"}, "y": {"column": "y", "unit": "mm"}}
        issue = issues_of(file, poses=poses)[0]
        assert (issue.line, issue.key) == (len(rows) + 1, key)
        assert "expected a number of at most 1e+12 in SI units" in issue.message

    def test_inputs_beyond_all_robots(self, file: Path, rows: list[list[str]]):
        rows[4][1] = "-1e20"
        write(file, rows)
        issue = issues_of(file)[0]
        # The wheel has turned so far by the next row.
        assert (issue.line, issue.key) == (7, "wheel_speed_right")

    def test_no_files(self):
        with pytest.raises(Exception, match="no logs were given"):
            read_logs([], form(), ROBOT)

    @pytest.mark.parametrize("name", ["a.mcap", "a.db3", "a.bag", "folder"])
    def test_a_bag(self, tmp_path: Path, name: str):
        if name == "folder":
            (tmp_path / name).mkdir()
            (tmp_path / name / "metadata.yaml").write_text("")
        message = "is a ROS bag, not a CSV; say `kind: rosbag` under `log`"
        assert issue_of(tmp_path / name).message == message

    def test_all_issues_of_all_files_at_once(self, tmp_path: Path, rows: list[list[str]]):
        rows[3][1] = "?"
        rows[4][0] = rows[3][0]
        rows[9][4] = "inf"
        first = write(tmp_path / "p.csv", rows)
        second = write(tmp_path / "q.csv", cells(TABLE), (*HEADER[:5], "theta"))
        issues = issues_of(first, second, tmp_path / "r.csv")
        assert [(Path(issue.file).name, issue.line) for issue in issues] == [
            ("p.csv", 5),
            ("p.csv", 6),
            ("p.csv", 11),
            ("q.csv", 1),
            ("r.csv", 0),
        ]

    def test_few_of_a_kind_are_told(self, file: Path, rows: list[list[str]]):
        for row in rows[20:60]:
            row[1] = "nan"
        issues = issues_of(write(file, rows))
        assert [issue.line for issue in issues] == list(range(22, 32))
        assert issues[-1].message == "expected a finite number, got 'nan' (and 30 more like it)"


class TestDecimals:
    @pytest.fixture
    def commas(self, rows: list[list[str]]) -> list[list[str]]:
        return [[cell.replace(".", ",") for cell in row] for row in rows]

    def test_with_commas_are_said_once_a_column(self, file: Path, commas: list[list[str]]):
        issues = issues_of(write(file, commas, mark=";"))
        assert [issue.key for issue in issues] == list(HEADER)
        assert issues[0].message == "decimals need a point, got 200 with a comma, such as '0,0'"

    def test_with_commas_between_commas_are_cells_too_many(self, file: Path, commas: list[list[str]]):
        issue = issues_of(write(file, commas))[0]
        assert issue.line == 2
        assert issue.message == "expected 6 cells, as in the first line, got 12 (decimals need a point)"

    def test_a_header_may_lack_the_name_of_the_index(self, file: Path, rows: list[list[str]]):
        write(file, [[*row, "0"] for row in rows])
        np.testing.assert_allclose(read_one(file).poses, TABLE[:, 3:])


class TestColumns:
    def test_missing_in_the_header(self, file: Path, rows: list[list[str]]):
        write(file, rows, ("time", "right", "wheel_speed_left", "x", "y", "theta"))
        known = "; it has time, right, wheel_speed_left, x, y, theta"
        assert [(issue.line, issue.key, issue.message) for issue in issues_of(file)] == [
            (1, "time", f"the header lacks 't'{known}"),
            (1, "wheel_speed_right", f"the header lacks 'wheel_speed_right'; did you mean right?{known[1:]}"),
            (1, "heading", f"the header lacks 'heading'{known}"),
        ]

    @pytest.mark.parametrize(
        ("column", "hint"),
        [("X_mm", "x_mm"), ("y", "pose.y"), ("x", "x_mm"), ("yw", "yaw"), ("wheel", "wheel_r or wheel_l")],
    )
    def test_the_nearest_names_are_proposed(self, file: Path, rows: list[list[str]], column: str, hint: str):
        write(file, rows, ("t", "wheel_r", "wheel_l", "x_mm", "pose.y", "yaw"))
        inputs = {"wheel_speed_right": "wheel_r", "wheel_speed_left": "wheel_l"}
        poses = {"x": column, "y": "pose.y", "heading": "yaw"}
        issue = issue_of(file, inputs=inputs, poses=poses)
        assert issue.message == (
            f"the header lacks {column!r}; did you mean {hint}? it has t, wheel_r, wheel_l, x_mm, pose.y, yaw"
        )
        assert issue.named == ("log", "poses", "x", "column")

    def test_names_without_a_header(self, file: Path, rows: list[list[str]]):
        issues = issues_of(write(file, rows, None))
        assert len(issues) == 6
        assert issues[0].message == (
            "the file has no header, so 't' is not known; give the column's index, from 0"
        )

    def test_beyond_the_last(self, file: Path, rows: list[list[str]]):
        issue = issue_of(write(file, rows), time=6)
        assert issue.message == "there is no column 6; the last one is 5, from 0"

    @pytest.mark.parametrize("place", [0, 2, 4])
    def test_text_in_the_first_row_of_numbers(self, file: Path, rows: list[list[str]], place: int):
        rows[0][place] = "lost"
        keys = {"time": 0, "inputs": dict(zip(INPUTS, (1, 2), strict=True))}
        issue = issue_of(write(file, rows, None), **keys, poses={"x": 3, "y": 4, "heading": 5})
        hint = "its first row has numbers, and so is no header; where it is one, say `header: true`"
        assert (issue.line, issue.column) == (1, place + 1)
        assert issue.message == f"expected a finite number, got 'lost' ({hint})"
        assert issues_of(file)[0].message.endswith(f"give the column's index, from 0 ({hint})")

    def test_twice_in_the_header(self, file: Path, rows: list[list[str]]):
        issue = issue_of(write(file, [[*row, "0"] for row in rows], (*HEADER, "x")))
        assert issue.message == "the header has 'x' 2 times; give the column's index, from 0"

    def test_of_runs_and_of_what_to_keep(self, file: Path, rows: list[list[str]]):
        issues = issues_of(write(file, rows), runs="window", keep={"steady": 1})
        assert sorted(issue.key for issue in issues) == ["runs", "steady"]

    @pytest.mark.parametrize("of_poses", [False, True])
    def test_of_rows_to_keep(self, file: Path, rows: list[list[str]], of_poses: bool):
        rows = [[*row, "1", "auto", "x" if place == 5 else "1", "1", "1"] for place, row in enumerate(rows)]
        write(file, rows, (*HEADER, "good", "mode", "odd", "twice", "twice"))
        wrong = {}
        for keep, line, message in (
            ({"steady": 1}, 1, "the header lacks 'steady'"),
            ({"mode": "hand"}, 0, "no row has mode = hand"),
            ({"mode": 1}, 2, "expected finite numbers, and the column has none"),
            ({"good": "1.0"}, 0, "no row has good = 1.0"),
            ({"good": 7}, 0, "no row has good = 7"),
            ({"good": 1, "mode": "off"}, 0, "no row has good = 1 and mode = off"),
            ({"odd": 1}, 7, "expected a finite number, got 'x'"),
            ({99: 1}, 1, "the header lacks '99'"),
            ({"twice": 1}, 1, "the header has 'twice' 2 times"),
        ):
            issue = issue_of(file, **({"poses": {"keep": keep}} if of_poses else {"keep": keep}))
            key = ("poses.keep" if of_poses else "keep") if message.startswith("no row") else issue.key
            if message not in issue.message or (issue.line, issue.key) != (line, key):
                wrong[message] = issue
        assert wrong == {}

    def test_no_rows_of_a_tum_file_to_keep(self, file: Path):
        with pytest.raises(ProblemError, match=r"log\.poses\.keep: a TUM file has no further columns"):
            read_logs([file], form(poses={"file": "{stem}.tum", "keep": {"a": 1}}), ROBOT)

    def test_nothing_to_keep(self, file: Path, rows: list[list[str]]):
        issue = issue_of(write(file, rows), keep={"x": [100, 200]})
        assert issue.message == "no row has x from 100 to 200"

    def test_ranges_to_keep_are_turned_the_right_way(self):
        with pytest.raises(ValidationError, match=r"keep\.x.*\n.*expected \[low, high\], got \[2, 1\]"):
            form(keep={"x": [2, 1]})

    @pytest.mark.slow
    def test_runs_that_are_none(self, file: Path, rows: list[list[str]]):
        issue = issue_of(write(file, rows), runs="x")
        assert issue.message == "none of its 200 runs has 3 rows; does another column tell them apart?"
        assert issue.named == ("log", "runs", "column")

    def test_another_text_is_not_told(self, file: Path):
        file.write_text("root:x:0:0:root:/root:/bin/sh\nuucp:x:10:10:uucp:/var/uucp:/bin/no\nsecret one\n")
        issues = issues_of(file) + issues_of(file, poses={"x": {"column": 0}})
        issues += issues_of(file, time=0, poses={"x": {"column": 1}, "y": "none", "heading": "none"})
        said = "\n".join(f"{issue.key}: {issue.message}" for issue in issues)
        assert "the header lacks 't'; its first line does not look like one: is it the right file?" in said
        assert "column 0: expected finite numbers, and the column has none" in said
        assert not [word for word in ("root", "uucp", "secret") if word in said]

    def test_what_is_told_has_an_end(self, file: Path, rows: list[list[str]]):
        issues = issues_of(write(file, rows, tuple(f"c{number}" for number in range(1000))))
        assert issues[0].message.endswith(", c38, c39 and 960 more")
        rows[0][1] = "z" * 10_000
        assert len(issue_of(write(file, rows)).message) < 120


class TestCells:
    def test_no_finite_number(self, file: Path, rows: list[list[str]]):
        said, wanted = {}, {}
        for cell in ("nan", "inf", "abc", "1e300", "-", "1_0", "\u0663", ""):
            for column, name in enumerate(HEADER):
                broken = [*rows[:7], [*rows[7][:column], cell, *rows[7][column + 1 :]], *rows[8:20]]
                issue = issue_of(write(file, broken))
                said[cell, column] = (issue.line, issue.column, issue.key, issue.message)
                got = f"got {cell!r}" if cell else "the cell is empty"
                wanted[cell, column] = (9, column + 1, name, f"expected a finite number, {got}")
        assert said == wanted

    def test_a_decimal_comma(self, file: Path, rows: list[list[str]]):
        rows[0][1] = "0,5"
        assert issue_of(write(file, rows, mark=";")).message.endswith("got '0,5' (decimals need a point)")

    def test_a_short_row(self, file: Path, rows: list[list[str]]):
        rows[7] = rows[7][:5]
        issue = issue_of(write(file, rows))
        assert (issue.line, issue.key) == (9, "heading")

    @pytest.mark.parametrize("mark", [",", ";", " "])
    def test_a_cell_too_many(self, file: Path, rows: list[list[str]], mark: str):
        # All after it stand in columns of others.
        rows[7][4:4] = ["463.78"]
        issue = issue_of(write(file, rows, mark=mark))
        assert issue.line == 9
        assert issue.message == f"expected {len(HEADER)} cells, as in the first line, got {len(HEADER) + 1}"

    def test_empty_cells_too_many_do_no_harm(self, file: Path, rows: list[list[str]]):
        before = read_one(write(file, rows), ROBOT)
        after = read_one(write(file, [[*row, "", " "] for row in rows]), ROBOT)
        np.testing.assert_array_equal(before.poses, after.poses)

    def test_no_inputs_at_all(self, file: Path, rows: list[list[str]]):
        empty = [[row[0], "", "", *row[3:]] for row in rows]
        assert issue_of(write(file, empty)).message == "a has 0 row(s) of inputs; at least 3 are needed"

    def test_no_poses_at_all(self, file: Path, rows: list[list[str]]):
        empty = [[*row[:3], "", "", ""] for row in rows]
        assert issue_of(write(file, empty)).message == "a has 0 row(s) of poses; at least 3 are needed"


class TestClocks:
    def test_time_goes_back(self, file: Path, rows: list[list[str]]):
        rows[7][0] = "0.12"
        issue = issue_of(write(file, rows))
        assert (issue.line, issue.key) == (9, "t")
        assert issue.message == "time goes back: 0.12 s after 0.3 s (line 8)"

    def test_time_stands_still(self, file: Path, rows: list[list[str]]):
        rows[7][0] = rows[6][0]
        issue = issue_of(write(file, rows))
        assert (issue.line, issue.key) == (9, "t")
        assert issue.message == "time stands still: 0.3 s, the same as in the row before (line 8)"

    def test_of_poses(self, file: Path, rows: list[list[str]]):
        own = [[*row, row[0]] for row in rows]
        own[7][-1] = "0.1"
        issue = issue_of(write(file, own, (*HEADER, "t_pose")), poses={"time": "t_pose"})
        assert (issue.line, issue.key) == (9, "t_pose")

    def test_several_runs_without_a_column_for_them(self, file: Path, rows: list[list[str]]):
        issue = issue_of(write(file, [*rows, *rows]))
        assert (issue.line, issue.message) == (202, "time goes back: 0 s after 9.95 s (line 201)")

    @pytest.mark.parametrize("shift", [-1000.0, 1000.0])
    def test_no_overlap(self, file: Path, shift: float):
        table = np.column_stack([TABLE, TABLE[:, 0] + shift])
        issue = issue_of(write(file, cells(table), (*HEADER, "t_pose")), poses={"time": "t_pose"})
        assert issue.message == (
            f"the clocks do not overlap: inputs from 0 to 9.95 s, "
            f"poses from {shift:g} to {shift + 9.95:.10g} s; "
            "are the units of time and the time zones alike, and do both clocks begin at the same moment?"
        )

    def test_too_few_rows(self, file: Path, rows: list[list[str]]):
        messages = [issue.message for issue in issues_of(write(file, rows[:2]))]
        assert messages == [
            "a has 2 row(s) of inputs; at least 3 are needed",
            "a has 2 row(s) of poses; at least 3 are needed",
        ]


class TestWheels:
    def test_one_that_never_turns(self, file: Path):
        table = TABLE.copy()
        table[:, 2] = 0
        issue = issue_of(write(file, cells(table)))
        assert issue.message == "wheel_speed_left never turn(s) in any of the logs; is it the right column?"

    def test_a_counter_that_begins_anew(self, file: Path):
        table = TABLE.copy()
        counts = np.round(np.cumsum(TABLE[:, 1:3], axis=0) * 100)
        table[:, 1:3] = np.mod(counts + 30_000, 65_536)
        issues = issues_of(write(file, cells(table)), inputs=TICKS)
        assert {issue.key for issue in issues} <= set(INPUTS)
        assert "the counter jumps from" in issues[0].message
        assert (
            "if it begins anew, say `wrap: 65536`, and if it was reset, cut the log here" in issues[0].message
        )

    def test_a_counter_that_is_reset(self, file: Path):
        table = TABLE.copy()
        table[:, 1:3] = np.round(np.cumsum(TABLE[:, 1:3], axis=0) * 10)
        table[100:, 1] -= table[100, 1]
        issue = issue_of(write(file, cells(table)), inputs=TICKS)
        assert issue.line == 102
        assert "say after how much with `wrap:`, and if it was reset, cut the log here" in issue.message

    def test_a_counter_that_leaves_its_range(self, file: Path):
        table = TABLE.copy()
        table[:, 1:3] = np.round(np.cumsum(TABLE[:, 1:3], axis=0) * 10)
        wrapped = {name: {**keys, "wrap": 256} for name, keys in TICKS.items()}
        issues = issues_of(write(file, cells(table)), inputs=wrapped)
        assert all("more than `wrap: 256` allows" in issue.message for issue in issues)
        assert [issue.line for issue in issues] == [
            int(np.argmax(np.abs(table[:, place]) > 256)) + 2 for place in (1, 2)
        ]

    @pytest.mark.parametrize("low", [0, -128])
    @pytest.mark.parametrize("glitch", [300, -400])
    def test_a_single_reading_outside_of_a_counters_range(self, file: Path, low: int, glitch: int):
        table = TABLE.copy()
        table[:, 1:3] = low + np.mod(np.round(np.cumsum(TABLE[:, 1:3], axis=0)) + 240, 256)
        table[50, 1] = glitch
        wrapped = {name: {**keys, "wrap": 256} for name, keys in TICKS.items()}
        (issue,) = [
            one for one in issues_of(write(file, cells(table)), inputs=wrapped) if "span" in one.message
        ]
        assert (issue.line, issue.key) == (52, "wheel_speed_right")

    def test_a_counter_that_jumps_by_half_its_range(self, file: Path):
        table = TABLE.copy()
        table[:, 1:3] = np.mod(np.round(np.cumsum(TABLE[:, 1:3], axis=0)), 256)
        table[50, 1] = np.mod(table[49, 1] + 128, 256)
        wrapped = {name: {**keys, "wrap": 256} for name, keys in TICKS.items()}
        issues = issues_of(write(file, cells(table)), inputs=wrapped)
        assert issues[0].line == 52
        assert issues[0].message.startswith("the counter jumps by about half of its range 256, from ")

    def test_a_pose_that_never_changes(self, file: Path):
        table = TABLE.copy()
        table[:, 3:] = 1.0
        message = "a: the pose hardly ever changes while the wheels turn; did the reference run?"
        assert issue_of(write(file, cells(table))).message == message


class TestTum:
    def write(self, tmp_path: Path, line: str) -> Path:
        sound = [f"{time} 0 0 0 0 0 0 1" for time in (0.0, 1.0, 2.0, 3.0)]
        (tmp_path / "a.tum").write_text("\n".join([*sound[:2], line, *sound[2:]]))
        return write(tmp_path / "a.csv", cells(TABLE[:, :3]), HEADER[:3])

    @pytest.mark.parametrize(
        ("line", "message"),
        [
            ("1.5 0 0 0 0 0 0 2", "expected a unit quaternion in qx qy qz qw"),
            ("1.5 0 0 0 0 0 0 w", "expected a finite number, got 'w'"),
            ("1.5 0 0 0 0 0 0", "expected a finite number, the cell is empty"),
            ("0.5 0 0 0 0 0 0 1", "time goes back: 0.5 s after 1 s (line 2)"),
        ],
    )
    def test_a_line(self, tmp_path: Path, line: str, message: str):
        (issue,) = issues_of(self.write(tmp_path, line), poses={"file": "{stem}.tum"})
        assert (issue.file, issue.line, issue.message) == (str(tmp_path / "a.tum"), 3, message)

    def test_other_columns(self, tmp_path: Path):
        file = self.write(tmp_path, "1.5 0 0 0 0 0 0 1")
        (tmp_path / "a.tum").write_text("0 0 0 0\n1 0 0 0\n")
        (issue,) = issues_of(file, poses={"file": "{stem}.tum"})
        assert issue.message == "expected 8 columns (timestamp tx ty tz qx qy qz qw), got 4"

    def test_missing(self, tmp_path: Path):
        (issue,) = issues_of(self.write(tmp_path, ""), poses={"file": "b.tum"})
        said = (str(tmp_path / "b.tum"), "no such file; did you mean a.tum?")
        assert (issue.file, issue.message) == said

    def test_a_state_it_cannot_have(self, tmp_path: Path):
        file = self.write(tmp_path, "1.5 0 0 0 0 0 0 1")
        with pytest.raises(ProblemError, match="the robot has no state bend; it has x, y, heading"):
            read_logs([file], form(poses={"file": "{stem}.tum", "bend": 3}), ROBOT)


class TestForms:
    """What a study says of its logs: against the robot, and against itself."""

    def test_inputs_that_do_not_fit_the_robot(self):
        wrong = {}
        for inputs, message in (
            ({"wheel": 1}, "the robot has no input wheel; it has wheel_speed, steering_angle"),
            ({"wheel_speed": {"column": 1, "form": "value"}}, "its form is speed, got 'value'"),
            ({"wheel_speed": {"column": 1, "unit": "m/s^2"}}, "whose unit is of another kind"),
            ({"wheel_speed": {"column": 1, "radius": "5 cm"}}, "give the rim's `unit`, e.g. m/s"),
            ({"wheel_speed": {"column": 1, "unit": "rpm", "radius": 5}}, "give the rim's `unit`, e.g. m/s"),
            ({"wheel_speed": {"column": 1, "form": "angle", "zero": 1}}, "is that of a steered wheel"),
            ({"wheel_speed": {"column": 1, "form": "angle", "unit": "deg/s"}}, "of another kind"),
            ({"steering_angle": {"column": 1, "form": "speed"}}, "its form is value, got 'speed'"),
            ({"steering_angle": {"column": 1, "form": "angle", "unit": "mm"}}, "of another kind"),
            ({"steering_angle": {"column": 1, "unit": "deg/s"}}, "of another kind"),
            (
                {"steering_angle": {"column": 1, "form": "ticks", "ticks_per_turn": 8, "zero": 3}},
                "`zero` is of a cumulative counter; add `cumulative: true`",
            ),
            (
                {"wheel_speed": {"column": 1, "form": "ticks", "ticks_per_turn": 8, "wrap": 9}},
                "`wrap` is of a cumulative counter; add `cumulative: true`",
            ),
        ):
            issues = form(inputs=inputs).issues(Tricycle(wheel_radius=0.03, wheelbase=0.15))
            said = [(issue.key[:2], message in issue.message) for issue in issues]
            if said != [(("log", "inputs"), True)]:
                wrong[message] = issues
        assert wrong == {}

    @pytest.mark.parametrize(
        ("poses", "key", "message"),
        [
            ({"trailer_angle": 4}, "trailer_angle", "the robot has no state trailer_angle"),
            ({"x": {"column": 1, "unit": "deg"}}, "unit", "whose unit is of another kind"),
            ({"x": "none", "y": "none", "heading": "none"}, "poses", "nothing of the robot's pose"),
            ({"form": "tum"}, "form", "is that of a file of its own"),
        ],
    )
    def test_poses_that_do_not_fit_the_robot(self, poses: dict, key: str, message: str):
        (issue,) = form(poses=poses).issues(ROBOT)
        assert issue.key[-1] == key
        assert message in issue.message

    def test_they_are_told_before_anything_is_read(self):
        with pytest.raises(ProblemError, match=r"log\.inputs\.wheel"):
            read_logs(["nowhere.csv"], form(inputs={"wheel": 1}), ROBOT)

    def test_what_is_no_form_of_a_log(self):
        for keys in (
            {"kind": "text"},
            {"nonsense": 1},
            {"delimiter": "::"},
            {"time": -1},
            {"time": True},
            {"time": {"column": 1, "unit": "h"}},
            {"gap": 0},
            {"inputs": {"wheel": {"column": 1, "form": "ticks"}}},
            {"inputs": {"wheel": {"column": 1, "sign": 2}}},
            {"inputs": {"wheel": {"column": 1, "ticks_per_turn": 2}}},
            {"poses": {"x": {"column": 1, "nonsense": 2}}},
            {"poses": {"held": "maybe"}},
            {"kind": "rosbag", "time": 0},
            {"kind": "rosbag", "clock": "wall"},
        ):
            with pytest.raises(ValidationError):
                pytest.fail(f"{keys} are taken for {form(**keys)}")

    @pytest.mark.parametrize(
        "keys",
        [
            {},
            {"kind": "rosbag", "poses": "/odom", "inputs": {INPUTS[0]: "right"}},
            {"runs": "window", "keep": {"steady": 1, "mode": "auto", "speed": [0, 2]}, "gap": "0.5 s"},
            {"inputs": TICKS, "poses": {"x": 1, "heading": "none", "bend": {"column": 3, "unit": "deg"}}},
        ],
    )
    def test_a_form_can_be_written_and_read_again(self, keys: dict):
        plain = form(**keys).model_dump(mode="json", exclude_none=True)
        assert form(**plain) == form(**keys)


def test_nothing_after_the_header(file: Path):
    file.write_text(f"{','.join(HEADER)}\n", encoding="utf-8")
    with pytest.raises(LogError, match=r"a\.csv: the file has no rows after its header"):
        read_logs([file], form(), ROBOT)
