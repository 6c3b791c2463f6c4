"""Logs that come into a folder: which may be one, and when it is complete."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from looping import STUDY

from oed.workflow.arrivals import LogFolder, twin_of
from oed.workflow.studies import parse_study


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    (tmp_path / "logs").mkdir()
    return tmp_path / "logs"


class TestFolder:
    def folder(self, logs: Path, text: str = "", pattern: str | None = None) -> LogFolder:
        return LogFolder(logs, parse_study(f"{STUDY}{text}").log, pattern)

    def test_what_may_be_a_log(self, logs):
        for name in ("a.csv", "b.txt", ".hidden", "c.csv.part", "d.csv~", "empty.csv"):
            (logs / name).write_text("" if name == "empty.csv" else "x")
        (logs / "bag").mkdir()
        assert list(self.folder(logs).found()) == ["a.csv", "b.txt"]
        assert list(self.folder(logs, pattern="*.csv").found()) == ["a.csv"]

    def test_poses_beside_a_log_are_part_of_it(self, logs):
        log = "log: {poses: {file: '{stem}_poses.csv'}}\n"
        (logs / "a.csv").write_text("x")
        before = self.folder(logs, log).found()
        (logs / "a_poses.csv").write_text("x")
        after = self.folder(logs, log).found()
        assert list(after) == ["a.csv"]
        assert before != after

    def test_bags_are_complete_with_their_metadata(self, logs):
        log = "log: {kind: rosbag}\n"
        (logs / "bag").mkdir()
        (logs / "bag" / "bag_0.mcap").write_text("x")
        (logs / "other.csv").write_text("x")
        assert self.folder(logs, log).found() == {}
        (logs / "bag" / "metadata.yaml").write_text("x")
        assert list(self.folder(logs, log).found()) == ["bag"]

    def test_one_that_still_grows_is_waited_for(self, logs, monkeypatch):
        file, looks, now = logs / "a.csv", itertools.count(), [0.0]
        (logs / "known.csv").write_text("x")
        known = self.folder(logs).found()

        def pause(seconds: float) -> None:
            now[0] += seconds
            if next(looks) < 5:
                file.write_text("x" * int(now[0] + 1))

        monkeypatch.setattr("oed.workflow.arrivals.time.sleep", pause)
        monkeypatch.setattr("oed.workflow.arrivals.time.monotonic", lambda: now[0])
        found = self.folder(logs).complete(known, 1.0, 3.0)
        assert [(name, size) for name, (size, _) in found.items()] == [("a.csv", 6)]
        assert now[0] == pytest.approx(8.0, abs=1.1)


class TestTwins:
    """Logs that hold the same under another name."""

    def test_a_bag_is_all_that_its_folder_holds(self, logs):
        form = parse_study(f"{STUDY}log: {{kind: rosbag}}\n").log
        bags = [logs / name for name in ("one", "copy", "other")]
        for bag, text in zip(bags, ("x", "x", "y"), strict=True):
            bag.mkdir()
            (bag / "bag_0.mcap").write_text(text)
            (bag / "metadata.yaml").write_text("same")
        assert twin_of(bags[1], bags[::2], form) == bags[0]
        assert twin_of(bags[2], bags[:2], form) is None

    def test_what_lies_beside_is_part_of_them(self, logs):
        """The same commands may be driven twice."""
        form = parse_study(f"{STUDY}log: {{poses: {{file: '{{stem}}_poses.csv'}}}}\n").log
        one, other = logs / "one.csv", logs / "other.csv"
        for log, poses in ((one, "1"), (other, "2")):
            log.write_text("x")
            log.with_name(f"{log.stem}_poses.csv").write_text(poses)
        assert twin_of(other, [one], form) is None
        other.with_name("other_poses.csv").write_text("1")
        assert twin_of(other, [one], form) == one

    def test_what_cannot_be_read_is_no_twin(self, logs, monkeypatch):
        """The reader says what is wrong with it."""
        form, one, other = parse_study(STUDY).log, logs / "one.csv", logs / "other.csv"
        for log in (one, other):
            log.write_text("x")

        def forbidden(*_: object, **__: object) -> None:
            raise PermissionError(13, "Permission denied")

        assert twin_of(one, [logs / "gone.csv"], form) is None
        monkeypatch.setattr("filecmp.cmp", forbidden)
        assert twin_of(one, [other], form) is None
