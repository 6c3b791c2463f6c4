"""ROS bags, written for tests: messages of every type that logs have, in either version."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from oed.logs.bag import CARS

START = 1_700_000_000.0
OWN = "own_msgs/msg/Wheels"
OWN_TEXT = """\
std_msgs/Header header
own_msgs/Wheel left
own_msgs/Wheel[] wheels
float64[2] speeds
int32 ticks
bool moving
string state
================================================================================
MSG: own_msgs/Wheel
float64 velocity
int64 count
"""
"""A message that only its makers know: what is in it, its bags say."""
STORES = {"ros2": get_typestore(Stores.ROS2_HUMBLE), "ros1": get_typestore(Stores.ROS1_NOETIC)}
for store in STORES.values():
    for name, text in CARS.items():
        store.register(get_types_from_msg(text, name))
    store.register(get_types_from_msg(OWN_TEXT, OWN))
TYPES = STORES["ros2"].types
ODOMETRY = "nav_msgs/msg/Odometry"

Message = tuple[str, float, Any]
"""Topic, seconds of recording, message."""


def header(time: float, frame: str = "odom", types: Any = TYPES) -> Any:
    nanoseconds = round(time * 1e9)
    stamp = types["builtin_interfaces/msg/Time"](sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
    extra = {"seq": 0} if types is not TYPES else {}
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **extra)


def quaternion(heading: float, types: Any = TYPES) -> Any:
    return types["geometry_msgs/msg/Quaternion"](
        x=0.0, y=0.0, z=float(np.sin(heading / 2)), w=float(np.cos(heading / 2))
    )


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0, types: Any = TYPES) -> Any:
    return types["geometry_msgs/msg/Vector3"](x=float(x), y=float(y), z=float(z))


def pose(row: Sequence[float], types: Any = TYPES) -> Any:
    """Of x, y, heading."""
    point = types["geometry_msgs/msg/Point"](x=float(row[0]), y=float(row[1]), z=0.2)
    return types["geometry_msgs/msg/Pose"](position=point, orientation=quaternion(row[2], types))


def twist(speed: float, yaw_rate: float, types: Any = TYPES) -> Any:
    linear, angular = vector(speed, types=types), vector(z=yaw_rate, types=types)
    return types["geometry_msgs/msg/Twist"](linear=linear, angular=angular)


def twist_message(kind: str, time: float, speed: float, yaw_rate: float, types: Any = TYPES) -> Any:
    """A twist of any type but odometry's."""
    own = twist(speed, yaw_rate, types)
    if kind.endswith("/Twist"):
        return own
    if kind.endswith("TwistStamped"):
        return types[kind](header=header(time, types=types), twist=own)
    covered = types["geometry_msgs/msg/TwistWithCovariance"](twist=own, covariance=np.zeros(36))
    return types[kind](header=header(time, types=types), twist=covered)


def odometry_message(
    time: float,
    row: Sequence[float],
    moved: Sequence[float] = (0, 0),
    frame: str = "odom",
    types: Any = TYPES,
) -> Any:
    """Of x, y, heading, and speed and yaw rate."""
    covered = types["geometry_msgs/msg/PoseWithCovariance"](pose=pose(row, types), covariance=np.zeros(36))
    moving = types["geometry_msgs/msg/TwistWithCovariance"](
        twist=twist(*moved, types=types), covariance=np.zeros(36)
    )
    head = header(time, frame, types)
    return types[ODOMETRY](header=head, child_frame_id="base_link", pose=covered, twist=moving)


def write_bag(
    path: Path,
    messages: Sequence[Message],
    plugin: StoragePlugin = StoragePlugin.MCAP,
    empty: Sequence[tuple[str, str]] = (),
) -> Path:
    """A bag of ROS 2; `empty` are topics and their types without messages."""
    store = STORES["ros2"]
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        topics = {topic: message.__msgtype__ for topic, _, message in messages} | dict(empty)
        known = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()}
        for topic, time, message in sorted(messages, key=lambda one: one[1]):
            data = store.serialize_cdr(message, message.__msgtype__)
            writer.write(known[topic], round(time * 1e9), data)
    return path


def write_bag_1(path: Path, messages: Sequence[Message]) -> Path:
    """A bag of ROS 1."""
    store = STORES["ros1"]
    with Writer1(path) as writer:
        topics = {topic: message.__msgtype__ for topic, _, message in messages}
        known = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()}
        for topic, time, message in messages:
            data = store.serialize_ros1(message, message.__msgtype__)
            writer.write(known[topic], round(time * 1e9), data)
    return path
