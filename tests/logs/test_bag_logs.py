"""ROS bags, written here and read back: joints and poses of every type, and what can be wrong with them."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import ODOMETRY, START, STORES, TYPES, Message, header, quaternion, write_bag, write_bag_1
from logged import INPUTS, ROBOT, doubtful, drive, found, issues_of, read_one
from rosbags.rosbag2 import StoragePlugin

from oed.foundation.errors import LogError, ProblemError
from oed.logs import BagForm, read_logs
from oed.robots.models import Tricycle

TABLE = drive(60)
ANGLES = np.vstack([np.zeros(2), np.cumsum(TABLE[:-1, 1:3] * np.diff(TABLE[:, 0])[:, None], axis=0)])
JOINTS = ("base_wheel_right_joint", "base_wheel_left_joint")


def joints(
    times: Iterable[float], angles: Any = (), speeds: Any = (), names=JOINTS, types: Any = TYPES
) -> list[Message]:
    make = types["sensor_msgs/msg/JointState"]
    messages = []
    for row, time in enumerate(times):
        position = np.array(angles[row] if len(angles) else [], dtype=float)
        velocity = np.array(speeds[row] if len(speeds) else [], dtype=float)
        head = header(START + time, types=types)
        state = make(header=head, name=list(names), position=position, velocity=velocity, effort=np.array([]))
        messages.append(("/joint_states", START + time + 0.001, state))
    return messages


def pose_of(row: np.ndarray, types: Any = TYPES) -> Any:
    point = types["geometry_msgs/msg/Point"](x=row[3], y=row[4], z=0.2)
    return types["geometry_msgs/msg/Pose"](position=point, orientation=quaternion(row[5], types))


def poses(
    kind: str, topic: str = "/pose", types: Any = TYPES, frames=("odom", "base_link"), table=TABLE
) -> list[Message]:
    make = types[kind]
    return [(topic, START + row[0] + 0.002, _pose_message(make, kind, row, frames, types)) for row in table]


def _pose_message(make: Any, kind: str, row: np.ndarray, frames: tuple[str, str], types: Any) -> Any:
    head = header(START + row[0], frames[0], types)
    if kind.endswith("TFMessage"):
        one = "geometry_msgs/msg/TransformStamped"
        return make(transforms=[_pose_message(types[one], one, row, frames, types)])
    if kind.endswith("TransformStamped"):
        vector = types["geometry_msgs/msg/Vector3"](x=row[3], y=row[4], z=0.0)
        moved = types["geometry_msgs/msg/Transform"](translation=vector, rotation=quaternion(row[5], types))
        return make(header=head, child_frame_id=frames[1], transform=moved)
    if kind.endswith("PoseStamped"):
        return make(header=head, pose=pose_of(row, types))
    covariance = types["geometry_msgs/msg/PoseWithCovariance"](
        pose=pose_of(row, types), covariance=np.zeros(36)
    )
    if kind.endswith("PoseWithCovarianceStamped"):
        return make(header=head, pose=covariance)
    zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    twist = types["geometry_msgs/msg/TwistWithCovariance"](
        twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=np.zeros(36)
    )
    return make(header=head, child_frame_id=frames[1], pose=covariance, twist=twist)


def read(path: Path, **keys: Any):
    return read_one(path, **{"kind": "rosbag", **keys})


def require_alike(log, angle=1e-9):
    np.testing.assert_allclose(log.input_times - START, TABLE[:, 0], atol=1e-6)
    np.testing.assert_allclose(log.integrals, ANGLES, atol=angle)
    np.testing.assert_allclose(log.pose_times - START, TABLE[:, 0], atol=1e-6)
    np.testing.assert_allclose(log.poses, TABLE[:, 3:], atol=1e-9)


@pytest.fixture
def wheels() -> list[Message]:
    return joints(TABLE[:, 0], ANGLES + 5, TABLE[:, 1:3])


class TestRoundTrip:
    @pytest.mark.parametrize("plugin", list(StoragePlugin))
    @pytest.mark.slow
    def test_either_storage(self, tmp_path: Path, wheels: list[Message], plugin: StoragePlugin):
        path = write_bag(tmp_path / "drive", [*wheels, *poses(ODOMETRY)], plugin)
        log = read(path)
        require_alike(log)
        assert (log.name, log.findings) == ("drive", ())
        (storage,) = [file for file in path.iterdir() if file.suffix in (".mcap", ".db3")]
        require_alike(read(storage))

    @pytest.mark.slow
    def test_ros_1(self, tmp_path: Path):
        store = STORES["ros1"]
        messages = [*joints(TABLE[:, 0], ANGLES, types=store.types), *poses(ODOMETRY, types=store.types)]
        write_bag_1(tmp_path / "drive.bag", messages)
        require_alike(read(tmp_path / "drive.bag"))

    @pytest.mark.parametrize(
        "kind",
        [
            "geometry_msgs/msg/PoseStamped",
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            "geometry_msgs/msg/TransformStamped",
            "tf2_msgs/msg/TFMessage",
        ],
    )
    @pytest.mark.slow
    def test_every_type_of_pose(self, tmp_path: Path, wheels: list[Message], kind: str):
        require_alike(read(write_bag(tmp_path / "drive", [*wheels, *poses(kind)])))

    def test_times_of_recording(self, tmp_path: Path, wheels: list[Message]):
        log = read(write_bag(tmp_path / "drive", [*wheels, *poses(ODOMETRY)]), clock="received")
        np.testing.assert_allclose(log.input_times - START, TABLE[:, 0] + 0.001, atol=1e-6)
        np.testing.assert_allclose(log.pose_times - START, TABLE[:, 0] + 0.002, atol=1e-6)

    @pytest.mark.slow
    def test_speeds(self, tmp_path: Path):
        path = write_bag(tmp_path / "drive", [*joints(TABLE[:, 0], (), TABLE[:, 1:3]), *poses(ODOMETRY)])
        keys = {name: {"held": "next"} for name in INPUTS}
        # Times since 1970 are good to a fraction of a microsecond.
        require_alike(read(path, inputs=keys), angle=1e-5)

    @pytest.mark.slow
    def test_speeds_though_there_are_angles(self, tmp_path: Path, wheels: list[Message]):
        path = write_bag(tmp_path / "drive", [*wheels, *poses(ODOMETRY)])
        keys = {name: {"joint": joint, "form": "speed"} for name, joint in zip(INPUTS, JOINTS, strict=True)}
        means = (TABLE[:-1, 1:3] + TABLE[1:, 1:3]) / 2
        np.testing.assert_allclose(
            read(path, inputs=keys).inputs_between(START + TABLE[:, 0]), means, atol=1e-5
        )

    def test_joints_in_messages_of_their_own(self, tmp_path: Path):
        right = joints(TABLE[::2, 0], ANGLES[::2, :1], names=JOINTS[:1])
        left = joints(TABLE[1::2, 0], ANGLES[1::2, 1:], names=JOINTS[1:])
        log = read(write_bag(tmp_path / "drive", [*right, *left, *poses(ODOMETRY)]))
        np.testing.assert_allclose(log.integrals[1::2, 0], ANGLES[2:-1:2, 0] - log_start(right), atol=2e-2)
        assert log.input_times[0] - START == pytest.approx(TABLE[1, 0], abs=1e-6)

    def test_a_joint_by_name_and_the_other_way_round(self, tmp_path: Path):
        messages = joints(TABLE[:, 0], ANGLES * [1, -1], names=("a", "b"))
        path = write_bag(tmp_path / "drive", [*messages, *poses(ODOMETRY)])
        require_alike(read(path, inputs={INPUTS[0]: "a", INPUTS[1]: {"joint": "b", "sign": -1}}))

    def test_a_steering_angle(self, tmp_path: Path):
        angles = np.column_stack([ANGLES[:, 0], 0.1 * TABLE[:, 0]])
        path = write_bag(
            tmp_path / "drive",
            [*joints(TABLE[:, 0], angles, names=("drive", "steering_joint")), *poses(ODOMETRY)],
        )
        robot = Tricycle(wheel_radius=0.05, wheelbase=0.2)
        log = read_one(path, robot, kind="rosbag", inputs={"wheel_speed": "drive"})
        np.testing.assert_allclose(log.integrals[:, 0], ANGLES[:, 0], atol=1e-9)
        np.testing.assert_allclose(log.integrals[:, 1], 0.05 * TABLE[:, 0] ** 2, atol=1e-5)

    def test_angles_that_begin_anew(self, tmp_path: Path):
        wrapped = np.mod(ANGLES + np.pi, 2 * np.pi) - np.pi
        path = write_bag(tmp_path / "drive", [*joints(TABLE[:, 0], wrapped), *poses(ODOMETRY)])
        keys = {name: {"wrap": 2 * np.pi} for name in INPUTS}
        log = read(path, inputs=keys)
        require_alike(log)
        assert "counter_wrapped" in found(log)
        assert "say `wrap: 6.28319`" in issues_of(path, kind="rosbag")[0].message

    @pytest.mark.slow
    def test_one_of_several_transforms(self, tmp_path: Path, wheels: list[Message]):
        kind = "tf2_msgs/msg/TFMessage"
        both = [*poses(kind, "/tf"), *poses(kind, "/tf", frames=("map", "odom"))]
        path = write_bag(tmp_path / "drive", [*wheels, *both])
        require_alike(read(path, poses={"frame": "odom", "child": "base_link"}))
        (issue,) = issues_of(path, kind="rosbag")
        told = "map -> odom, odom -> base_link"
        assert issue.message == f"/tf has several transforms; give `frame` and `child`: {told}"
        (issue,) = issues_of(path, kind="rosbag", poses={"frame": "world"})
        assert issue.message == f"no poses in /tf of the frame world; it has {told}"
        (issue,) = issues_of(path, kind="rosbag", poses={"child": "/base_link"})
        assert (
            issue.message == f"no poses in /tf of the child /base_link; did you mean base_link? it has {told}"
        )
        assert issue.named == ("log", "poses", "child")
        (issue,) = issues_of(path, kind="rosbag", poses={"frame": "map", "child": "base_link"})
        assert issue.message == f"no poses in /tf; it has {told}"

    @pytest.mark.slow
    def test_messages_without_numbers_are_skipped_on_request(self, tmp_path: Path, wheels: list[Message]):
        odometry = poses(ODOMETRY)
        wheels[7][2].position[0] = wheels[7][2].position[1] = wheels[9][2].position[1] = np.nan
        odometry[20][2].pose.pose.position.x = np.inf
        odometry[30][2].pose.pose.orientation.w = np.nan
        path = write_bag(tmp_path / "drive", [*wheels, *odometry])
        assert len(issues_of(path, kind="rosbag")) == 4
        log = read(path, skip_invalid_rows=True)
        np.testing.assert_allclose(log.poses, np.delete(TABLE, [20, 30], axis=0)[:, 3:], atol=1e-9)
        np.testing.assert_allclose(log.integrals[7], ANGLES[8], atol=1e-9)
        said = [one.message for one in log.findings if one.name.startswith("skipped_")]
        assert [text.partition(", as")[0] for text in said] == [
            "the inputs of 2 of 60 messages of drive are skipped",
            "the poses of 2 of 60 messages of drive are skipped",
        ]
        assert [text.rpartition(" ")[2] for text in said] == ["8)", "21)"]

    @pytest.mark.slow
    def test_what_a_joint_has_not_is_no_reading(self, tmp_path: Path):
        """Drivers fill in nan for speeds that nobody measures, and for joints that are no wheels."""
        gripper = np.full(len(TABLE), np.nan)
        messages = joints(
            TABLE[:, 0],
            np.column_stack([ANGLES, gripper]),
            np.full((len(TABLE), 3), np.nan),
            names=(*JOINTS, "gripper"),
        )
        path = write_bag(tmp_path / "drive", [*messages, *poses(ODOMETRY)])
        require_alike(read(path))
        (issue, _) = issues_of(path, kind="rosbag", inputs={name: {"form": "speed"} for name in INPUTS})
        assert issue.message == f"the joint {JOINTS[0]} has no speeds in the bag"

    def test_a_gap(self, tmp_path: Path, wheels: list[Message]):
        gapped = [*wheels[:20], *wheels[40:], *poses(ODOMETRY)]
        log = read(write_bag(tmp_path / "drive", gapped))
        assert "gap in the inputs; the longest is 1.05 s" in found(log)["gap"]
        assert "(message 20)" in found(log)["gap"]
        assert not doubtful(log)

    def test_a_tracker_that_lost_the_robot(self, tmp_path: Path, wheels: list[Message]):
        # Stamped anew, the same pose comes for a second.
        frozen = TABLE.copy()
        frozen[20:40, 3:] = frozen[20, 3:]
        log = read(write_bag(tmp_path / "drive", [*wheels, *poses(ODOMETRY, table=frozen)]))
        assert found(log)["tracker_lost"].startswith("19 of 60 poses repeat the one before")
        assert "the longest for 0.95 s from t = " in found(log)["tracker_lost"]
        assert len(log.poses) == 41
        assert not doubtful(log)


def log_start(right: list[Message]) -> float:
    """The right wheel's angle at the first time that both were logged, half way between two messages."""
    return float(right[0][2].position[0] + right[1][2].position[0]) / 2


class TestIssues:
    def issue(self, path: Path, **keys: Any) -> tuple[str, str]:
        (issue,) = issues_of(path, **{"kind": "rosbag", **keys})
        assert issue.file == str(path)
        return issue.key, issue.message

    def test_missing(self, tmp_path: Path):
        assert self.issue(tmp_path / "drive.mcap") == ("", "no such file")

    def test_no_bag(self, tmp_path: Path):
        (tmp_path / "a.csv").write_text("t\n")
        expected = "is no ROS bag: expected a folder with metadata.yaml, or a file .mcap, .db3 or .bag"
        assert self.issue(tmp_path / "a.csv") == ("", expected)

    @pytest.mark.parametrize("name", ["a.mcap", "a.db3", "a.bag"])
    def test_broken(self, tmp_path: Path, name: str):
        (tmp_path / name).write_bytes(b"nonsense" * 100)
        assert self.issue(tmp_path / name)[1].startswith("cannot be read as a ROS bag: ")

    @pytest.mark.skipif(os.name != "posix", reason="there are no pipes with names elsewhere")
    def test_a_pipe(self, tmp_path: Path, wheels: list[Message]):
        expected = "cannot be read as a ROS bag: expected a file, got a pipe"
        os.mkfifo(tmp_path / "a.mcap")
        assert self.issue(tmp_path / "a.mcap")[1] == expected
        bag = write_bag(tmp_path / "drive", wheels, StoragePlugin.SQLITE3)
        (database,) = bag.glob("*.db3")
        database.unlink()
        os.mkfifo(database)
        (issue,) = issues_of(bag, kind="rosbag")
        assert (issue.file, issue.message) == (str(database), expected)

    @pytest.mark.slow
    def test_no_topics_and_several(self, tmp_path: Path, wheels: list[Message]):
        both = [*poses(ODOMETRY, "/odom"), *poses("geometry_msgs/msg/PoseStamped", "/mocap")]
        path = write_bag(tmp_path / "drive", [*wheels, *both])
        key, message = self.issue(path)
        assert key == "poses"
        assert message.startswith("expected one topic to choose from; of type Odometry or PoseStamped or ")
        assert message.partition("it has ")[2].split(", ") == ["/mocap", "/odom"]
        only = write_bag(tmp_path / "only", both[:60])
        issues = issues_of(only, kind="rosbag")
        assert [issue.message for issue in issues] == [
            "expected one topic to choose from; of type JointState it has none"
        ]

    def test_topics_that_are_not_there_or_of_another_type(self, tmp_path: Path, wheels: list[Message]):
        path = write_bag(tmp_path / "drive", [*wheels, *poses(ODOMETRY)])
        keys = {"joint_states": "/pose", "poses": "/mocap"}
        messages = [issue.message for issue in issues_of(path, kind="rosbag", **keys)]
        assert (
            messages[0] == "/pose is of type nav_msgs/msg/Odometry; of type JointState it has /joint_states"
        )
        assert messages[1].startswith("the bag has no topic /mocap; of type Odometry or")
        (issue,) = issues_of(path, kind="rosbag", poses="/robot/pose")
        assert issue.message.startswith(
            "the bag has no topic /robot/pose; did you mean /pose? of type Odometry"
        )
        assert issue.named == ("log", "poses", "topic")

    @pytest.mark.slow
    def test_joints_that_are_not_clear(self, tmp_path: Path):
        messages = joints(TABLE[:, 0], ANGLES, names=("a", "right_b"))
        path = write_bag(tmp_path / "drive", [*messages, *poses(ODOMETRY)])
        expected = (INPUTS[1], "it is not clear which joint this is; the bag has a, right_b")
        assert self.issue(path) == expected
        assert self.issue(path, inputs={INPUTS[1]: "c"})[1] == "no joint c; the bag has a, right_b"
        said = self.issue(path, inputs={INPUTS[1]: "right"})[1]
        assert said == "no joint right; did you mean right_b? the bag has a, right_b"

    @pytest.mark.parametrize(("form", "what"), [("angle", "positions"), ("speed", "speeds")])
    @pytest.mark.slow
    def test_joints_without_what_is_wanted(self, tmp_path: Path, form: str, what: str):
        data = ((), TABLE[:, 1:3]) if form == "angle" else (ANGLES, ())
        path = write_bag(tmp_path / "drive", [*joints(TABLE[:, 0], *data), *poses(ODOMETRY)])
        keys = {name: {"form": form} for name in INPUTS}
        messages = [issue.message for issue in issues_of(path, kind="rosbag", inputs=keys)]
        assert messages == [f"the joint {joint} has no {what} in the bag" for joint in JOINTS]

    @pytest.mark.slow
    def test_stamps_of_zero(self, tmp_path: Path, wheels: list[Message]):
        for _, _, message in wheels:
            message.header.stamp.sec = message.header.stamp.nanosec = 0
        path = write_bag(tmp_path / "drive", [*wheels, *poses(ODOMETRY)])
        expected = "the stamps of the messages are all zero; say `clock: received`"
        assert self.issue(path) == ("/joint_states", expected)
        assert len(read(path, clock="received").input_times) == len(TABLE)

    def test_stamps_that_go_back(self, tmp_path: Path, wheels: list[Message]):
        wheels[9][2].header.stamp.sec -= 5
        path = write_bag(tmp_path / "drive", [*wheels, *poses(ODOMETRY)])
        key, message = self.issue(path)
        assert key == "/joint_states"
        assert message.startswith("message 10: time goes back: 1699999995")
        assert message.endswith(" (message 9)")

    def test_no_quaternions(self, tmp_path: Path, wheels: list[Message]):
        odometry = poses(ODOMETRY)
        odometry[4][2].pose.pose.orientation.w = odometry[4][2].pose.pose.orientation.z = 0.0
        path = write_bag(tmp_path / "drive", [*wheels, *odometry])
        assert self.issue(path) == ("/pose", "message 5: expected a unit quaternion")

    def test_numbers_that_are_none(self, tmp_path: Path, wheels: list[Message]):
        wheels[7][2].position[0] = np.nan
        path = write_bag(tmp_path / "drive", [*wheels, *poses(ODOMETRY)])
        assert self.issue(path) == ("/joint_states", "message 8: expected a finite number, got 'nan'")

    def test_an_input_the_robot_does_not_have(self, tmp_path: Path):
        form = BagForm(inputs={"wheel": {"joint": "a"}})
        with pytest.raises(ProblemError, match="the robot has no input wheel; it has wheel_speed_right"):
            read_logs([tmp_path], form, ROBOT)


def test_a_message_that_cannot_be_decoded(tmp_path: Path):
    messages = [*joints(TABLE[:, 0], ANGLES), *poses("geometry_msgs/msg/PoseStamped")]
    path = write_bag(tmp_path / "drive", messages, StoragePlugin.SQLITE3)
    (storage,) = path.glob("*.db3")
    with sqlite3.connect(storage) as database:
        own = "SELECT id FROM messages WHERE topic_id = (SELECT id FROM topics WHERE name = '/pose')"
        fifth = f"{own} ORDER BY timestamp LIMIT 1 OFFSET 4"
        database.execute(f"UPDATE messages SET data = x'00010000' WHERE id = ({fifth})")
    database.close()
    with pytest.raises(
        LogError, match="drive: /pose: message 5: cannot be decoded as geometry_msgs/msg/Pose"
    ):
        read(path)
