"""A loop whose drives are played by their own nodes, and whose logs are the bags recorded then."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_ros import Ros, play
from looping import SOON, STUDY, TARGETS, TRUTH

import oed
from oed.workflow.studies import parse_study


def recorded(bag: Path, times: np.ndarray, wheels: np.ndarray, poses: np.ndarray) -> None:
    """Write what a robot's joints and a tracker say, as the recorder does: the metadata last."""
    library, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kinds = {"/joint_states": "sensor_msgs/msg/JointState", "/mocap": "geometry_msgs/msg/PoseStamped"}

    def make(kind: str, *values: Any) -> Any:
        return store.types[kind](*values)

    with library.Writer(bag, version=8) as writer:
        topics = {name: writer.add_connection(name, kind, typestore=store) for name, kind in kinds.items()}
        for time_, speeds, (x, y, heading) in zip(times, wheels, poses, strict=True):
            stamp = round(time_ * 1e9)
            header = make(
                "std_msgs/msg/Header", make("builtin_interfaces/msg/Time", *divmod(stamp, 10**9)), "odom"
            )
            turn = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2))
            pose = make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", x, y, 0.0), turn)
            names = ["right_wheel_joint", "left_wheel_joint"]
            messages = {
                "/joint_states": (header, names, np.zeros(0), np.asarray(speeds), np.zeros(0)),
                "/mocap": (header, pose),
            }
            for topic, parts in messages.items():
                data = store.serialize_cdr(make(kinds[topic], *parts), kinds[topic])
                writer.write(topics[topic], stamp, data)


@pytest.mark.slow
def test_drives_that_their_nodes_play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The file for ROS commands a controller that knows nominal radii and track; the robot has others. What
    is recorded where the file says is the log.
    """
    held = "inputs: {wheel_speed_right: {held: next}, wheel_speed_left: {held: next}}"
    study = parse_study(f"{STUDY}log: {{kind: rosbag, poses: /mocap, {held}}}\n")
    logs = tmp_path / "logs"
    logs.mkdir()
    rng, recorders = np.random.default_rng(5), []

    def drive(file: Path, logs: Path) -> None:
        ros = Ros()
        assert play(file, "--yes", "--out", str(logs), ros=ros, patch=monkeypatch) == 0
        sent = np.array([(at, one.twist.linear.x, one.twist.angular.z) for at, one in ros.sent])
        sent = sent[np.diff(sent[:, 0], append=np.inf) > 0]
        wheels = sent[:, 1:] @ np.array([[1, 1], [0.08, -0.08]]) / 0.033
        right, left = wheels.T * [[TRUTH["wheel_radius_right"]], [TRUTH["wheel_radius_left"]]]
        steps = np.diff(sent[:, 0], append=sent[-1, 0])
        turns = steps * (right - left) / TRUTH["track"]
        headings = np.cumsum(turns) - turns
        along = (
            steps * (right + left) / 2 * np.sinc(turns / (2 * np.pi)) * np.exp(1j * (headings + turns / 2))
        )
        places = np.cumsum(along) - along
        poses = np.column_stack([places.real, places.imag, headings])
        poses += rng.normal(size=poses.shape) * [0.01, 0.01, 0.0175]
        (recorder,) = ros.recorders
        recorders.append(recorder)
        recorded(Path(recorder.command[4]), sent[:, 0], wheels, poses)

    out, more = logs.parent / "out", {"to": "ros2_node", "least_gain": 0.0}
    found = oed.loop(study, logs, out, targets=TARGETS, command=drive, **more, **SOON)
    assert found.reached
    assert recorders[0].command[-1] == "^(/cmd_vel|/joint_states|/mocap)$"
    for one in found.found.driven[-1].known:
        assert abs(one.value - TRUTH[one.name]) < 4 * one.now
