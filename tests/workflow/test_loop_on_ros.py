"""A loop whose drives are played by their own nodes, and whose logs are the bags recorded then."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driven_robot import QUICKLY, ROOM_STUDY
from fake_ros import Ros, play
from looping import SEARCH, SOON, TARGETS, TRUTH

import oed
from oed.cli import main
from oed.exporters import export
from oed.workflow.studies import parse_study

pytestmark = pytest.mark.usefixtures("blank_figures")


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


def drive_of(sent: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, wheel speeds and noisy poses of commands (n, 3) to a controller that knows nominal sizes."""
    sent = sent[np.diff(sent[:, 0], append=np.inf) > 0]
    wheels = sent[:, 1:] @ np.array([[1, 1], [0.08, -0.08]]) / 0.033
    right, left = wheels.T * [[TRUTH["wheel_radius_right"]], [TRUTH["wheel_radius_left"]]]
    steps = np.diff(sent[:, 0], append=sent[-1, 0])
    turns = steps * (right - left) / TRUTH["track"]
    headings = np.cumsum(turns) - turns
    along = steps * (right + left) / 2 * np.sinc(turns / (2 * np.pi)) * np.exp(1j * (headings + turns / 2))
    places = np.cumsum(along) - along
    poses = np.column_stack([places.real, places.imag, headings])
    return sent[:, 0], wheels, poses + rng.normal(size=poses.shape) * [0.01, 0.01, 0.0175]


def commands(ros: Ros) -> np.ndarray:
    return np.array([(at, one.twist.linear.x, one.twist.angular.z) for at, one in ros.sent])


HELD = "{wheel_speed_right: {held: next}, wheel_speed_left: {held: next}}"
LOG = f"log: {{kind: rosbag, poses: /mocap, inputs: {HELD}}}\n{QUICKLY}"


@pytest.mark.slow
def test_drives_that_their_nodes_play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The file for ROS commands a controller that knows nominal radii and track; the robot has others. What
    is recorded where the file says is the log.
    """
    study, logs = parse_study(f"{ROOM_STUDY}{SEARCH}{LOG}"), tmp_path / "logs"
    logs.mkdir()
    rng, recorders = np.random.default_rng(5), []

    def drive(file: Path, logs: Path) -> None:
        ros = Ros()
        assert play(file, "--yes", "--out", str(logs), ros=ros, patch=monkeypatch) == 0
        (recorder,) = ros.recorders
        recorders.append(recorder)
        recorded(Path(recorder.command[4]), *drive_of(commands(ros), rng))

    out, more = logs.parent / "out", {"to": "ros2_node", "least_gain": 0.0}
    found = oed.loop(study, logs, out, targets=TARGETS, command=drive, **more, **SOON)
    assert found.reached
    assert recorders[0].command[-1] == "^(/cmd_vel|/joint_states|/mocap)$"
    for one in found.found.driven[-1].known:
        assert abs(one.value - TRUTH[one.name]) < 4 * one.now


@pytest.mark.slow
def test_the_line_that_estimates_from_a_drive_of_two_runs(tmp_path: Path, monkeypatch, capsys):
    """It is run as it is printed, where the study is; the bags are elsewhere, in a folder with a space."""
    text = f"{ROOM_STUDY}{SEARCH}".replace("samples: 40", "samples: 40\n  runs: 2")
    (tmp_path / "my study.yaml").write_text(f"{text}{LOG}")
    monkeypatch.chdir(tmp_path)
    assert main(["run", "my study.yaml", "--out", "out", "--quiet"]) == 0
    file, ros, rng = export(tmp_path / "out", "ros2_node"), Ros(), np.random.default_rng(5)
    capsys.readouterr()
    assert play(file, "--yes", "--out", str(tmp_path / "my bags"), ros=ros, patch=monkeypatch) == 0
    line, sent = capsys.readouterr().out.splitlines()[-1], commands(ros)
    parts = np.split(sent, [ros.recorders[1].since])
    for recorder, own in zip(ros.recorders, parts, strict=True):
        recorded(Path(recorder.command[4]), *drive_of(own, rng))
    program, *arguments = shlex.split(line)
    assert program == "oed"
    assert main([*arguments, "--quiet"]) == 0
    found = oed.load_estimate("reports/my study")
    assert [log.name for log in found.logs] == [Path(one).name for one in arguments[2:]]
    for name, value in TRUTH.items():
        assert abs(found.values[name] - value) < 4 * found.errors[name]
