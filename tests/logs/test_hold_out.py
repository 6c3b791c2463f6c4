"""Parts of logs that are used: the last part kept as test data, one pose in so many."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from logged import HEADER, cells, drive, flaw_of, form, found, read_one, write
from pydantic import ValidationError

from oed.foundation.errors import LogError
from oed.logs import last_held_out

TABLE = drive()


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
        assert len(caught.value.flaws) == 2


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
        flaw = flaw_of(write(tmp_path / "a.csv", cells(TABLE)), thin=100)
        assert (flaw.key, flaw.named) == ("thin", ("log", "thin"))
        assert flaw.message == "a: one in 100 of 200 poses leaves 2; at least 3 are needed"

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
