"""Parts of logs that are used: the last part kept as test data, one pose in so many."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from logged import HEADER, cells, drive, form, found, issue_of, read_one, write
from pydantic import ValidationError

from oed.foundation.errors import LogError
from oed.logs import Log, last_held_out
from oed.logs.log import SensorReadings
from oed.logs.motions import Motions

TABLE = drive()
TIMES = 0.1 * np.arange(101)


def every_reading(wrong_from: float = np.inf, **keys: object) -> Log:
    """A log of 10 s with readings on both clocks, all of which are wrong from a time on; other keys."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=(101, 3)) + 5.0 * (wrong_from <= TIMES)[:, None]
    ranges, rates = (
        SensorReadings(name, TIMES, values, clock) for name, clock in (("r", "poses"), ("g", "inputs"))
    )
    log = Log("a", "a.csv", TIMES, np.outer(TIMES, [1, 2]), TIMES, values, sensors=(ranges, rates))
    return replace(log, **keys)


def moving(wrong_from: float = np.inf, long: float = 0.0) -> Log:
    """A log of motions of 0.4 s that overlap, with covariances, and of one that lasts longer."""
    spans = np.column_stack([TIMES[:-4:2], TIMES[4::2]])
    if long:
        spans = np.vstack([spans, [3.0, 3.0 + long]])
        spans = spans[np.argsort(spans[:, 1], kind="stable")]
    wrong = spans[:, 1] >= wrong_from
    values = np.tile([0.01, 0.002, 0.1], (len(spans), 1)) + wrong[:, None]
    sizes = 1e-6 * (1 + wrong)[:, None, None] * np.eye(3)
    log = every_reading(sensors=(), motions=Motions(spans, values, sizes))
    return log.following(np.ones(len(spans), dtype=bool))


def content(log: Log) -> list[np.ndarray]:
    """All numbers of a log."""
    motions = log.motions
    own = [] if motions is None else [motions.times, motions.values, motions.covariances, motions.begins]
    read = [column for one in log.sensors for column in (one.times, one.values)]
    return [log.pose_times, log.poses, *own, *read]


class TestHoldOut:
    def test_poses_are_split_in_time_and_wheels_are_whole(self, tmp_path: Path):
        log = read_one(write(tmp_path / "a.csv", cells(TABLE)))
        (kept,), (held,) = last_held_out([log], 0.25)
        before = TABLE[:, 0] < 0.75 * TABLE[-1, 0]
        np.testing.assert_allclose(kept.poses, TABLE[before, 3:])
        np.testing.assert_allclose(held.poses, TABLE[~before, 3:])
        np.testing.assert_array_equal(held.pose_times, log.pose_times[~before])
        assert kept.integrals is log.integrals is held.integrals
        assert (kept.name, held.name) == ("a", "a (last 25 %)")
        assert found(kept)["held_out"].startswith("the last 25 % of each drive is test data")

    @pytest.mark.parametrize("made", [every_reading, moving, lambda *wrong: moving(*wrong, long=6.0)])
    def test_nothing_that_is_held_out_is_in_what_is_kept(self, made):
        kept, held = last_held_out([made(), made(7.5)], 0.25)
        for one, same in zip(*map(content, kept), strict=True):
            np.testing.assert_array_equal(one, same)
        assert any(np.any(one != other) for one, other in zip(*map(content, held), strict=True))

    def test_readings_are_split_as_poses_are(self):
        (kept,), (held,) = last_held_out([every_reading()], 0.25)
        assert [len(one.times) for one in kept.sensors] == [75, 75]
        assert [one.times[0] for one in held.sensors] == [7.5, 7.5]

    def test_motions_across_the_cut_are_in_neither_part(self):
        (kept,), (held,) = last_held_out([moving(long=6.0)], 0.25)
        assert kept.motions is not None
        assert held.motions is not None
        assert kept.motions.times[:, 1].max() < 7.5 <= held.motions.times[:, 0].min()
        assert len(kept.motions) + len(held.motions) == len(TIMES[4::2]) - 2
        assert kept.pose_times[-1] < 7.5 <= held.pose_times[0]

    def test_a_short_drive_of_several_is_used_whole(self):
        short = every_reading(name="b", pose_times=TIMES[:8], poses=np.zeros((8, 3)))
        kept, held = last_held_out([every_reading(), short], 0.25)
        assert [one.name for one in held] == ["a (last 25 %)"]
        assert kept[1].poses is short.poses
        assert found(kept[1])["not_held_out"].startswith(
            "b: holding out the last 25 % of 700 ms leaves 2 of 8"
        )
        assert found(kept[1])["not_held_out"].endswith("are needed: all of it is estimated from")

    @pytest.mark.parametrize("quantities", [(), ("heading",)])
    def test_logs_without_positions(self, quantities: tuple[str, ...]):
        log = every_reading(quantities=quantities, poses=np.zeros((101, len(quantities))))
        with pytest.raises(
            LogError, match=r"a\.csv: hold_out: .* has no positions .*; name x and y in log\.poses"
        ):
            last_held_out([log, log], 0.25)

    def test_it_is_said_once_of_a_file(self, tmp_path: Path):
        log = read_one(write(tmp_path / "a.csv", cells(TABLE)))
        kept, held = last_held_out([log, log], 0.1)
        assert [len(one.findings) for one in (*kept, *held)] == [1, 0, 0, 0]

    @pytest.mark.parametrize(("share", "side"), [(0.005, "in them"), (0.999, "before them")])
    def test_too_little_on_either_side(self, tmp_path: Path, share: float, side: str):
        log = read_one(write(tmp_path / "a.csv", cells(TABLE)))
        with pytest.raises(
            LogError, match=rf"a\.csv: a: holding out the last .* of 9\.95 s leaves [12] of 200 poses {side}"
        ):
            last_held_out([log], share)

    def test_every_log_that_is_too_short_is_named(self, tmp_path: Path):
        logs = [read_one(write(tmp_path / f"{name}.csv", cells(TABLE[:5]))) for name in "ab"]
        with pytest.raises(LogError) as caught:
            last_held_out(logs, 0.25)
        assert len(caught.value.issues) == 2


class TestThin:
    @pytest.mark.parametrize("each", [1, 2, 10, 66])
    def test_poses_are_fewer_and_wheels_whole(self, tmp_path: Path, each: int):
        log = read_one(write(tmp_path / "a.csv", cells(TABLE)), thin=each)
        np.testing.assert_allclose(log.poses, TABLE[::each, 3:])
        assert len(log.input_times) == 200
        assert ("thinned_poses" in found(log)) == (each > 1)

    def test_it_counts_poses_that_are_new_and_numbers(self, tmp_path: Path):
        rows = cells(TABLE)
        for index in range(1, 200, 2):
            rows[index][3:] = rows[index - 1][3:]
        rows[4][3] = rows[5][3] = "nan"
        log = read_one(write(tmp_path / "a.csv", rows), thin=3, skip_invalid_rows=True)
        kept = np.delete(np.arange(0, 200, 2), 2)[::3]
        np.testing.assert_allclose(log.poses, TABLE[kept, 3:])

    def test_to_nothing(self, tmp_path: Path):
        issue = issue_of(write(tmp_path / "a.csv", cells(TABLE)), thin=100)
        assert (issue.key, issue.named) == ("thin", ("log", "thin"))
        assert issue.message == "a: one in 100 of 200 poses leaves 2; at least 3 are needed"

    @pytest.mark.parametrize("each", [0, -1, 1.5, "ten", "10 %", [2], 1e9 + 0.5, {"every": 2}, True])
    def test_of_no_number(self, each: object):
        with pytest.raises(ValidationError):
            form(thin=each)

    def test_of_poses_in_a_file_of_their_own(self, tmp_path: Path):
        write(tmp_path / "poses.csv", [[row[0], *row[3:]] for row in cells(TABLE)], ("t", *HEADER[3:]))
        log = read_one(
            write(tmp_path / "a.csv", cells(TABLE)), thin=5, poses={"file": "poses.csv", "time": "t"}
        )
        np.testing.assert_allclose(log.poses, TABLE[::5, 3:])
