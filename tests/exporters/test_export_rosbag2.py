"""Bags, read back by the library that reads those of real robots."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from export_records import COMMANDED, STEERED, TRICYCLE, UNICYCLE, saved, simulated, study_of, winding
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from oed.exporters import STORAGES, export
from oed.exporters import rosbag2 as module
from oed.exporters.rosbag2 import COMMAND, JOINTS, PLAN, TOPICS
from oed.foundation.errors import UserMistake

STORE = get_typestore(Stores.ROS2_JAZZY)

each_storage = pytest.mark.parametrize("storage", STORAGES)


def messages(bag: Path, topic: str) -> Iterator[tuple[int, Any]]:
    """Stamps [ns] and messages of a topic."""
    with Reader(bag) as reader:
        for connection, stamp, data in reader.messages():
            if connection.topic == topic:
                yield stamp, STORE.deserialize_cdr(data, connection.msgtype)


def nanoseconds(header: Any) -> int:
    return int(header.stamp.sec * 10**9 + header.stamp.nanosec)


@each_storage
class TestContent:
    @pytest.mark.slow
    def test_topics(self, tmp_path: Path, storage: str):
        bag = export(saved(tmp_path, study_of()), "rosbag2", storage=storage)
        assert bag == tmp_path / "my_drive_bag"
        file = {"sqlite3": "my_drive_bag.db3", "mcap": "my_drive_bag.mcap"}[storage]
        assert {one.name for one in bag.iterdir()} == {file, "metadata.yaml"}
        with Reader(bag) as reader:
            found = {one.topic: (one.msgtype, one.msgcount) for one in reader.connections}
            assert (reader.start_time, reader.duration) == (0, 2 * 10**9 + 1)
        counts = {PLAN: 1, COMMAND: 9, JOINTS: 9}
        assert found == {topic: (kind, counts[topic]) for topic, kind in TOPICS.items()}

    @pytest.mark.slow
    def test_a_robot_on_commands_gets_those_of_the_design(self, tmp_path: Path, storage: str):
        """Not the motion that it makes of them; and it has no joints that anybody knows."""
        study = study_of(UNICYCLE, COMMANDED)
        bag = export(saved(tmp_path, study), "rosbag2", storage=storage)
        sent = [one.twist for _, one in messages(bag, COMMAND)]
        found = np.array([[one.linear.x, one.angular.z] for one in sent])
        np.testing.assert_array_equal(found[:-1], winding(study).inputs)
        with Reader(bag) as reader:
            assert {one.topic for one in reader.connections} == {PLAN, COMMAND}

    @pytest.mark.slow
    def test_commands(self, tmp_path: Path, storage: str):
        study = study_of()
        bag = export(saved(tmp_path, study), "rosbag2", storage=storage)
        stamps, found = zip(*messages(bag, COMMAND), strict=True)
        assert list(stamps) == [250_000_000 * k for k in range(9)]
        assert [nanoseconds(one.header) for one in found] == list(stamps)
        assert {one.header.frame_id for one in found} == {"base_link"}
        right, left = winding(study).inputs.T
        forward = [one.twist.linear.x for one in found]
        yaw_rates = [one.twist.angular.z for one in found]
        assert forward == pytest.approx([*((0.051 * right + 0.049 * left) / 2), 0.0])
        assert yaw_rates == pytest.approx([*((0.051 * right - 0.049 * left) / 0.2), 0.0])

    @pytest.mark.slow
    def test_joints_turn_as_commanded(self, tmp_path: Path, storage: str):
        study = study_of()
        bag = export(saved(tmp_path, study), "rosbag2", storage=storage, rate=10.0)
        stamps, found = zip(*messages(bag, JOINTS), strict=True)
        assert list(stamps) == [100_000_000 * k for k in range(21)]
        assert found[0].name == ["wheel_right_joint", "wheel_left_joint"]
        positions = np.array([one.position for one in found])
        velocities = np.array([one.velocity for one in found])
        assert np.diff(positions, axis=0) == pytest.approx(velocities[:-1] * 0.1)
        assert positions[0].tolist() == [0.0, 0.0]
        assert positions[-1] == pytest.approx(winding(study).inputs.sum(axis=0) * 0.25)
        assert velocities[-1].tolist() == [0.0, 0.0]
        assert len(found[0].effort) == 0

    @pytest.mark.slow
    def test_plan(self, tmp_path: Path, storage: str):
        study = study_of()
        bag = export(saved(tmp_path, study), "rosbag2", storage=storage)
        ((stamp, plan),) = messages(bag, PLAN)
        assert (stamp, plan.header.frame_id) == (0, "odom")
        expected = simulated(study.problem.model, winding(study))
        assert len(plan.poses) == len(expected) == 9
        for number, (one, (x, y, heading)) in enumerate(zip(plan.poses, expected, strict=True)):
            assert nanoseconds(one.header) == 250_000_000 * number
            assert (one.pose.position.x, one.pose.position.y) == pytest.approx((x, y))
            turn = one.pose.orientation
            # A turn about the vertical axis takes (1, 0) to (w^2 - z^2, 2 w z).
            axis = (turn.w**2 - turn.z**2, 2 * turn.w * turn.z)
            assert axis == pytest.approx((np.cos(heading), np.sin(heading)))
            assert (turn.x, turn.y) == (0.0, 0.0)
            assert turn.w**2 + turn.z**2 == pytest.approx(1.0)


def test_a_steered_wheel(tmp_path: Path):
    study = study_of(TRICYCLE, STEERED)
    bag = export(saved(tmp_path, study), "rosbag2")
    found = [message for _, message in messages(bag, JOINTS)]
    assert found[0].name == ["wheel_joint", "steering_joint"]
    angles = [one.position[1] for one in found]
    assert angles[:-1] == pytest.approx(winding(study).inputs[:, 1])
    assert angles[-1] == angles[-2]


@each_storage
@pytest.mark.slow
def test_every_run_is_a_bag_of_its_own(tmp_path: Path, storage: str):
    study = study_of(runs=2)
    folder = export(saved(tmp_path, study), "rosbag2", storage=storage)
    assert sorted(file.name for file in folder.iterdir()) == ["run1", "run2"]
    for number, run in enumerate(winding(study).each, start=1):
        ((stamp, plan),) = messages(folder / f"run{number}", PLAN)
        assert stamp == 0
        assert (plan.poses[0].pose.position.x, plan.poses[0].pose.position.y) == pytest.approx(run.start[:2])


@pytest.mark.slow
def test_old_releases_can_read_the_metadata(tmp_path: Path):
    bag = export(saved(tmp_path, study_of()), "rosbag2")
    data = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    # From version 9 on the quality of service is no text any more, which Humble cannot read.
    assert data["version"] == 8
    assert data["relative_file_paths"] == ["my_drive_bag.db3"]


class TestPlace:
    @pytest.mark.slow
    def test_a_bag_is_not_written_over(self, tmp_path: Path):
        folder = saved(tmp_path, study_of())
        bag = export(folder, "rosbag2")
        before = (bag / "metadata.yaml").read_text()
        with pytest.raises(UserMistake, match="my_drive_bag exists; give another place, or force"):
            export(folder, "rosbag2", rate=8.0)
        assert (bag / "metadata.yaml").read_text() == before

    @pytest.mark.parametrize("runs", [1, 2])
    @pytest.mark.slow
    def test_unless_it_is_forced(self, tmp_path: Path, runs: int):
        folder = saved(tmp_path, study_of(runs=runs))
        export(folder, "rosbag2")
        bag = export(folder, "rosbag2", rate=8.0, force=True, storage="mcap")
        assert len(list(messages(bag if runs == 1 else bag / "run2", COMMAND))) == 17
        assert sorted(file.name for file in folder.iterdir()) == ["my_drive_bag", "record.json"]

    def test_what_is_no_bag_is_never_replaced(self, tmp_path: Path):
        folder = saved(tmp_path / "record", study_of())
        (tmp_path / "mine").mkdir()
        (tmp_path / "mine" / "letter.txt").write_text("dear")
        with pytest.raises(UserMistake, match="is no bag; it is left as it is"):
            export(folder, "rosbag2", out=tmp_path / "mine", force=True)
        assert (tmp_path / "mine" / "letter.txt").read_text() == "dear"

    def test_half_a_bag_is_never_seen(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        folder = saved(tmp_path, study_of())

        def interrupted(*_: Any) -> Iterator[Any]:
            raise KeyboardInterrupt
            yield

        monkeypatch.setattr(module, "_timeline", interrupted)
        with pytest.raises(KeyboardInterrupt):
            export(folder, "rosbag2")
        assert [file.name for file in folder.iterdir()] == ["record.json"]

    @pytest.mark.slow
    def test_a_full_disk_is_said(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        folder = saved(tmp_path, study_of())
        export(folder, "rosbag2")

        def full(*_: Any) -> Iterator[Any]:
            raise OSError(28, "No space left on device")
            yield

        monkeypatch.setattr(module, "_timeline", full)
        with pytest.raises(UserMistake, match="my_drive_bag: cannot be written: No space left on device"):
            export(folder, "rosbag2", force=True)
        # The one that was there is there still.
        assert len(list(messages(folder / "my_drive_bag", COMMAND))) == 9

    def test_unknown_storage(self, tmp_path: Path):
        with pytest.raises(UserMistake, match="storage: expected one of sqlite3, mcap, got 'zip'"):
            export(saved(tmp_path, study_of()), "rosbag2", storage="zip")

    def test_without_the_library(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
        with pytest.raises(UserMistake, match=r"writing ROS 2 bags needs an extra .* 'oed\[ros\]'"):
            export(saved(tmp_path, study_of()), "rosbag2")
