"""A robot's inputs read from a ROS bag, by what the study says of them and what the bag has."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property, partial

from oed.foundation.errors import LogError
from oed.foundation.text import did_you_mean
from oed.kernel.dynamics.system import Input, System
from oed.logs.bag import JOINTS, POSES, Bag, Clock, Joints, read_joints, read_poses
from oed.logs.bag_fields import read_fields
from oed.logs.bag_inputs import ODOMETRY, BagInput, OdometryTopic, meant, source_of
from oed.logs.input_forms import InputForm, rims
from oed.logs.integrals import Turned
from oed.logs.log import Finding
from oed.logs.odometry import rolled
from oed.logs.series import Series, together

Reading = tuple[Series, Turned]


@dataclass
class BagReading:
    """The inputs of a robot in an open bag.

    Attributes:
        bag: open.
        model: the robot.
        given: what the study says of its inputs.
        joint_states: topic of the joints, where it is given.
        commands: topic of the commands, where it is given.
        clock: that of the messages' headers, or of their recording.
        skip: whether messages without finite numbers are left out instead of refused.
        reference: topic of the reference, where it is given.
    """

    bag: Bag
    model: System
    given: dict[str, BagInput] | OdometryTopic
    joint_states: str | None
    commands: str | None
    clock: Clock
    skip: bool
    reference: str | None

    def read(self) -> tuple[list[Reading], tuple[Finding, ...]]:
        """Each input's messages and time integral, and what is to be said of them.

        Raises:
            LogError: every mistake in them.
        """
        if isinstance(self.given, OdometryTopic):
            return self._odometry(self.given)
        found = together(partial(self._input, entry) for entry in self.model.inputs)
        forms = zip(self.model.inputs, (form for _, _, form in found), strict=True)
        by_rim = rims(forms, self.model)
        wild = [finding for _, turned, _ in found for finding in turned.found]
        said = tuple(wild if by_rim is None else [*wild, by_rim])
        return [(series, turned) for series, turned, _ in found], said

    @cached_property
    def odometry(self) -> set[str]:
        """Topics of which the inputs are read, and which have poses, too: the robot's own odometry."""
        if isinstance(self.given, OdometryTopic):
            return {self.given.topic}
        topics = {self._place(entry)[0] or "" for entry in self.model.inputs}
        return {topic for topic in topics if self.bag.types.get(topic) in POSES}

    def _odometry(self, given: OdometryTopic) -> tuple[list[Reading], tuple[Finding, ...]]:
        topic = self.bag.topic(given.topic, POSES, "inputs", "inputs", "topic")
        own = (given.frame, given.child)
        poses = read_poses(self.bag, topic, self.clock, *own, key="inputs", skip=self.skip)
        issues = poses.clock_issues()
        if issues:
            raise LogError(issues)
        poses = poses.without_slips()
        turned, said = rolled(poses, self.model)
        return [(poses, one) for one in turned], said

    def _input(self, entry: Input) -> tuple[Series, Turned, InputForm]:
        given, label = self._of(entry), entry.name
        topic, path, usual = self._place(entry)
        if topic is None:
            series, form, label = self._joint(entry)
        else:
            if path is None:
                text = f"{self.bag.types[topic]} has no {entry.name} by itself; say in which `field` it is"
                raise self.bag.issue(entry.name, text, "inputs", entry.name)
            series = read_fields(self.bag, topic, [path], self.clock, "inputs", entry.name)
            form = given.made(given.form or ("speed" if entry.drives else "value"), **usual)
        key, reason = form.reason_against(entry, self.model.lever(entry))
        if reason:
            raise self.bag.issue(entry.name, reason, "inputs", entry.name, key)
        series = series.finite(self.skip).without_repeats()
        turned = form.turned(series, 0, entry, self.model.lever(entry), label)
        issues = [*series.clock_issues(), *turned.issues]
        if issues:
            raise LogError(issues)
        return series, turned, form

    def _of(self, entry: Input) -> BagInput:
        assert isinstance(self.given, dict)
        return self.given.get(entry.name) or BagInput()

    def _place(self, entry: Input) -> tuple[str | None, str | None, dict[str, object]]:
        # Topic (None for a joint), path of the field, and what is usual of its form.
        given, known = self._of(entry), meant(entry, self.model)
        joints = self.joint_states is not None or JOINTS in self.bag.types.values()
        source = source_of(given, known, self.commands, joints)
        if source == "joint_states":
            return None, None, {}
        if given.topic is not None:
            topic = self.bag.any_topic(given.topic, entry.name, "inputs", entry.name, "topic")
        else:
            topic = self._commands(known)
        place = known.get(self.bag.types[topic])
        if given.field is not None or place is None:
            return topic, given.field, {"held": "between"}
        unit = {} if place.unit is None else {"unit": place.unit}
        return topic, place.path, {"held": place.held, **unit}

    def _commands(self, known: Collection[str]) -> str:
        find = partial(self.bag.topic, self.commands)
        plain = [kind for kind in known if kind != ODOMETRY]
        if self.commands is not None or any(kind in plain for kind in self.bag.types.values()):
            return find(list(known) if self.commands else plain, "commands", "commands")
        return find(list(known), "commands", "commands", taken=[self.reference or ""])

    @cached_property
    def _joints(self) -> Joints:
        topic = self.bag.topic(self.joint_states, (JOINTS,), "joint_states")
        joints = read_joints(self.bag, topic, self.clock)
        if not joints.names:
            raise self.bag.issue(topic, "no joint states")
        return joints

    def _free(self, joints: Joints) -> tuple[str, ...]:
        # Those that the study does not name as other inputs'.
        assert isinstance(self.given, dict)
        taken = {one.joint for one in self.given.values()}
        return tuple(name for name in joints.names if name not in taken)

    def _joint(self, entry: Input) -> tuple[Series, InputForm, str]:
        given, joints = self._of(entry), self._joints
        name = given.joint or _named_like(entry.name, self._free(joints))
        if name not in joints.names:
            hint = (name and did_you_mean(name, joints.names)) or ";"
            missing = f"no joint {name}" if name else "it is not clear which joint this is"
            text = f"{missing}{hint} the bag has {', '.join(joints.names)}"
            raise self.bag.issue(entry.name, text, "inputs", entry.name, "joint")
        usual = "speed" if entry.drives and name not in joints.positions else "angle"
        form = given.form or (usual if entry.drives else "value")
        series = (joints.speeds if form == "speed" else joints.positions).get(name)
        if series is None:
            text = f"the joint {name} has no {'speeds' if form == 'speed' else 'positions'} in the bag"
            raise self.bag.issue(entry.name, text, "inputs", entry.name, "form")
        made = given.made(form, held="between", cumulative=True)
        return series, made, str(given.joint or entry.name)


def _named_like(name: str, joints: tuple[str, ...]) -> str:
    # The words by which the robot's inputs differ are in the names of its joints.
    words = set(name.split("_")) - {"wheel", "speed", "angle"}
    fitting = [joint for joint in joints if words <= set(re.split(r"[\W_]+", joint.lower()))]
    return fitting[0] if len(fitting) == 1 else ""
