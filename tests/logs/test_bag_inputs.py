"""Inputs of a bag that are no joints', poses by their fields; and what can be wrong with them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import (
    ODOMETRY,
    OWN,
    START,
    STORES,
    TYPES,
    Message,
    header,
    odometry_message,
    pose,
    quaternion,
    twist_message,
    vector,
    write_bag,
    write_bag_1,
)
from logged import ROBOT, drive, found, issues_of, read_one
from pydantic import ValidationError

from oed.foundation.errors import ProblemError
from oed.logs import BagForm, read_logs
from oed.robots.models import Ackermann, DifferentialDrive, Model, Tricycle, Unicycle
from oed.robots.sensors import Poses

TABLE = drive(60)
TIMES = TABLE[:, 0]
V, OMEGA = 0.3 + 0.2 * np.sin(TIMES), 0.8 * np.cos(0.9 * TIMES)
HELD = np.column_stack([V[:-1], OMEGA[:-1]])
BETWEEN = (np.column_stack([V, OMEGA])[1:] + np.column_stack([V, OMEGA])[:-1]) / 2
TWISTS = ("Twist", "TwistStamped", "TwistWithCovarianceStamped")
UNICYCLE = Unicycle()
CAR = Ackermann(wheel_radius=0.1, wheelbase=0.5)


def reference(topic: str = "/mocap", types: Any = TYPES) -> list[Message]:
    make = types["geometry_msgs/msg/PoseStamped"]
    return [
        (topic, START + time + 0.002, make(header=header(START + time, "map", types), pose=pose(row, types)))
        for time, row in zip(TIMES, TABLE[:, 3:], strict=True)
    ]


def commanded(kind: str = TWISTS[1], topic: str = "/cmd_vel", types: Any = TYPES) -> list[Message]:
    name = f"geometry_msgs/msg/{kind}"
    return [
        (topic, START + time + 0.001, twist_message(name, START + time, v, omega, types))
        for time, v, omega in zip(TIMES, V, OMEGA, strict=True)
    ]


def odometry(topic: str = "/odom", types: Any = TYPES) -> list[Message]:
    rows = zip(TIMES, TABLE[:, 3:], V, OMEGA, strict=True)
    return [
        (topic, START + time, odometry_message(START + time, row, (v, omega), types=types))
        for time, row, v, omega in rows
    ]


def cars(stamped: bool = True) -> list[Message]:
    make = TYPES["ackermann_msgs/msg/AckermannDrive"]
    messages = []
    for time, v, omega in zip(TIMES, V, OMEGA, strict=True):
        rest = dict.fromkeys(("steering_angle_velocity", "acceleration", "jerk"), 0.0)
        own = make(steering_angle=0.3 * omega, speed=v, **rest)
        if stamped:
            own = TYPES["ackermann_msgs/msg/AckermannDriveStamped"](header=header(START + time), drive=own)
        messages.append(("/drive", START + time + 0.001, own))
    return messages


def own_messages() -> list[Message]:
    """A message that only its makers know: wheels' speeds in rpm, ticks, and much that is no number."""
    wheel, messages = TYPES["own_msgs/msg/Wheel"], []
    for time, right, left in TABLE[:, :3]:
        wheels = [wheel(velocity=one * 30 / np.pi, count=7) for one in (left, right)]
        speeds = np.array([right, left])
        made = TYPES[OWN](
            header=header(START + time),
            left=wheels[0],
            wheels=wheels,
            speeds=speeds,
            ticks=int(1000 * time),
            moving=True,
            state="driving",
        )
        messages.append(("/wheels", START + time, made))
    return messages


def read(path: Path, model: Model = UNICYCLE, **keys: Any):
    return read_one(path, model, kind="rosbag", **keys)


def means(log) -> np.ndarray:
    return log.inputs_between(log.input_times)


class TestCommands:
    @pytest.mark.parametrize(
        "kind", [TWISTS[1], *(pytest.param(one, marks=pytest.mark.slow) for one in (TWISTS[0], TWISTS[2]))]
    )
    def test_a_twist_holds_until_the_next(self, tmp_path: Path, kind: str):
        log = read(write_bag(tmp_path / "drive", [*commanded(kind), *reference()]))
        np.testing.assert_allclose(means(log), HELD, atol=1e-5)
        # What has no header was received when it was.
        late = 0.001 if kind == "Twist" else 0.0
        np.testing.assert_allclose(log.input_times - START, TIMES + late, atol=1e-6)
        np.testing.assert_allclose(log.pose_times - START, TIMES, atol=1e-6)

    @pytest.mark.slow
    def test_ros_1(self, tmp_path: Path):
        types = STORES["ros1"].types
        messages = [*commanded("Twist", types=types), *reference(types=types)]
        log = read(write_bag_1(tmp_path / "drive.bag", messages))
        np.testing.assert_allclose(means(log), HELD, atol=1e-5)

    @pytest.mark.slow
    def test_what_odometry_measured_runs_between(self, tmp_path: Path):
        path = write_bag(tmp_path / "drive", [*odometry(), *reference()])
        np.testing.assert_allclose(means(read(path, commands="/odom")), BETWEEN, atol=1e-5)
        # No other topic has a twist, and another one is said to be the reference.
        np.testing.assert_allclose(means(read(path, poses="/mocap")), BETWEEN, atol=1e-5)

    @pytest.mark.slow
    def test_commands_come_before_odometry_and_odometry_is_a_reference(self, tmp_path: Path):
        log = read(write_bag(tmp_path / "drive", [*commanded(), *odometry()]))
        np.testing.assert_allclose(means(log), HELD, atol=1e-5)
        assert log.quantities == ("x", "y", "heading")

    @pytest.mark.slow
    @pytest.mark.parametrize("stamped", [True, False])
    def test_a_car(self, tmp_path: Path, stamped: bool):
        log = read(write_bag(tmp_path / "drive", [*cars(stamped), *reference()]), CAR)
        np.testing.assert_allclose(means(log), HELD * [1 / 0.1, 0.3], atol=1e-4)
        assert "wheel_speed by 100 mm" in found(log)["rim_speeds"]

    @pytest.mark.slow
    def test_a_tricycle_drives_in_front(self, tmp_path: Path):
        tricycle = Tricycle(wheel_radius=0.1, wheelbase=0.5)
        path = write_bag(tmp_path / "drive", [*cars(), *reference()])
        keys = {
            "wheel_speed": {"topic": "/drive", "field": "drive.speed", "unit": "m/s"},
            "steering_angle": {"topic": "/drive", "field": "drive.steering_angle"},
        }
        np.testing.assert_allclose(means(read(path, tricycle, inputs=keys)), BETWEEN * [10, 0.3], atol=1e-4)
        (issue,) = BagForm(commands="/drive").issues(tricycle)
        assert issue.message.startswith("no message has wheel_speed, steering_angle as commands; ")

    @pytest.mark.slow
    def test_odometry_as_poses(self, tmp_path: Path):
        log = read(
            write_bag(tmp_path / "drive", [*odometry(), *reference()]),
            inputs={"form": "poses", "topic": "/odom"},
        )
        moved, turned = log.integrals[-1] - log.integrals[0]
        assert turned == pytest.approx(TABLE[-1, 5] - TABLE[0, 5], abs=1e-6)
        chords = np.hypot(*np.diff(TABLE[:, 3:5], axis=0).T)
        arcs = chords / np.sinc(np.diff(TABLE[:, 5]) / (2 * np.pi))
        assert moved == pytest.approx(arcs.sum(), rel=1e-9)

    @pytest.mark.slow
    def test_transforms_of_one_topic_are_odometry_and_reference(self, tmp_path: Path):
        one, many = TYPES["geometry_msgs/msg/TransformStamped"], TYPES["tf2_msgs/msg/TFMessage"]
        move, messages = TYPES["geometry_msgs/msg/Transform"], []
        for time, x, y, heading in TABLE[:, [0, 3, 4, 5]]:
            for frame, shift in (("odom", 0.0), ("map", 5.0)):
                moved = move(translation=vector(x + shift, y), rotation=quaternion(heading))
                made = one(header=header(START + time, frame), child_frame_id="base_link", transform=moved)
                messages.append(("/tf", START + time, many(transforms=[made])))
        path = write_bag(tmp_path / "drive", messages)
        odom, world = ({"frame": frame, "child": "base_link"} for frame in ("odom", "map"))
        inputs = {"form": "poses", "topic": "/tf", **odom}
        log = read(path, inputs=inputs, poses={"topic": "/tf", **world})
        np.testing.assert_allclose(log.poses, TABLE[:, 3:] + [5, 0, 0], atol=1e-9)
        assert log.integrals[-1, 1] == pytest.approx(TABLE[-1, 5] - TABLE[0, 5], abs=1e-6)
        (issue,) = issues_of(
            path, model=UNICYCLE, kind="rosbag", inputs=inputs, poses={"topic": "/tf", **odom}
        )
        assert (
            issue.message == "/tf is the robot's own odometry, which its inputs are; the reference is another"
        )


class TestFields:
    def path(self, tmp_path: Path) -> Path:
        return write_bag(tmp_path / "drive", [*own_messages(), *reference()])

    @pytest.mark.slow
    @pytest.mark.parametrize(
        "fields",
        [
            ("wheels[1].velocity", "left.velocity", {"unit": "rpm"}),
            ("speeds[0]", "speeds[1]", {}),
            ("speeds[0]", "wheels[0].velocity", {"unit": "rpm"}),
        ],
    )
    def test_of_any_message(self, tmp_path: Path, fields):
        right, left, unit = fields
        keys = {
            "wheel_speed_right": {"topic": "/wheels", "field": right, "held": "next"},
            "wheel_speed_left": {"topic": "/wheels", "field": left, "held": "next"},
        }
        for one in keys.values():
            one.update(unit if "velocity" in str(one["field"]) else {})
        log = read(self.path(tmp_path), ROBOT, inputs=keys)
        np.testing.assert_allclose(means(log), TABLE[:-1, 1:3], atol=1e-4)

    @pytest.mark.slow
    def test_ticks(self, tmp_path: Path):
        ticks = {
            "topic": "/wheels",
            "field": "ticks",
            "form": "ticks",
            "ticks_per_turn": 500,
            "cumulative": True,
        }
        left = {"topic": "/wheels", "field": "speeds[1]"}
        inputs = {"wheel_speed_right": ticks, "wheel_speed_left": left}
        log = read(self.path(tmp_path), ROBOT, inputs=inputs)
        expected = 2 * np.pi / 500 * (np.floor(1000 * TIMES) - np.floor(1000 * TIMES[0]))
        np.testing.assert_allclose(log.integrals[:, 0], expected, atol=2 * np.pi / 500)

    @pytest.mark.slow
    def test_poses(self, tmp_path: Path):
        keys = {"x": {"field": "pose.position.x", "unit": "cm"}, "y": "pose.position.y"}
        path = write_bag(tmp_path / "drive", [*commanded(), *reference()])
        log = read(path, poses={"topic": "/mocap", **keys, "heading": "pose.orientation"})
        np.testing.assert_allclose(log.poses, TABLE[:, 3:] * [0.01, 1, 1], atol=1e-9)
        only = read(path, poses={"topic": "/mocap", **keys})
        assert only.quantities == ("x", "y")

    @pytest.mark.slow
    def test_headings_of_messages_that_the_study_does_not_measure_are_left_out(self, tmp_path: Path):
        path = write_bag(tmp_path / "drive", [*commanded(), *reference()])
        measurement = Poses(quantities=("x", "y"), noise={"position": 0.01})
        (log,) = read_logs([path], BagForm.model_validate({"poses": "/mocap"}), UNICYCLE, measurement)
        assert log.quantities == ("x", "y")
        assert "not_measured" in [finding.name for finding in log.findings]

    @pytest.mark.slow
    def test_the_heading_of_an_imu(self, tmp_path: Path):
        make = TYPES["sensor_msgs/msg/Imu"]
        nothing = {
            name: np.zeros(9)
            for name in (
                "orientation_covariance",
                "angular_velocity_covariance",
                "linear_acceleration_covariance",
            )
        }
        zero = TYPES["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        imu = [
            (
                "/imu",
                START + time,
                make(
                    header=header(START + time),
                    orientation=quaternion(heading),
                    angular_velocity=zero,
                    linear_acceleration=zero,
                    **nothing,
                ),
            )
            for time, heading in TABLE[:, [0, 5]]
        ]
        log = read(write_bag(tmp_path / "drive", [*commanded(), *imu]), poses="/imu")
        assert log.quantities == ("heading",)
        np.testing.assert_allclose(log.poses[:, 0], TABLE[:, 5], atol=1e-9)

    @pytest.mark.slow
    def test_joints_in_ticks(self, tmp_path: Path):
        make, messages = TYPES["sensor_msgs/msg/JointState"], []
        steering = 0.4 * np.sin(TIMES)
        for time, angle in zip(TIMES, steering, strict=True):
            position = np.array(
                [round(200 * time), np.mod(round(angle / (2 * np.pi) * 8192) + 100, 8192)], float
            )
            none = np.array([])
            state = make(
                header=header(START + time),
                name=["wheel", "steering"],
                position=position,
                velocity=none,
                effort=none,
            )
            messages.append(("/joint_states", START + time, state))
        keys = {
            "wheel_speed": {"joint": "wheel", "form": "ticks", "ticks_per_turn": 500},
            "steering_angle": {
                "joint": "steering",
                "form": "ticks",
                "ticks_per_turn": 8192,
                "wrap": 8192,
                "zero": 100,
            },
        }
        tricycle = Tricycle(wheel_radius=0.1, wheelbase=0.5)
        keys["steering_angle"]["cumulative"] = True
        log = read(write_bag(tmp_path / "drive", [*messages, *reference()]), tricycle, inputs=keys)
        expected = (steering[1:] + steering[:-1]) / 2
        np.testing.assert_allclose(means(log)[:, 1], expected, atol=np.pi / 8192 + 1e-5)
        np.testing.assert_allclose(log.integrals[:, 0], 2 * np.pi / 500 * 200 * (TIMES - TIMES[0]), atol=0.01)


@pytest.fixture(scope="module")
def own_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("own") / "drive", [*own_messages()[:20], *reference()[:20]])


def wheel(**keys: Any) -> dict[str, Any]:
    """A study that reads a wheel by a field, and the other by one that is there."""
    other = {"topic": "/wheels", "field": "speeds[1]"}
    return {"inputs": {"wheel_speed_right": {"topic": "/wheels", **keys}, "wheel_speed_left": other}}


class TestIssues:
    """Each names the bag and the topic, the message and the field, and what there is instead."""

    @pytest.mark.parametrize(
        ("keys", "message"),
        [
            ({"field": "left.speed"}, "message 1: left has no field speed; it has velocity, count"),
            ({"field": "left.velocty"}, "no field velocty; did you mean velocity? it has velocity, count"),
            (
                {"field": "right.velocity"},
                "message 1: the message has no field right; it has header, left, wheels, ",
            ),
            ({"field": "speeds"}, "message 1: speeds is no number: it has 2 entries; say which, e.g. [0]"),
            ({"field": "speeds[2]"}, "message 1: speeds has 2 entries, from [0] on; there is no [2]"),
            ({"field": "ticks[0]"}, "message 1: ticks has no entries, of which [0] would be one, but int"),
            ({"field": "left"}, "message 1: left is no number: it has velocity, count"),
            ({"field": "state"}, "message 1: state is no number, but str"),
            ({"field": "moving"}, "message 1: moving is no number, but bool"),
            ({"field": "left.velocity.x"}, "message 1: left.velocity has no field x, but float"),
            ({}, "own_msgs/msg/Wheels has no wheel_speed_right by itself; say in which `field` it is"),
            (
                {"topic": "/wheel", "field": "x"},
                "the bag has no topic /wheel; did you mean /wheels? it has /mocap",
            ),
        ],
    )
    def test_fields(self, own_bag: Path, keys: dict, message: str):
        path = own_bag
        (issue,) = issues_of(path, kind="rosbag", **wheel(**keys))
        assert issue.file == str(path)
        assert message in issue.message
        assert issue.named[:3] == ("log", "inputs", "wheel_speed_right")

    @pytest.mark.slow
    def test_fields_of_poses(self, tmp_path: Path):
        path = write_bag(tmp_path / "drive", [*commanded(), *reference()])
        (issue,) = issues_of(
            path,
            model=UNICYCLE,
            kind="rosbag",
            poses={"topic": "/mocap", "x": "pose.position.x", "y": "pose.y"},
        )
        assert (issue.key, issue.named) == ("/mocap", ("log", "poses"))
        assert issue.message == "message 1: pose has no field y; it has position, orientation"

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("messages", "keys", "expected"),
        [
            (
                lambda: [*commanded(), *commanded(topic="/teleop"), *reference()],
                {},
                "expected one topic to choose from; of type Twist or TwistStamped or "
                "TwistWithCovarianceStamped it has /cmd_vel, /teleop",
            ),
            (
                lambda: [*odometry("/odom"), *odometry("/filtered"), *reference()],
                {"poses": "/mocap"},
                "it has /filtered, /odom",
            ),
            (lambda: [*reference()], {}, "it has none"),
            (
                lambda: [*commanded(), *reference()],
                {"commands": "/cmd"},
                "the bag has no topic /cmd; did you mean /cmd_vel? of type Twist or",
            ),
            (
                lambda: [*commanded(), *reference()],
                {"commands": "/mocap"},
                "/mocap is of type geometry_msgs/msg/PoseStamped; of type Twist or",
            ),
            (
                lambda: [*odometry(), *commanded(), *reference()],
                {"poses": "/odom", "inputs": {"form": "poses", "topic": "/odom"}},
                "/odom is the robot's own odometry, which its inputs are; the reference is another",
            ),
            (
                lambda: [*odometry(), *reference()],
                {"poses": "/odom", "commands": "/odom"},
                "/odom is the robot's own odometry, which its inputs are; the reference is another",
            ),
            (
                lambda: [*odometry(), *reference()],
                {"inputs": {"form": "poses", "topic": "/odometry"}},
                "the bag has no topic /odometry; did you mean /odom? of type Odometry or",
            ),
            (
                lambda: [*odometry(), *commanded()],
                {"poses": {"topic": "/odom", "frame": "map"}},
                "no poses in /odom of the frame map; it has odom -> base_link",
            ),
            (
                lambda: [*reference(), *commanded()],
                {"poses": {"frame": "world"}},
                "no poses in /mocap of the frame world; it has map",
            ),
        ],
    )
    def test_topics(self, tmp_path: Path, messages: Callable[[], list[Message]], keys: dict, expected: str):
        path = write_bag(tmp_path / "drive", messages())
        found = issues_of(path, model=UNICYCLE, kind="rosbag", **keys)
        assert all(issue.file == str(path) for issue in found)
        assert any(expected in issue.message for issue in found), found

    @pytest.mark.slow
    def test_topics_without_messages(self, tmp_path: Path):
        empty = [("/cmd_vel", "geometry_msgs/msg/Twist")]
        path = write_bag(tmp_path / "drive", reference(), empty=empty)
        issues = issues_of(path, model=UNICYCLE, kind="rosbag")
        assert {(issue.key, issue.message) for issue in issues} == {("/cmd_vel", "the topic has no messages")}

    def test_a_bag_without_anything(self, tmp_path: Path):
        path = write_bag(
            tmp_path / "drive", [], empty=[("/cmd_vel", "geometry_msgs/msg/Twist"), ("/odom", ODOMETRY)]
        )
        messages = {issue.message for issue in issues_of(path, model=UNICYCLE, kind="rosbag")}
        assert messages == {"the topic has no messages", "no poses in /odom"}

    @pytest.mark.slow
    def test_numbers_that_are_none(self, tmp_path: Path):
        messages = commanded()
        messages[8][2].twist.angular.z = np.nan
        path = write_bag(tmp_path / "drive", [*messages, *reference()])
        (issue,) = issues_of(path, model=UNICYCLE, kind="rosbag")
        assert (issue.key, issue.message) == ("/cmd_vel", "message 9: expected a finite number, got 'nan'")

    @pytest.mark.parametrize(
        ("model", "keys", "key", "message"),
        [
            (UNICYCLE, {"inputs": {"v": {"field": "a.b"}}}, "v.field", "give `topic`, too"),
            (
                UNICYCLE,
                {"inputs": {"v": {"joint": "a", "topic": "/b"}}},
                "v.joint",
                "`topic` is of other messages",
            ),
            (UNICYCLE, {"inputs": {"v": {"topic": "/b", "unit": "rad/s"}}}, "v.unit", "of another kind"),
            (
                UNICYCLE,
                {"inputs": {"speed": {"topic": "/b"}}},
                "speed",
                "the robot has no input speed; it has v, omega",
            ),
            (
                UNICYCLE,
                {"inputs": {"omega": {"topic": "/b", "form": "speed", "gear": 3}}},
                "omega.gear",
                "is a key of form: ticks, and the form is speed",
            ),
            (
                ROBOT,
                {"inputs": {"wheel_speed_left": {"joint": "a", "form": "ticks"}}},
                "wheel_speed_left.ticks_per_turn",
                "is missing",
            ),
            (
                ROBOT,
                {"inputs": {"wheel_speed_left": {"joint": "a", "form": "value"}}},
                "wheel_speed_left.form",
                "its form is speed, got 'value'",
            ),
            (
                ROBOT,
                {"inputs": {"form": "poses", "topic": "/odom"}},
                "inputs.form",
                "take `robot: {kind: unicycle}`",
            ),
            (
                ROBOT,
                {"commands": "/cmd_vel"},
                "commands",
                "no message has wheel_speed_right, wheel_speed_left",
            ),
            (UNICYCLE, {"poses": {"x": "a.x"}}, "poses", "x: fields of which topic's messages?"),
            (UNICYCLE, {"poses": {"topic": "/a", "x": "a.x", "frame": "map"}}, "poses", "choose among poses"),
            (
                UNICYCLE,
                {"poses": {"topic": "/a", "x": {"field": "a.x", "unit": "deg"}}},
                "x.unit",
                "of another kind",
            ),
        ],
    )
    def test_what_a_study_says(self, model: Model, keys: dict, key: str, message: str):
        with pytest.raises(ProblemError) as caught:
            read_logs(["nowhere"], BagForm(**keys), model)
        (issue,) = caught.value.issues
        assert ".".join(issue.key).endswith(key)
        assert message in issue.message

    @pytest.mark.slow
    def test_each_wheel_by_its_rim(self, tmp_path: Path):
        robot = DifferentialDrive(wheel_radius_right=0.05, wheel_radius_left=0.1, track=0.2)
        inputs = {
            f"wheel_speed_{side}": {
                "topic": "/wheels",
                "field": f"speeds[{at}]",
                "unit": "m/s",
                "held": "next",
            }
            for at, side in enumerate(("right", "left"))
        }
        path = write_bag(tmp_path / "drive", [*own_messages(), *reference()])
        log = read(path, robot, inputs=inputs)
        np.testing.assert_allclose(means(log), TABLE[:-1, 1:3] / [0.05, 0.1], atol=1e-3)
        assert "wheel_speed_left by 100 mm" in found(log)["rim_speeds"]

    @pytest.mark.parametrize("path", ["a..b", "a[x]", ".a", "a.", "a b", "", "[0]", "a[-1]"])
    def test_paths_that_are_none(self, path: str):
        with pytest.raises(ValidationError, match="expected the path of a field, such as"):
            BagForm.model_validate({"inputs": {"v": {"topic": "/a", "field": path}}})

    @pytest.mark.slow
    def test_a_joint_by_its_rim(self, tmp_path: Path):
        make, none, messages = TYPES["sensor_msgs/msg/JointState"], np.array([]), []
        for time, *speeds in TABLE[:, :3].tolist():
            state = make(
                header=header(START + time),
                name=["right", "left"],
                position=none,
                velocity=0.05 * np.array(speeds),
                effort=none,
            )
            messages.append(("/joint_states", START + time, state))
        rim = {"form": "speed", "unit": "m/s", "held": "next"}
        keys = {f"wheel_speed_{side}": {"joint": side, **rim} for side in ("right", "left")}
        log = read(write_bag(tmp_path / "drive", [*messages, *reference()]), ROBOT, inputs=keys)
        np.testing.assert_allclose(means(log), TABLE[:-1, 1:3], atol=1e-4)
