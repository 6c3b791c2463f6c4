"""Logs in ROS bags: the study's key `log` of kind rosbag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Tag

from oed.foundation.errors import Issue, LogError
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.measurement import Measurement
from oed.logs.bag import JOINTS, POSES, Bag, Clock, bag_reader, open_bag
from oed.logs.bag_inputs import AnyBagInputs, BagInput, OdometryTopic, meant, source_of
from oed.logs.bag_poses import PoseTopic
from oed.logs.bag_reading import BagReading, Reading
from oed.logs.bag_sensors import SensorTopic, usual_type
from oed.logs.drive import RecordedDrive, to_logs
from oed.logs.form import LogForm, read_twice
from oed.logs.integrals import on_one_clock
from oed.logs.log import Finding, Log
from oed.logs.sensors import labelled, source_issues, with_sensors
from oed.logs.series import Series, together
from oed.logs.tables.columns import NONE_OR_GIVEN, Short
from oed.logs.tables.input_columns import unknown_input

AnyPoseTopic = Annotated[
    Annotated[Literal["none"], Tag("none")] | Annotated[PoseTopic, Short("topic"), Tag("given")],
    NONE_OR_GIVEN,
]


class BagForm(LogForm):
    """Inputs and poses in a ROS 1 or ROS 2 bag.

    Attributes:
        joint_states: topic of the wheels' joints; the only one of its type by default.
        commands: topic of a robot's speed and yaw rate (Twist, TwistStamped, TwistWithCovarianceStamped, or
            the twist of Odometry), or of a car's speed and steering (AckermannDrive, stamped or not); by
            default the only one that fits, where these are not joints'.
        inputs: joints or fields of the robot's inputs by their names; or the poses of odometry.
        poses: topic of the reference; "none" where other sensors say where the robot was.
        sensors: topics of the study's other sensors, by their names.
        clock: stamps of the messages' "header", or times at which they were "received"; of messages
            without a header these.
    """

    kind: Literal["rosbag"] = "rosbag"
    joint_states: str | None = None
    commands: str | None = None
    inputs: AnyBagInputs = {}  # noqa: RUF012
    poses: AnyPoseTopic = PoseTopic()
    sensors: dict[str, Annotated[SensorTopic, Short("topics")]] = {}  # noqa: RUF012
    clock: Clock = "header"

    def require_installed(self) -> None:
        """The library that reads bags."""
        bag_reader()

    def issues(self, model: System) -> list[Issue]:
        """Inputs the robot does not have, keys that exclude each other, forms and units that do not fit."""
        reference = [] if self.reference is None else self.reference.issues()
        own = [*reference, *self._unread(model)]
        if isinstance(self.inputs, OdometryTopic):
            return [*self.inputs.issues(model), *own]
        entries = {entry.name: entry for entry in model.inputs}
        unknown = [
            Issue(("log", "inputs", name), unknown_input(name, model.input_names))
            for name in self.inputs
            if name not in entries
        ]
        known = [one.issues(entries[name], model) for name, one in self.inputs.items() if name in entries]
        return [
            *unknown,
            *(issue for issues in known for issue in issues),
            *own,
            *self._read_twice(self.inputs),
        ]

    def _unread(self, model: System) -> list[Issue]:
        # Topics that no input is read from, so that naming them does nothing.
        places = {entry.name: meant(entry, model) for entry in model.inputs}
        none = "no input is {}; leave it out"
        texts = {"joint_states": none.format("a joint's"), "commands": none.format("a command")}
        if not any(places.values()):
            names = ", ".join(places)
            texts["commands"] = f"no message has {names} as commands; a unicycle and an ackermann take them"
        read, joints = set[str](), self.joint_states is not None
        if not isinstance(self.inputs, OdometryTopic):
            own = ((self.inputs.get(name) or BagInput(), place) for name, place in places.items())
            read |= {source_of(given, place, self.commands, joints) for given, place in own}
        return [
            Issue(("log", key), text)
            for key, text in texts.items()
            if getattr(self, key) is not None and key not in read
        ]

    def _read_twice(self, inputs: Mapping[str, BagInput]) -> list[Issue]:
        # Joints and fields that are more than one quantity.
        each: dict[tuple[str, ...], tuple[str, ...]] = {}
        for name, one in inputs.items():
            if one.joint is not None:
                each["log", "inputs", name] = ("joint", one.joint)
            elif one.topic is not None and one.field is not None:
                each["log", "inputs", name] = ("field", one.field, "of", one.topic)
        if self.reference is not None:
            topic = str(self.reference.topic)
            fields = self.reference.fields.items()
            each |= {("log", "poses", name): ("field", one.field, "of", topic) for name, one in fields}
        return read_twice(each)

    @property
    def named_states(self) -> frozenset[str]:
        """States of the robot whose fields are named."""
        return frozenset() if self.reference is None else frozenset(self.reference.fields)

    @property
    def clock_hint(self) -> str:
        """Which key may mend times that do not rise."""
        usual = "times have to rise: `clock: received` takes those of the recording"
        return usual if self.clock == "header" else ""

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics that it names."""
        inputs = [self.inputs] if isinstance(self.inputs, OdometryTopic) else self.inputs.values()
        own = [getattr(one, "topic", None) for one in inputs]
        own += [] if self.reference is None else [self.reference.topic]
        own += [topic for one in self.sensors.values() for topic in one.topics]
        named = (self.joint_states, self.commands, *own)
        return tuple(dict.fromkeys(one for one in named if one is not None))

    @property
    def types(self) -> tuple[str, ...]:
        """Types of message that topics are chosen by where it names none."""
        joints = (JOINTS,) if self.joint_states is None else ()
        poses = POSES if self.reference is not None and self.reference.topic is None else ()
        sensors = [usual_type(name) for name, one in self.sensors.items() if not one.topics]
        return tuple(dict.fromkeys((*joints, *poses, *(kind for kinds in sensors for kind in kinds))))

    def sensor_issues(self, measurement: Measurement | None) -> list[Issue]:
        """Sensors that the study has not, numbers of topics and units that do not fit."""
        nowhere = self.poses == "none" and not self.sensors
        text = "nothing says where the robot was: name a sensor that does under `sensors`"
        own = [Issue(("log", "poses"), text)] if nowhere else []
        return [*own, *source_issues(self.sensors, measurement)]

    def sensed(self, file: Path, logs: list[Log], measurement: Measurement | None) -> list[Log]:
        """The drive with what sensors beside the poses read.

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
        own = (self.inputs, self.joint_states, self.commands, self.clock, self.skip_invalid_rows)
        with open_bag(file) as bag:
            inputs = BagReading(bag, model, *own, None if self.reference is None else self.reference.topic)
            (turned, said), (quantities, poses) = together([inputs.read, lambda: self._poses(bag, inputs)])
        drive = _drive(file, model, turned, poses, quantities)
        held = "keep" if self.reference is None else self.reference.held
        return to_logs([drive.with_found(*said)], self, held)

    @property
    def reference(self) -> PoseTopic | None:
        """The topic of the reference poses, None where there are none."""
        return self.poses if isinstance(self.poses, PoseTopic) else None

    def _poses(self, bag: Bag, inputs: BagReading) -> tuple[tuple[str, ...], Series | None]:
        reference = self.reference
        if reference is None:
            return (), None
        own = inputs.odometry if self._alike(reference) else set()
        topic = reference.found(bag, own)
        if topic in own:
            text = f"{topic} is the robot's own odometry, which its inputs are; the reference is another"
            raise bag.issue("poses", text, "poses", "topic")
        series = reference.read(bag, topic, self.clock, skip=self.skip_invalid_rows)
        return reference.quantities(bag, topic), series

    def _alike(self, reference: PoseTopic) -> bool:
        # Transforms of one topic may be those of odometry, and of others the reference.
        if not isinstance(self.inputs, OdometryTopic):
            return True
        return (self.inputs.frame, self.inputs.child) == (reference.frame, reference.child)


def _drive(
    file: Path, model: System, inputs: list[Reading], poses: Series | None, quantities: tuple[str, ...]
) -> RecordedDrive:
    times, values = on_one_clock([(series.times, turned.integral) for series, turned in inputs])
    if not len(times):
        text = "the inputs were logged one after the other, not at the same time"
        raise LogError.about(file, text, "inputs")
    first = inputs[0][0]
    lines = first.lines[np.clip(np.searchsorted(first.times, times), 0, len(first) - 1)]
    skipped = {line for series, _ in inputs for line in series.skipped}
    arrived = {line for series, _ in inputs for line in series.lines.tolist()} | skipped
    wraps = sum(turned.wraps for _, turned in inputs)
    integrals = replace(
        first, times=times, values=values, lines=lines, skipped=tuple(skipped), arrived=len(arrived)
    )
    text = f"angles began anew {wraps} times; unwrapped"
    return RecordedDrive(
        name=file.stem,
        names=model.input_names,
        inputs=integrals,
        # Without poses the times alone, until those of other sensors are known.
        poses=integrals.with_values(np.zeros((len(times), 0))) if poses is None else poses,
        quantities=quantities,
        driving=np.array([entry.drives for entry in model.inputs]),
        bridged=np.array([turned.bridges for _, turned in inputs]),
        one_clock=False,
        found=(Finding("counter_wrapped", text),) if wraps else (),
    )
