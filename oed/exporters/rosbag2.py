"""A drive as a ROS 2 bag: commands, joints and the path they lead along."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from oed.exporters.commands import Commands, joint_name
from oed.exporters.request import Request
from oed.foundation.errors import UserMistake
from oed.foundation.extras import extra
from oed.foundation.work.folders import drafted
from oed.records.record import RESULTS

STORAGES = ("sqlite3", "mcap")
PURPOSE = "writing ROS 2 bags"
VERSION = 8
"""Of the bag's metadata: the newest that Humble reads too; later releases read all earlier ones."""
PLAN, COMMAND, JOINTS = "/plan", "/cmd_vel", "/joint_states"
TOPICS = {
    PLAN: "nav_msgs/msg/Path",
    COMMAND: "geometry_msgs/msg/TwistStamped",
    JOINTS: "sensor_msgs/msg/JointState",
}
WORLD, BODY = "odom", "base_link"
"""Frames of the poses and of the commands: the study's own frame goes by the name `odom`."""


def write_bag(request: Request) -> Path:
    """Write a bag; of several runs a folder of bags `run1`, `run2`, ..., each on its own clock.

    Stamps start at 0, in the messages' headers too: a controller that compares these with its own clock
    has to run on the bag's (`ros2 bag play --clock`, `use_sim_time`). `/cmd_vel` is the body's motion by the
    nominal parameters, of which a controller with others makes other wheel speeds; `/joint_states` has the
    wheel speeds of the design. Of a robot on commands `/cmd_vel` has those of the design, and there are no
    joints. The folder appears when it is complete.

    Raises:
        UserMistake: an unknown storage, the bag exists, it cannot be written, rosbags is not installed.
    """
    if request.storage not in STORAGES:
        raise UserMistake(f"storage: expected one of {', '.join(STORAGES)}, got {request.storage!r}")
    path, runs = request.path("bag"), request.runs
    messages = _Messages()
    _require_free(path, request.force)
    with drafted(path, keep=False) as draft:
        # A bag makes its own folder, and names its files after it.
        draft.discard()
        try:
            for number, run in enumerate(runs, start=1):
                bag = draft.path / f"run{number}" if len(runs) > 1 else draft.path
                _write_run(bag, request, run, messages)
        except OSError as error:
            raise UserMistake(f"{path}: cannot be written: {error.strerror}") from None
        draft.publish(carry=False)
    return path


def bag_library() -> Any:
    """What knows the messages of bags that are written.

    Raises:
        UserMistake: it is not installed; says how to.
    """
    return extra("rosbags.typesys", "ros", PURPOSE)


class _Messages:
    """Makes messages of the types that every release of ROS 2 has alike."""

    def __init__(self) -> None:
        stores = bag_library()
        self.types = stores.get_typestore(stores.Stores.ROS2_HUMBLE)

    def make(self, kind: str, *values: Any) -> Any:
        """A message with its fields in the definition's order."""
        return self.types.types[kind](*values)

    def header(self, stamp: int, frame: str) -> Any:
        """A header; `stamp` in nanoseconds."""
        time = self.make("builtin_interfaces/msg/Time", *divmod(stamp, 10**9))
        return self.make("std_msgs/msg/Header", time, frame)

    def vector(self, x: float, y: float, z: float) -> Any:
        """A vector.

        Args:
            x: coordinate.
            y: coordinate.
            z: coordinate.
        """
        return self.make("geometry_msgs/msg/Vector3", x, y, z)

    def command(self, stamp: int, twist: list[float]) -> Any:
        """A command; `twist`: forward, lateral, yaw rate."""
        forward, lateral, yaw_rate = twist
        body = self.make(
            "geometry_msgs/msg/Twist", self.vector(forward, lateral, 0.0), self.vector(0.0, 0.0, yaw_rate)
        )
        return self.make(TOPICS[COMMAND], self.header(stamp, BODY), body)

    def joints(self, stamp: int, names: list[str], positions: Any, velocities: Any) -> Any:
        """The joints' states, without efforts.

        Args:
            stamp: time of the message.
            names: of the joints.
            positions: [rad].
            velocities: [rad/s].
        """
        return self.make(TOPICS[JOINTS], self.header(stamp, ""), names, positions, velocities, np.zeros(0))

    def pose(self, stamp: int, state: list[float]) -> Any:
        """A pose; `state`: x, y, heading, ..."""
        x, y, heading = state[:3]
        turn = (0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))
        pose = self.make(
            "geometry_msgs/msg/Pose",
            self.make("geometry_msgs/msg/Point", x, y, 0.0),
            self.make("geometry_msgs/msg/Quaternion", *turn),
        )
        return self.make("geometry_msgs/msg/PoseStamped", self.header(stamp, WORLD), pose)

    def plan(self, stamps: list[int], poses: Any) -> Any:
        """All poses at once."""
        stamped = [self.pose(*pair) for pair in zip(stamps, poses.tolist(), strict=True)]
        return self.make(TOPICS[PLAN], self.header(0, WORLD), stamped)


def _write_run(bag: Path, request: Request, run: Commands, messages: _Messages) -> None:
    library, store = extra("rosbags.rosbag2", "ros", PURPOSE), messages.types
    plugin = library.StoragePlugin[request.storage.upper()]
    with library.Writer(bag, version=VERSION, storage_plugin=plugin) as writer:
        topics = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in TOPICS.items()
            if topic != JOINTS or not request.vehicle.on_commands
        }
        for stamp, topic, message in _timeline(request, run, messages):
            writer.write(topics[topic], stamp, store.serialize_cdr(message, TOPICS[topic]))


def _timeline(request: Request, run: Commands, messages: _Messages) -> Iterator[tuple[int, str, Any]]:
    # Stamp [ns], topic and message, in the order of time.
    names = [joint_name(entry) for entry in request.vehicle.inputs]
    stamps = [round(time * 1e9) for time in run.times.tolist()]
    yield 0, PLAN, messages.plan(stamps, run.poses)
    on_commands = request.vehicle.on_commands
    twists = np.insert(run.inputs, 1, 0.0, axis=1) if on_commands else run.twists
    each = zip(stamps, twists.tolist(), run.positions, run.velocities, strict=True)
    for stamp, twist, positions, velocities in each:
        yield stamp, COMMAND, messages.command(stamp, twist)
        if on_commands:
            continue
        yield stamp, JOINTS, messages.joints(stamp, names, positions, velocities)


def _require_free(path: Path, force: bool) -> None:
    if not path.exists():
        return
    if not force:
        raise UserMistake(f"{path} exists; give another place, or force to replace the bag")
    # What is no bag is not deleted, whatever was asked for.
    if not any((path / part / "metadata.yaml").is_file() for part in ("", "run1")):
        raise UserMistake(f"{path} exists and is no bag; it is left as it is")
    if any((path / name).exists() for name in RESULTS):
        raise UserMistake(f"{path} holds results, which would be lost; it is left as it is")
