"""The few calls of rclpy that a drive's node makes, on a clock that goes as fast as it is asked to."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

MESSAGES = {
    "geometry_msgs": ("Twist", "TwistStamped"),
    "ackermann_msgs": ("AckermannDriveStamped",),
    "sensor_msgs": ("JointState",),
    "std_msgs": ("Float64MultiArray",),
    "nav_msgs": ("Odometry",),
}


class Message:
    """A message of any type: whatever part of it is asked for is there."""

    def __getattr__(self, name: str) -> Message:
        if name.startswith("__"):
            raise AttributeError(name)
        part = Message()
        setattr(self, name, part)
        return part


class Ros:
    """What happens around a node.

    Attributes:
        now: of every clock [s].
        sent: time and message of each command.
        topics: in the graph, with their types.
        listeners: how many hear the commands.
        feedback: whether it arrives.
        stall: time from which on the timer comes late, and by how much.
        behind: by how much the nodes' clock has been set back [s].
        events: what happens at times: called once.
        recorders: command lines of processes begun, and what they were sent.
        asked: questions to who drives.
        handlers: of signals.
    """

    def __init__(self) -> None:
        self.now, self.sent, self.listeners = 100.0, [], 1
        self.topics = [
            ("/odom", ["nav_msgs/msg/Odometry"]),
            ("/joint_states", ["sensor_msgs/msg/JointState"]),
        ]
        self.topics += [("/camera", ["sensor_msgs/msg/Image"])]
        self.feedback: Callable[[Any], None] | None = None
        self.hearing = True
        self.stall: tuple[float, float] | None = None
        self.behind = 0.0
        self.events: list[tuple[float, Callable[[], None]]] = []
        self.timer: SimpleNamespace | None = None
        self.recorders: list[Recorder] = []
        self.initialised = 0
        self.asked: list[str] = []
        self.handlers: dict[int, Callable[..., None]] = {}

    def set_back(self, seconds: float, *, simulated: bool = False) -> None:
        """As when the time is set on a robot that is driving: timers wait until it is theirs again. With
        `simulated` time they come on.
        """
        self.behind += seconds
        if self.timer is not None and not simulated:
            self.timer.due += seconds

    def pass_time(self, seconds: float) -> None:
        self.now += seconds
        due = [one for one in self.events if one[0] <= self.now]
        self.events = [one for one in self.events if one[0] > self.now]
        for _, event in due:
            event()

    def spin_once(self, node: Any, timeout_sec: float) -> None:
        assert self.initialised == 1
        if self.feedback and self.hearing:
            self.feedback(Message())
        timer = self.timer
        if timer is None or timer.due > self.now + timeout_sec:
            return self.pass_time(timeout_sec)
        self.pass_time(max(0.0, timer.due - self.now))
        if self.stall and self.now >= self.stall[0]:
            late, self.stall = self.stall[1], None
            self.pass_time(late)
        # As rcl does: the next call is on the timer's own grid.
        while timer.due <= self.now + 1e-9:
            timer.due += timer.period
        timer.callback()


class Node:
    """A node of the fake."""

    ros: Ros

    def __init__(self, name: str) -> None:
        assert self.ros.initialised == 1
        self.name = name

    def create_publisher(self, kind: type, topic: str, depth: int) -> SimpleNamespace:
        def publish(message: Message) -> None:
            assert isinstance(message, kind)
            self.ros.sent.append((self.ros.now, message))

        self.topic = topic
        return SimpleNamespace(publish=publish, get_subscription_count=lambda: self.ros.listeners)

    def create_subscription(self, kind: type, topic: str, callback: Any, quality: Any) -> None:
        self.ros.feedback = callback

    def create_timer(self, period: float, callback: Callable[[], None]) -> SimpleNamespace:
        self.ros.timer = SimpleNamespace(period=period, callback=callback, due=self.ros.now + period)
        return self.ros.timer

    def destroy_timer(self, timer: SimpleNamespace) -> None:
        assert timer is self.ros.timer
        self.ros.timer = None

    def get_clock(self) -> SimpleNamespace:
        now = SimpleNamespace(
            nanoseconds=round((self.ros.now - self.ros.behind) * 1e9), to_msg=lambda: self.ros.now
        )
        return SimpleNamespace(now=lambda: now)

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return self.ros.topics

    def destroy_node(self) -> None:
        """Nothing is left."""


class Recorder:
    """A process that records, from the command of the number `since` on."""

    def __init__(self, command: list[str], start_new_session: bool = False) -> None:
        assert start_new_session, "Ctrl-C would end it before the robot stands"
        self.command, self.signals, self.code, self.ends = command, [], None, True
        self.since = 0

    def poll(self) -> int | None:
        return self.code

    def send_signal(self, number: int) -> None:
        self.signals.append(number)
        self.code = 0

    def wait(self, timeout: float) -> int:
        if not self.ends:
            raise subprocess.TimeoutExpired(self.command, timeout)
        return 0

    def kill(self) -> None:
        self.code = -9


def play(file: Path, *arguments: str, ros: Ros, patch: pytest.MonkeyPatch) -> int:
    """Run a node's file with arguments; returns its exit code."""
    _install(ros, patch)
    patch.setattr(sys, "argv", [str(file), *arguments])
    described = importlib.util.spec_from_file_location("played", file)
    assert described is not None
    assert described.loader is not None
    module = importlib.util.module_from_spec(described)
    patch.setitem(sys.modules, "played", module)
    described.loader.exec_module(module)
    patch.setattr(module, "time", SimpleNamespace(sleep=ros.pass_time, monotonic=lambda: ros.now))

    def begun(command: list[str], **more: Any) -> Recorder:
        ros.recorders.append(Recorder(command, **more))
        ros.recorders[-1].since = len(ros.sent)
        return ros.recorders[-1]

    patch.setattr(module.subprocess, "Popen", begun)
    patch.setattr("builtins.input", lambda question="": ros.asked.append(question) or "")
    patch.setattr(module.signal, "signal", ros.handlers.__setitem__)
    return module.main()


def _install(ros: Ros, patch: pytest.MonkeyPatch) -> None:
    def init(args: list[str], signal_handler_options: str) -> None:
        assert signal_handler_options == "none"
        ros.initialised += 1

    def shutdown() -> None:
        ros.initialised -= 1

    def without_ros(args: list[str]) -> list[str]:
        return args[: args.index("--ros-args")] if "--ros-args" in args else args

    modules = {
        "rclpy": {"init": init, "shutdown": shutdown, "spin_once": ros.spin_once},
        "rclpy.node": {"Node": type("Node", (Node,), {"ros": ros})},
        "rclpy.qos": {"qos_profile_sensor_data": "sensor data"},
        "rclpy.signals": {"SignalHandlerOptions": SimpleNamespace(NO="none")},
        "rclpy.utilities": {"remove_ros_args": without_ros},
    }
    for package, names in MESSAGES.items():
        modules |= {package: {}, f"{package}.msg": {name: type(name, (Message,), {}) for name in names}}
    for name, members in modules.items():
        module = ModuleType(name)
        vars(module).update(members)
        patch.setitem(sys.modules, name, module)
