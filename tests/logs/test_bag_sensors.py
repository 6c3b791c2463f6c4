"""Sensors beside the poses in ROS bags, written here and read back, and what can be wrong with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from logged import ROBOT, form
from test_bag_logs import ANGLES, START, TABLE, TYPES, Message, header, joints, poses, quaternion, write_bag

from oed.foundation.errors import LogError, ProblemError
from oed.logs import BagForm, Log, read_logs
from oed.robots.sensors import Landmarks, Ranges, Several, YawRate

TIMES = TABLE[:, 0]
RATES = np.sin(TIMES)
SENSORS = Several(
    sensors=[
        YawRate(noise=0.01),
        Ranges(beacons=[(3.0, 0.0), (0.0, 3.0)], noise=0.02),
        Landmarks(landmarks=[(3.0, 0.0), (0.0, 3.0)], ids=(4, 9), noise={"range": 0.02, "bearing": 0.01}),
    ]
)


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return TYPES["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def imu() -> list[Message]:
    make, none = TYPES["sensor_msgs/msg/Imu"], np.zeros(9)
    return [
        (
            "/imu",
            START + time,
            make(header(START + time), quaternion(0.0), none, vector(z=rate), none, vector(), none),
        )
        for time, rate in zip(TIMES, RATES, strict=True)
    ]


def beacon(topic: str, size: float, late: float) -> list[Message]:
    make = TYPES["sensor_msgs/msg/Range"]
    return [
        (topic, START + time + late, make(header(START + time + late), 0, 0.1, 0.0, 9.0, size + time))
        for time in TIMES[:40]
    ]


def markers(seen: list[tuple[float, list[tuple[int, float, float]]]]) -> list[Message]:
    # A list of things with ids: x stands for the range, y for the bearing.
    many = TYPES["geometry_msgs/msg/PoseArray"]
    point, pose = TYPES["geometry_msgs/msg/Point"], TYPES["geometry_msgs/msg/Pose"]
    messages = list[Message]()
    for time, things in seen:
        each = [pose(point(x=size, y=angle, z=float(own)), quaternion(0.0)) for own, size, angle in things]
        messages.append(("/seen", START + time, many(header(START + time), each)))
    return messages


SEEN = [(0.5, [(4, 2.0, 0.5), (9, 1.0, -0.2)]), (1.0, [(9, 1.5, 0.1)])]
POINTS = {
    "topic": "/seen",
    "each": "poses",
    "id": "position.z",
    "range": "position.x",
    "bearing": "position.y",
}


def bag(folder: Path, *more: list[Message], with_poses: bool = True) -> Path:
    given = [*joints(TIMES, ANGLES), *(poses("geometry_msgs/msg/PoseStamped") if with_poses else [])]
    every = sorted([*given, *(one for messages in more for one in messages)], key=lambda one: one[1])
    return write_bag(folder / "drive", every)


def read(path: Path, sensors: dict[str, Any], **keys: Any) -> Log:
    (log,) = read_logs([path], form(kind="rosbag", sensors=sensors, **keys), ROBOT, SENSORS)
    return log


@pytest.mark.slow
def test_an_imu_is_found_by_itself(tmp_path: Path):
    (gyro,) = read(bag(tmp_path, imu()), {"yaw_rate": {}}).sensors
    assert (gyro.sensor, gyro.clock) == ("yaw_rate", "inputs")
    np.testing.assert_allclose(gyro.times, START + TIMES, atol=1e-6)
    np.testing.assert_allclose(gyro.values[:, 0], RATES)


@pytest.mark.slow
def test_any_field_of_a_topic(tmp_path: Path):
    sensors = {"yaw_rate": {"topic": "/imu", "field": "angular_velocity.z", "unit": "deg/s"}}
    np.testing.assert_allclose(read(bag(tmp_path, imu()), sensors).sensors[0].values[:, 0], np.radians(RATES))


@pytest.mark.slow
def test_a_topic_for_each_beacon_and_no_poses(tmp_path: Path):
    path = bag(tmp_path, beacon("/a", 1.0, 0.0), beacon("/b", 2.0, 0.01), with_poses=False)
    log = read(path, {"ranges": {"topics": ["/a", "/b"]}}, poses="none")
    (ranges,) = log.sensors
    assert log.quantities == ()
    assert len(log.pose_times) == 80
    first, second = (np.isfinite(column) for column in ranges.values.T)
    np.testing.assert_allclose(ranges.values[first, 0], 1.0 + TIMES[:40], rtol=1e-6)
    np.testing.assert_allclose(ranges.values[second, 1], 2.0 + TIMES[:40], rtol=1e-6)
    np.testing.assert_allclose(ranges.times[second], START + TIMES[:40] + 0.01, atol=1e-6)


@pytest.mark.slow
def test_a_list_of_landmarks_in_a_message(tmp_path: Path):
    (seen,) = read(bag(tmp_path, markers(SEEN)), {"landmarks": POINTS}).sensors
    np.testing.assert_allclose(seen.values, [[2.0, 0.5, 1.0, -0.2], [np.nan, np.nan, 1.5, 0.1]])


@pytest.mark.slow
def test_a_unit_of_one_field_alone(tmp_path: Path):
    turned = POINTS | {"bearing": {"field": "position.y", "unit": "deg"}}
    (seen,) = read(bag(tmp_path, markers(SEEN)), {"landmarks": turned}).sensors
    np.testing.assert_allclose(seen.values[0], [2.0, np.radians(0.5), 1.0, np.radians(-0.2)])


@pytest.mark.slow
def test_a_topic_without_messages(tmp_path: Path):
    messages = [*joints(TIMES, ANGLES), *poses("geometry_msgs/msg/PoseStamped"), *beacon("/a", 1.0, 0.0)]
    path = write_bag(tmp_path / "drive", messages, empty=[("/b", "sensor_msgs/msg/Range")])
    with pytest.raises(LogError, match="drive: /b: the topic has no messages"):
        read(path, {"ranges": {"topics": ["/a", "/b"]}})


@pytest.mark.slow
@pytest.mark.parametrize("size", [np.nan, np.inf])
def test_points_without_numbers_are_left_out_on_request(tmp_path: Path, size: float):
    seen = [*SEEN, (2.0, [(4, size, 0.5), (9, 1.0, -0.2)])]
    path = bag(tmp_path, markers(seen))
    (found,) = read(path, {"landmarks": POINTS}, skip_invalid_rows=True).sensors
    np.testing.assert_allclose(found.values[-1], [np.nan, np.nan, 1.0, -0.2])


@pytest.fixture(scope="module")
def seen_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bag(tmp_path_factory.mktemp("seen"), imu(), markers(SEEN))


@pytest.mark.parametrize(
    ("sensors", "words"),
    [
        ({"yaw_rate": {"topic": "/imus"}}, "the bag has no topic /imus; did you mean /imu"),
        (
            {"yaw_rate": {"topic": "/imu", "field": "rate.z"}},
            "message 1: the message has no field rate; it has header, orientation",
        ),
        (
            {"yaw_rate": {"topic": "/imu", "field": "angular_velocity"}},
            "message 1: angular_velocity is no number: it has x, y, z",
        ),
        ({"landmarks": {"id": "x"}}, "the topic of landmarks is needed"),
        ({"landmarks": POINTS | {"id": "position.x"}}, "landmarks has no id '2'; the study has 4 and 9"),
    ],
)
@pytest.mark.slow
def test_faults(seen_bag: Path, sensors: dict[str, Any], words: str):
    with pytest.raises(LogError) as caught:
        read(seen_bag, sensors)
    assert words in caught.value.issues[0].message


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"sensors": {"ranges": {"topics": ["/a"]}}}, "expected 2 fields of one topic, or as many topics"),
        ({"sensors": {"yaw_rate": {"unit": "m"}}}, "'m'"),
        ({"sensors": {"lidar": "/scan"}}, "has no lidar"),
        ({"poses": "none"}, "nothing says where the robot was"),
    ],
)
def test_keys_that_do_not_fit(keys: dict[str, Any], words: str):
    with pytest.raises(ProblemError, match=words):
        read_logs(["drive"], form(kind="rosbag", **keys), ROBOT, SENSORS)


def test_what_has_to_be_recorded_for_it():
    sensors = {"yaw_rate": {}, "ranges": {"topics": ["/uwb/1", "/uwb/2"]}}
    own = BagForm(joint_states="/joints", poses="none", sensors=sensors)
    assert own.topics == ("/joints", "/uwb/1", "/uwb/2")
    assert own.types == ("sensor_msgs/msg/Imu",)
