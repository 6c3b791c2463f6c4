"""Logs in ROS bags: the study's key `log` of kind rosbag."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from oed.foundation.component import Component
from oed.foundation.errors import Flaw, LogError
from oed.foundation.text import did_you_mean
from oed.kernel.dynamics.system import Input, System
from oed.kernel.measurement.measurement import Measurement
from oed.logs.bag import JOINTS, POSES, Bag, Clock, Joints, open_bag, read_joints, read_poses
from oed.logs.bag_sensors import SensorTopic, topic_flaws
from oed.logs.drive import RecordedDrive, to_logs
from oed.logs.form import LogForm, Repeats
from oed.logs.integrals import Held, Turned, counted, held_integral, on_one_clock
from oed.logs.log import Finding, Log
from oed.logs.sensors import labelled, with_sensors
from oed.logs.series import Series, together
from oed.logs.tables.columns import Short
from oed.logs.tables.input_columns import unknown_input

QUANTITIES = ("x", "y", "heading")
"""What the poses of all those types have."""


class JointInput(Component):
    """The joint that is one of the robot's inputs.

    Attributes:
        joint: its name in the joint states; by default the only joint that has the words of the input's
            name ("right", "left", "steering", ...).
        form: from its "angle" (a wheel's, unwrapped) or its "speed"; the angle where it is logged. A
            steering angle is read as it is.
        sign: -1 where the joint turns the other way round.
        wrap: full range where the angle begins anew [rad].
        held: how speeds hold; "between" for straight lines between messages.
    """

    joint: str | None = None
    form: Literal["angle", "speed"] | None = None
    sign: Literal[1, -1] = 1
    wrap: Annotated[float, Field(gt=0)] | None = None
    held: Held = "between"


class PoseTopic(Component):
    """The topic of the reference poses.

    Attributes:
        topic: of odometry, poses or transforms; the only one of such a type by default.
        frame, child: which transforms, where the topic has several.
        held: "drop" poses that repeat the one before while the wheels turn, or "keep" them.
    """

    topic: str | None = None
    frame: str | None = None
    child: str | None = None
    held: Repeats = "drop"


def _pose_topic(value: Any) -> str:
    return "none" if value == "none" else "topic"


AnyPoseTopic = Annotated[
    Annotated[Literal["none"], Tag("none")] | Annotated[PoseTopic, Short("topic"), Tag("topic")],
    Discriminator(_pose_topic),
]


class BagForm(LogForm):
    """Joint states and poses in a ROS 1 or ROS 2 bag.

    Attributes:
        joint_states: topic of the wheels' joints; the only one of its type by default.
        inputs: joints of the robot's inputs by their names.
        poses: topic of the reference; "none" where other sensors say where the robot was.
        sensors: topics of the study's other sensors, by their names.
        clock: stamps of the messages' "header", or times at which they were "received".
    """

    kind: Literal["rosbag"] = "rosbag"
    joint_states: str | None = None
    inputs: dict[str, Annotated[JointInput, Short("joint")]] = {}  # noqa: RUF012
    poses: AnyPoseTopic = PoseTopic()
    sensors: dict[str, Annotated[SensorTopic, Short("topics")]] = {}  # noqa: RUF012
    clock: Clock = "header"

    def flaws(self, model: System) -> list[Flaw]:
        """Inputs the robot does not have."""
        return [
            Flaw(("log", "inputs", name), unknown_input(name, model.input_names))
            for name in self.inputs
            if name not in model.input_names
        ]

    def sensor_flaws(self, measurement: Measurement | None) -> list[Flaw]:
        """Sensors that the study has not, numbers of topics and units that do not fit."""
        nowhere = self.poses == "none" and not self.sensors
        text = "nothing says where the robot was: name a sensor that does under `sensors`"
        own = [Flaw(("log", "poses"), text)] if nowhere else []
        return [*own, *topic_flaws(self.sensors, labelled(measurement))]

    def sensed(self, file: Path, logs: list[Log], measurement: Measurement | None) -> list[Log]:
        """The drive with what sensors beside the poses read.

        Args:
            file: that was read.
            logs: the drives in it.
            measurement: the study's.

        Raises:
            LogError: topics that are not there, readings that cannot be the sensors'.
        """
        if not self.sensors:
            return logs
        known, skip = labelled(measurement), self.skip_invalid_rows
        with open_bag(file) as bag:
            found = together(
                partial(one.read, name, known[name], bag, self.clock, skip=skip)
                for name, one in self.sensors.items()
            )
        return with_sensors(logs, found)

    def read(self, file: Path, model: System) -> list[Log]:
        """The drive in a bag.

        Raises:
            LogError: every mistake in the bag.
            UserMistake: the library that reads bags is not installed.
        """
        with open_bag(file) as bag:
            inputs, poses = together([lambda: self._inputs(bag, model), lambda: self._poses(bag)])
        drive = self._drive(file, model, inputs, poses)
        return to_logs([drive], self, "keep" if self.poses == "none" else self.poses.held)

    def _poses(self, bag: Bag) -> Series | None:
        if self.poses == "none":
            return None
        topic = bag.topic(self.poses.topic, POSES, "poses")
        frames = self.poses.frame, self.poses.child
        return read_poses(bag, topic, self.clock, *frames, skip=self.skip_invalid_rows)

    def _inputs(self, bag: Bag, model: System) -> list[tuple[Series, Turned]]:
        topic = bag.topic(self.joint_states, (JOINTS,), "joint_states")
        joints = read_joints(bag, topic, self.clock)
        if not joints.names:
            raise bag.flaw(topic, "no joint states")
        return together(partial(self._input, bag, joints, entry) for entry in model.inputs)

    def _input(self, bag: Bag, joints: Joints, entry: Input) -> tuple[Series, Turned]:
        given = self.inputs.get(entry.name) or JointInput()
        name = given.joint or _named_like(entry.name, joints.names)
        if name not in joints.names:
            hint = (name and did_you_mean(name, joints.names)) or ";"
            missing = f"no joint {name}" if name else "it is not clear which joint this is"
            text = f"{missing}{hint} the bag has {', '.join(joints.names)}"
            raise bag.flaw(entry.name, text, "inputs", entry.name, "joint")
        by_angle = given.form != "speed" if name in joints.positions else False
        series = (joints.positions if by_angle or not entry.drives else joints.speeds).get(name)
        if series is None or (given.form == "angle" and not by_angle):
            wanted = "speeds" if entry.drives and given.form != "angle" else "positions"
            text = f"the joint {name} has no {wanted} in the bag"
            raise bag.flaw(entry.name, text, "inputs", entry.name, "form")
        series = series.finite(self.skip_invalid_rows).without_repeats()
        turned = _turned(series, given, entry, by_angle)
        flaws = [*series.clock_flaws(), *turned.flaws]
        if flaws:
            raise LogError(flaws)
        return series, turned

    def _drive(
        self, file: Path, model: System, inputs: list[tuple[Series, Turned]], poses: Series | None
    ) -> RecordedDrive:
        times, values = on_one_clock([(series.times, turned.integral) for series, turned in inputs])
        if not len(times):
            text = "the joints of the inputs were logged one after the other, not at the same time"
            raise LogError.about(file, text, "inputs")
        first = inputs[0][0]
        lines = first.lines[np.clip(np.searchsorted(first.times, times), 0, len(first) - 1)]
        skipped = {line for series, _ in inputs for line in series.skipped}
        arrived = {line for series, _ in inputs for line in series.lines.tolist()} | skipped
        wraps = sum(turned.wraps for _, turned in inputs)
        integrals = replace(
            first, times=times, values=values, lines=lines, skipped=tuple(skipped), arrived=len(arrived)
        )
        text = f"joint angles began anew {wraps} times; unwrapped"
        return RecordedDrive(
            name=file.stem,
            names=model.input_names,
            inputs=integrals,
            # Without poses the times alone, until those of other sensors are known.
            poses=integrals.with_values(np.zeros((len(times), 0))) if poses is None else poses,
            quantities=() if poses is None else QUANTITIES,
            driving=np.array([entry.drives for entry in model.inputs]),
            bridged=np.array([turned.bridges for _, turned in inputs]),
            one_clock=False,
            found=(Finding("counter_wrapped", text),) if wraps else (),
        )


def _named_like(name: str, joints: tuple[str, ...]) -> str:
    # The words by which the robot's inputs differ are in the names of its joints.
    words = set(name.split("_")) - {"wheel", "speed", "angle"}
    fitting = [joint for joint in joints if words <= set(re.split(r"[\W_]+", joint.lower()))]
    return fitting[0] if len(fitting) == 1 else ""


def _turned(series: Series, given: JointInput, entry: Input, by_angle: bool) -> Turned:
    if entry.drives and by_angle:
        found = counted(series, 0, str(given.joint or entry.name), given.wrap)
        return Turned(given.sign * found.integral, True, found.wraps, found.flaws)
    return Turned(given.sign * held_integral(series.times, series.values[:, 0], given.held))
