"""What is in a ROS bag: joints and poses as numbers on their clocks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from oed.foundation.errors import LogError
from oed.foundation.extras import extra
from oed.foundation.files import no_such_file, special
from oed.foundation.text import did_you_mean
from oed.logs.form import is_bag
from oed.logs.series import NotInLog, Series
from oed.logs.tables.tum import OFF_UNIT, heading_of

Clock = Literal["header", "received"]

JOINTS = "sensor_msgs/msg/JointState"
"""Type of the messages that have the wheels' joints."""
TRANSFORMS = "tf2_msgs/msg/TFMessage"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    TRANSFORM,
    TRANSFORMS,
)
"""Types of those that have poses."""
IMU = "sensor_msgs/msg/Imu"
"""Type of those that have a heading alone."""
CAR = "ackermann_msgs/msg/AckermannDrive"
CARS = {
    CAR: "\n".join(
        f"float32 {name}"
        for name in ("steering_angle", "steering_angle_velocity", "speed", "acceleration", "jerk")
    ),
    f"{CAR}Stamped": "std_msgs/Header header\nackermann_msgs/AckermannDrive drive",
}
"""Messages that the library does not know, where a bag does not say what its own look like."""
NEEDED_FOR = "reading ROS bags"


@dataclass(frozen=True)
class Bag:
    """An open bag.

    Attributes:
        file: its name.
        reader: of the ROS library.
        types: message type of each topic.
    """

    file: str
    reader: Any
    types: dict[str, str]

    def issue(self, key: str, message: str, *named: str) -> LogError:
        """An error about the bag as a whole.

        Args:
            key: that it is about.
            message: what is wrong.
            named: path of the key in the study's key `log` that names what the bag has not.
        """
        return LogError([NotInLog(self.file, 0, 0, key, message, ("log", *named) if named else ())])

    def topic(
        self,
        given: str | None,
        types: Sequence[str],
        key: str,
        *named: str,
        taken: Collection[str] = (),
    ) -> str:
        """The topic given, or the only one of one of the types.

        Args:
            given: the topic's name, or None.
            types: message types that fit.
            key: of the study, for errors.
            named: path of the study's key that names the topic; `key` and topic by default.
            taken: topics that are something else, and are not found by themselves.

        Raises:
            LogError: there is none, or there are several.
        """
        named = named or (key, "topic")
        every = {topic: of_type for topic, of_type in self.types.items() if topic not in taken}
        fitting = sorted(topic for topic, of_type in every.items() if of_type in types)
        words = " or ".join(name.rpartition("/")[2] for name in types)
        there = f"of type {words} it has {', '.join(fitting) or 'none'}"
        if given is not None and given not in self.types:
            hint = did_you_mean(given, fitting) or ";"
            raise self.issue(key, f"the bag has no topic {given}{hint} {there}", *named)
        if given is not None and self.types[given] not in types:
            raise self.issue(key, f"{given} is of type {self.types[given]}; {there}", *named)
        if given is None and len(fitting) != 1:
            raise self.issue(key, f"expected one topic to choose from; {there}")
        return given or fitting[0]

    def any_topic(self, given: str, key: str, *named: str) -> str:
        """A topic of any type.

        Args:
            given: its name.
            key: of the study, for errors.
            named: path of the study's key that names it.

        Raises:
            LogError: there is no such topic.
        """
        if given not in self.types:
            known = ", ".join(sorted(self.types)) or "none"
            hint = did_you_mean(given, self.types) or ";"
            raise self.issue(key, f"the bag has no topic {given}{hint} it has {known}", *named)
        return given

    def messages(self, topic: str, clock: Clock) -> Iterator[tuple[int, float, Any]]:
        """Number from 1, time [s] and content of each message of a topic, in the order of recording.

        The time is the stamp in the message's header, or that of its recording where it has none.

        Raises:
            LogError: a message that is none of its type.
        """
        wanted = [one for one in self.reader.connections if one.topic == topic]
        recorded = self.reader.messages(connections=wanted)
        for number, (connection, received, data) in enumerate(recorded, start=1):
            try:
                message = self.reader.deserialize(data, connection.msgtype)
            except Exception as error:
                text = f"cannot be decoded as {connection.msgtype}: {error}"
                raise self.issue(topic, f"message {number}: {text}") from None
            for part in getattr(message, "transforms", [message]):
                stamped = clock == "header" and hasattr(part, "header")
                yield number, (_stamp(part) if stamped else received * 1e-9), part


def _stamp(message: Any) -> float:
    stamp = message.header.stamp
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def bag_reader() -> Any:
    """The library that reads bags.

    Raises:
        UserMistake: it is not installed; says how to.
    """
    return extra("rosbags.highlevel", "ros", NEEDED_FOR)


@contextmanager
def open_bag(file: Path) -> Iterator[Bag]:
    """Open a ROS 1 or ROS 2 bag.

    Raises:
        LogError: no such file, no bag, or one that is broken.
        UserMistake: the library that reads bags is not installed.
    """
    if not file.exists():
        raise LogError.about(file, no_such_file(file))
    if not is_bag(file):
        text = "is no ROS bag: expected a folder with metadata.yaml, or a file .mcap, .db3 or .bag"
        raise LogError.about(file, text)
    for part in (file, *(file.iterdir() if file.is_dir() else ())):
        if special(part):
            raise LogError.about(part, f"cannot be read as a ROS bag: expected a file, got {special(part)}")
    highlevel = bag_reader()
    try:
        with highlevel.AnyReader([file], default_typestore=_known_types()) as reader:
            _share_types(reader)
            types = {one.topic: one.msgtype for one in reader.connections}
            yield Bag(str(file), reader, types)
    except LogError:
        raise
    except Exception as error:
        # Broken files come to light as errors of the database, the compression or the library.
        reason = f"cannot be read as a ROS bag: {error}"
        raise LogError.about(file, reason) from None


@cache
def _known_types() -> Any:
    # Bags before ROS 2 Iron do not say what their messages look like.
    typesys = extra("rosbags.typesys", "ros", NEEDED_FOR)
    known = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for name, text in CARS.items():
        known.register(typesys.get_types_from_msg(text, name))
    return known


def _share_types(reader: Any) -> None:
    # The library writes and compiles a decoder of every type for each bag that is opened.
    stated = frozenset((one.msgtype, str(one.msgdef)) for one in reader.connections)
    first = _first_types(stated)
    if not first:
        first.append(reader.typestore)
    reader.typestore = first[0]


@lru_cache(maxsize=16)
def _first_types(stated: frozenset[tuple[str, str]]) -> list[Any]:
    # The types of the first bag with these definitions, once that is open.
    return []


@dataclass(frozen=True)
class Joints:
    """Joint readings of a bag.

    Attributes:
        names: of the joints.
        positions: of each, (n, 1) [rad], where any is a number.
        speeds: of each, (n, 1) [rad/s], likewise.
    """

    names: tuple[str, ...]
    positions: dict[str, Series]
    speeds: dict[str, Series]


def read_joints(bag: Bag, topic: str, clock: Clock) -> Joints:
    """Every joint of a topic on the clock of the messages that have it.

    Args:
        bag: open.
        topic: of joint states.
        clock: that of the messages' headers, or of their recording.

    Raises:
        LogError: stamps that are all zero, joints that are named twice or not at all.
    """
    rows: dict[str, dict[str, list[tuple[float, float, int]]]] = {"position": {}, "velocity": {}}
    for number, time, message in bag.messages(topic, clock):
        reason = _reason_against(message, tuple(rows))
        if reason:
            raise bag.issue(topic, f"message {number}: {reason}")
        for quantity, found in rows.items():
            # A joint state may lack all of its positions, or all of its speeds.
            for name, value in zip(message.name, getattr(message, quantity), strict=False):
                found.setdefault(name, []).append((time, float(value), number))
    positions, speeds = (
        {name: series_of(bag, topic, own) for name, own in found.items()} for found in rows.values()
    )
    return Joints(tuple(dict.fromkeys([*positions, *speeds])), _known(positions), _known(speeds))


def _reason_against(joints: Any, quantities: Sequence[str]) -> str:
    # Why it is not clear which number of a joint state is that of which joint; "" where it is.
    twice = [name for name, times in Counter(joints.name).items() if times > 1]
    if twice:
        return f"the joint {twice[0]} is named twice"
    names = len(joints.name)
    for quantity in quantities:
        size = len(getattr(joints, quantity))
        if size not in (0, names):
            return f"{quantity}: expected as many as names, {names}, got {size}"
    return ""


def _known(readings: dict[str, Series]) -> dict[str, Series]:
    # Drivers fill in nan for what a joint has not.
    return {name: series for name, series in readings.items() if np.isfinite(series.values).any()}


def series_of(bag: Bag, topic: str, rows: Sequence[Sequence[float]]) -> Series:
    """The numbers of a topic's messages on their clock.

    Args:
        bag: open.
        topic: of the messages.
        rows: time [s], values, number of the message from 1.

    Raises:
        LogError: stamps that are all zero.
    """
    table = np.array(rows, dtype=float)
    lines = table[:, -1].astype(np.intp)
    series = Series(bag.file, topic, table[:, 0], table[:, 1:-1], lines, counted="message")
    if not series.times.any():
        raise bag.issue(topic, "the stamps of the messages are all zero; say `clock: received`")
    return series


def read_poses(
    bag: Bag,
    topic: str,
    clock: Clock,
    frame: str | None = None,
    child: str | None = None,
    *,
    key: str = "poses",
    skip: bool = False,
) -> Series:
    """Poses x, y [m], heading [rad] of a topic.

    Args:
        bag: open.
        topic: of odometry, poses or transforms.
        clock: that of the messages' headers, or of their recording.
        frame: which of them: from this frame ...
        child: ... to this one.
        key: of the study's key `log` that asks for them.
        skip: whether messages without finite numbers are left out instead of refused.

    Raises:
        LogError: no messages, numbers and quaternions that are none, transforms of several frames.
    """
    rows, pairs = [], set[tuple[str, str]]()
    of_transforms = bag.types[topic] in (TRANSFORM, TRANSFORMS)
    for number, time, message in bag.messages(topic, clock):
        if of_transforms or frame is not None or child is not None:
            pair = _frames(message)
            pairs.add(pair)
            if frame not in (None, pair[0]) or child not in (None, pair[1]):
                continue
        rows.append((time, *_pose(message), number))
    chosen = {pair for pair in pairs if frame in (None, pair[0]) and child in (None, pair[1])}
    if of_transforms and len(chosen) > 1:
        text = f"{topic} has several transforms; give `frame` and `child`: {_pairs(pairs)}"
        raise bag.issue(key, text, key)
    if not rows:
        raise _no_pose(bag, topic, pairs, frame, child, key)
    return planar(series_of(bag, topic, rows).finite(skip).without_repeats())


def _no_pose(
    bag: Bag, topic: str, pairs: Iterable[tuple[str, str]], frame: str | None, child: str | None, asking: str
) -> LogError:
    text, known = f"no poses in {topic}", _pairs(pairs)
    for key, given, there in zip(("frame", "child"), (frame, child), zip(*pairs, strict=True), strict=False):
        if given is not None and given not in there:
            hint = did_you_mean(given, there) or ";"
            return bag.issue(asking, f"{text} of the {key} {given}{hint} it has {known}", asking, key)
    return bag.issue(asking, f"{text}; it has {known}" if known else text)


def _frames(message: Any) -> tuple[str, str]:
    # That a pose is seen from, and that it is the pose of, where the message says so.
    return message.header.frame_id.lstrip("/"), getattr(message, "child_frame_id", "").lstrip("/")


def _pairs(pairs: Iterable[tuple[str, str]]) -> str:
    return ", ".join(f"{parent} -> {own}" if own else parent for parent, own in sorted(pairs))


def _pose(message: Any) -> tuple[float, ...]:
    if hasattr(message, "orientation"):
        turned = message.orientation
        return (0.0, 0.0, turned.x, turned.y, turned.z, turned.w)
    if hasattr(message, "transform"):
        place, turned = message.transform.translation, message.transform.rotation
    else:
        pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
        place, turned = pose.position, pose.orientation
    return (place.x, place.y, turned.x, turned.y, turned.z, turned.w)


def planar(series: Series) -> Series:
    """Values whose last four columns are quaternions, with headings [rad] in their place.

    Raises:
        LogError: quaternions that are none.
    """
    turned = series.values[:, -4:]
    with np.errstate(over="ignore"):
        sizes = np.linalg.norm(turned, axis=1)
    issues = [
        series.issue(row, series.clock, "expected a unit quaternion")
        for row in np.flatnonzero(np.abs(sizes - 1) > OFF_UNIT).tolist()
    ]
    if issues:
        raise LogError(issues)
    return series.with_values(np.column_stack([series.values[:, :-4], heading_of(turned)]))
