"""What is found in a log that can be read: each put into a sound one, told with its place and size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from logged import (
    HEADER,
    INPUTS,
    PERIOD,
    ROBOT,
    cells,
    doubtful,
    drive,
    form,
    found,
    issues_of,
    read_one,
    write,
)

from oed.logs import read_logs

TABLE = drive()
ANGLES = {name: {"column": name, "form": "angle"} for name in INPUTS}


def resting(before: int = 0, after: int = 0) -> np.ndarray:
    """The drive with rows of standing around it."""
    table = np.vstack([np.repeat(TABLE[:1], before, axis=0), TABLE, np.repeat(TABLE[-1:], after, axis=0)])
    table[:before, 1:3] = 0
    table[len(table) - after - 1 :, 1:3] = 0
    table[:, 0] = PERIOD * np.arange(len(table))
    return table


class TestGaps:
    GAPPED = np.delete(TABLE, slice(60, 80), axis=0)

    def test_speeds_are_not_known_across_one(self, tmp_path: Path):
        log = read_one(write(tmp_path / "a.csv", cells(self.GAPPED)))
        assert found(log) == {
            "gap": "1 gap in the rows; the longest is 1.05 s from t = 2.95 s (line 61); "
            "what the wheels did meanwhile was not logged"
        }
        assert doubtful(log) == {"gap"}

    def test_a_counter_runs_on(self, tmp_path: Path):
        table = TABLE.copy()
        table[:, 1:3] = np.cumsum(TABLE[:, 1:3], axis=0)
        gapped = np.delete(table, slice(60, 80), axis=0)
        log = read_one(write(tmp_path / "a.csv", cells(gapped)), inputs=ANGLES)
        assert not doubtful(log)
        assert {one.name for one in log.findings} == {"gap"}
        np.testing.assert_allclose(log.integrals, gapped[:, 1:3] - gapped[0, 1:3])

    def test_how_long_one_is_can_be_said(self, tmp_path: Path):
        file = write(tmp_path / "a.csv", cells(self.GAPPED))
        assert read_one(file, gap="1.1 s").findings == ()
        assert len(read_one(file, gap="1 s").findings) == 1
        assert read_one(file, gap="1.1 s").gap == 1.1


class TestClocks:
    def test_uneven(self, tmp_path: Path):
        table = TABLE.copy()
        table[:, 0] += 0.02 * np.sin(97 * np.arange(len(table)))
        log = read_one(write(tmp_path / "a.csv", cells(table)))
        assert set(found(log)) == {"uneven_clock"}
        assert found(log)["uneven_clock"].startswith("the times of the rows are uneven: steps of 0.0")

    def test_little_overlap(self, tmp_path: Path):
        table = np.column_stack([TABLE, TABLE[:, 0] + 6])
        file = write(tmp_path / "a.csv", cells(table), (*HEADER, "t_pose"))
        log = read_one(file, poses={"time": "t_pose"})
        assert doubtful(log) == {"little_overlap"}
        assert found(log)["little_overlap"] == "only 40 % of the poses lie within the time of the inputs"

    def test_rows_that_are_there_twice(self, tmp_path: Path):
        rows = cells(TABLE)
        log = read_one(write(tmp_path / "a.csv", [*rows[:9], rows[8], *rows[9:]]))
        assert found(log) == {"duplicate_rows": "1 row(s) repeat the one before, time and all; left out"}
        np.testing.assert_array_equal(log.input_times, TABLE[:, 0])

    @pytest.mark.slow
    @pytest.mark.parametrize("keys", [{}, {"inputs": ANGLES}], ids=["speeds", "angles"])
    def test_a_time_that_is_there_twice_among_many(self, tmp_path: Path, keys: dict[str, Any]):
        times = np.arange(2000) / 100
        turned = 3 * np.sin(times)[:, None] + [0, 0.1]
        values = turned if keys else 3 * np.cos(times)[:, None] * [1, 1]
        table = np.column_stack([times, values, 0.1 * turned, 0.1 + 0 * times])
        clean = read_one(write(tmp_path / "a.csv", cells(table)), **keys)
        table[700, 0] = table[701, 0]
        log = read_one(write(tmp_path / "b.csv", cells(table)), **keys)
        assert found(log) == {
            **found(clean),
            "same_times": "1 row(s) have the time of the next one, by a slip of the logger; left out",
        }
        kept = np.delete(np.arange(2000), 700)
        np.testing.assert_array_equal(log.input_times, times[kept])
        np.testing.assert_array_equal(log.poses, clean.poses[kept])
        np.testing.assert_allclose(log.integrals, clean.integrals[kept], atol=1e-3)


class TestStanding:
    def test_before_and_after(self, tmp_path: Path):
        log = read_one(write(tmp_path / "a.csv", cells(resting(30, 60))))
        assert found(log) == {
            "stationary_start": "the robot stands for the first 1.5 s, not informative about its wheels",
            "stationary_end": "the robot stands for the last 3 s, not informative about its wheels",
        }
        assert len(log.poses) == len(TABLE) + 90

    def test_it_can_be_cut_off(self, tmp_path: Path):
        log = read_one(write(tmp_path / "a.csv", cells(resting(30, 60))), skip_stationary=True)
        assert log.input_times[0] == pytest.approx(0.5)
        assert log.pose_times[-1] == pytest.approx(PERIOD * (30 + len(TABLE) - 1) + 1)
        assert np.all(log.integrals[0] == 0)

    def test_an_encoder_that_shakes(self, tmp_path: Path):
        table = resting(40)
        table[:40:4, 1] = 1e-2
        table[2:40:4, 1] = -1e-2
        log = read_one(write(tmp_path / "a.csv", cells(table)))
        assert found(log)["stationary_start"].startswith("the robot stands for the first 2 s")

    def test_all_the_time(self, tmp_path: Path):
        still = TABLE.copy()
        still[:, 1:3] = 0
        still[:, 3:] = 1
        files = [write(tmp_path / "a.csv", cells(TABLE)), write(tmp_path / "b.csv", cells(still))]
        _, log = read_logs(files, form(), ROBOT)
        assert found(log) == {"stationary": "the wheels stand all the time"}

    def test_one_wheel_in_one_of_several_drives(self, tmp_path: Path):
        still = TABLE.copy()
        still[:, 1] = 0
        files = [write(tmp_path / "a.csv", cells(TABLE)), write(tmp_path / "b.csv", cells(still))]
        first, second = read_logs(files, form(), ROBOT)
        assert first.findings == ()
        assert doubtful(second) == {"wheel_still"}
        assert found(second)["wheel_still"] == "wheel_speed_right never turn(s) in this drive"


class TestHeldPoses:
    HELD = np.column_stack([TABLE[:, :3], TABLE[np.arange(len(TABLE)) // 4 * 4, 3:]])

    def test_only_changes_are_kept(self, tmp_path: Path):
        log = read_one(write(tmp_path / "a.csv", cells(self.HELD)))
        np.testing.assert_allclose(log.pose_times, TABLE[::4, 0])
        np.testing.assert_allclose(log.poses, TABLE[::4, 3:])
        assert found(log) == {
            "held_poses": "150 of 200 poses (75 %) repeat the one before while the wheels turn, "
            "as a slower sensor's do; left out, a new one comes every 0.2 s"
        }

    def test_unless_they_are_wanted(self, tmp_path: Path):
        log = read_one(write(tmp_path / "a.csv", cells(self.HELD)), poses={"held": "keep"})
        assert len(log.poses) == 200
        assert log.findings == ()

    def test_a_standing_robot_s_pose_may_repeat(self, tmp_path: Path):
        log = read_one(write(tmp_path / "a.csv", cells(resting(30, 60))))
        assert "held_poses" not in found(log)

    def test_a_start_from_rest_on_another_clock(self, tmp_path: Path):
        # The wheels turn for 0.3 s before the poses begin to change: an offset, not a slow sensor.
        table = resting(30, 0)
        table[:-6, 1:3] = table[6:, 1:3]
        log = read_one(write(tmp_path / "a.csv", cells(table)))
        assert len(log.poses) == len(table)

    def test_a_reference_that_freezes(self, tmp_path: Path):
        table = TABLE.copy()
        table[100:140, 3:] = table[100, 3:]
        log = read_one(write(tmp_path / "a.csv", cells(table)))
        assert found(log) == {
            "tracker_lost": "39 of 200 poses repeat the one before while the wheels turn, as those of a "
            "tracker that lost the robot: 1 time, the longest for 1.95 s from t = 5.05 s (line 103); "
            "left out",
            "gap": "1 gap in the poses; the longest is 2 s from t = 5 s (line 102); "
            "the wheels carry segments on through it",
        }

    def test_a_slow_reference_that_freezes(self, tmp_path: Path):
        table = self.HELD.copy()
        for first, last in ((48, 80), (120, 160)):
            table[first:last, 3:] = table[first, 3:]
        log = read_one(write(tmp_path / "a.csv", cells(table)))
        times = TABLE[::4, 0]
        kept = ~((times > 2.41) & (times < 3.99)) & ~((times > 6.01) & (times < 7.99))
        np.testing.assert_allclose(log.pose_times, times[kept])
        assert found(log)["held_poses"].startswith("96 of 200 poses (48 %)")
        assert found(log)["held_poses"].endswith("a new one comes every 0.2 s")
        assert "70 of 200 poses" in found(log)["tracker_lost"]
        assert "2 times, the longest for 1.95 s from t = 6.05 s" in found(log)["tracker_lost"]

    def test_a_reference_that_is_frozen_from_the_start(self, tmp_path: Path):
        table = resting(30, 0)
        table[:110, 3:] = table[0, 3:]
        log = read_one(write(tmp_path / "a.csv", cells(table)))
        assert "1 time, the longest for 3.95 s from t = 1.55 s" in found(log)["tracker_lost"]
        np.testing.assert_allclose(log.pose_times, np.delete(table[:, 0], slice(31, 110)))

    def test_a_reference_that_loses_a_standing_robot(self, tmp_path: Path):
        # Nothing shows that it is lost until the wheels turn.
        log = read_one(write(tmp_path / "a.csv", cells(resting(30, 60))))
        assert found(log).keys() == {"stationary_start", "stationary_end"}

    def test_a_gap_that_a_study_names(self, tmp_path: Path):
        table = TABLE.copy()
        table[100:140, 3:] = table[100, 3:]
        log = read_one(write(tmp_path / "a.csv", cells(table)), gap="1 s")
        assert found(log)["gap"].endswith("; segments end there, as `gap` asks")


class TestHeadings:
    @pytest.mark.parametrize("turn", [np.pi, 2 * np.pi])
    def test_full_turns_are_taken_out(self, tmp_path: Path, turn: float):
        table = TABLE.copy()
        table[:, 5] = 0.9 * TABLE[:, 0]
        running = table[:, 5].copy()
        table[:, 5] = np.mod(running + 2 * np.pi - turn, 2 * np.pi) - (2 * np.pi - turn)
        log = read_one(write(tmp_path / "a.csv", cells(table)))
        np.testing.assert_allclose(log.poses[:, 2], running, atol=1e-12)
        count = int(np.sum(np.abs(np.diff(table[:, 5])) > 3))
        words = "1 time" if count == 1 else f"{count} times"
        assert found(log) == {"wrapped_heading": f"the heading jumps by a full turn {words}; unwrapped"}

    @pytest.mark.parametrize("wrapped", [True, False])
    def test_degrees_taken_for_radians(self, tmp_path: Path, wrapped: bool):
        table = TABLE.copy()
        degrees = np.degrees(1.2 * TABLE[:, 0])
        table[:, 5] = np.mod(degrees + 180, 360) - 180 if wrapped else degrees
        log = read_one(write(tmp_path / "a.csv", cells(table)))
        assert "heading_in_degrees" in doubtful(log)
        assert found(log)["heading_in_degrees"].endswith("if it is in degrees, say `unit: deg`")

    def test_many_turns_in_radians_are_none(self, tmp_path: Path):
        table = TABLE.copy()
        table[:, 5] = 5 * TABLE[:, 0]
        assert read_one(write(tmp_path / "a.csv", cells(table))).findings == ()


class TestLostTrack:
    @pytest.mark.parametrize(("rows", "words"), [(slice(120, 121), "2 times"), (slice(120, None), "1 time")])
    def test_a_jump_of_the_position(self, tmp_path: Path, rows: slice, words: str):
        table = TABLE.copy()
        table[rows, 4] += 0.8
        log = read_one(write(tmp_path / "a.csv", cells(table)))
        assert doubtful(log) == {"pose_jump"}
        message = found(log)["pose_jump"]
        assert message.startswith(f"the pose jumps {words}, most by 0.8")
        assert "m after t = 5.95 s (line 121): the reference may have lost track" in message

    def test_a_jump_of_the_heading(self, tmp_path: Path):
        table = TABLE.copy()
        table[120, 5] += 1.5
        log = read_one(write(tmp_path / "a.csv", cells(table)))
        assert doubtful(log) == {"pose_jump"}
        assert found(log)["pose_jump"].startswith("the heading jumps 2 times, most by 1.5")


def test_a_counter_that_begins_anew_is_run_on(tmp_path: Path):
    table = TABLE.copy()
    degrees = np.degrees(np.cumsum(TABLE[:, 1:3], axis=0) * PERIOD)
    table[:, 1:3] = np.mod(degrees, 360)
    keys = {name: {"column": name, "form": "angle", "unit": "deg", "wrap": 360} for name in INPUTS}
    log = read_one(write(tmp_path / "a.csv", cells(table)), inputs=keys)
    np.testing.assert_allclose(log.integrals, np.radians(degrees - degrees[0]), atol=1e-9)
    count = int(np.sum(np.abs(np.diff(table[:, 1:3], axis=0)) > 180))
    assert found(log) == {"counter_wrapped": f"counters began anew {count} times; unwrapped"}


class TestPosesBeside:
    """A file of poses is written by another program than the log."""

    @pytest.mark.parametrize(("delimiter", "name"), [(";", ";"), ("|", "|"), ("\t", "tab")])
    def test_it_has_a_delimiter_and_a_header_of_its_own(self, tmp_path: Path, delimiter: str, name: str):
        log = write(tmp_path / "a.csv", cells(TABLE[:, :3]), HEADER[:3])
        rows = [delimiter.join(map(str, row)) for row in TABLE[:, [0, 3, 4, 5]]]
        columns = {"time": {"column": 0}, "x": {"column": 1}, "y": {"column": 2}, "heading": {"column": 3}}
        own = {"file": "{stem}_poses.csv", "delimiter": name, "header": True, **columns}
        (tmp_path / "a_poses.csv").write_text(delimiter.join("1234") + "\n" + "\n".join(rows) + "\n")
        found = read_one(log, poses=own)
        np.testing.assert_allclose(found.poses, TABLE[:, 3:])
        # Names that are numbers pass for a row where it is not said that they are names.
        issue = issues_of(log, poses={**own, "header": False})[0]
        assert issue.message == "time goes back: 0 s after 1 s (line 1)"


class TestWildReadings:
    def found(self, folder: Path, rows: slice, value: float, **keys: Any) -> dict[str, str]:
        table = TABLE.copy()
        table[rows, 1] = value
        return dict(found(read_one(write(folder / "a.csv", cells(table)), **keys)))

    def test_one_that_no_drive_explains(self, tmp_path: Path):
        text = self.found(tmp_path, slice(60, 61), -900.0)["wild_reading"]
        assert text.startswith("wheel_speed_right reads -900 rad/s at t = 3 s (line 62), where at most ")
        assert text.endswith(" are usual: is that reading wrong?")

    @pytest.mark.parametrize(("rows", "value"), [(slice(60, 70), 900.0), (slice(60, 61), 20.0)])
    def test_fast_driving_is_none(self, tmp_path: Path, rows: slice, value: float):
        assert "wild_reading" not in self.found(tmp_path, rows, value)

    def test_ticks_since_the_row_before(self, tmp_path: Path):
        ticks = {"column": INPUTS[0], "form": "ticks", "ticks_per_turn": 100}
        text = self.found(tmp_path, slice(60, 61), 5000.0, inputs={INPUTS[0]: ticks})["wild_reading"]
        assert text.startswith("wheel_speed_right reads 5000 ticks at t = 3 s (line 62)")
