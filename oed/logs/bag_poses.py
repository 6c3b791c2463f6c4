"""The reference poses in a ROS bag: of messages that have poses, or fields of any others."""

from __future__ import annotations

from collections.abc import Collection

from pydantic import Field

from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.logs.bag import IMU, POSES, Bag, Clock, planar, read_poses
from oed.logs.bag_fields import AnyNumberField, NumberField, read_fields
from oed.logs.form import Repeats
from oed.logs.input_forms import unit_factor, unit_reason
from oed.logs.odometry import UNITS
from oed.logs.series import Series


class PoseTopic(Component):
    """The topic of the reference poses.

    Attributes:
        topic: of odometry, poses or transforms, or of an Imu, whose orientation has a heading; the only one
            of odometry, poses or transforms by default.
        frame, child: which of its poses, where it has several.
        x, y, heading: fields of the messages of any topic, instead, the heading also one with a quaternion;
            what is not given was not measured.
        held: "drop" poses that repeat the one before while the wheels turn, or "keep" them.
    """

    topic: str | None = None
    frame: str | None = None
    child: str | None = None
    x: AnyNumberField | None = None
    y: AnyNumberField | None = None
    heading: AnyNumberField | None = None
    held: Repeats = Field("drop")

    @property
    def fields(self) -> dict[str, NumberField]:
        """Those that are given, the heading last."""
        return {name: one for name in UNITS if (one := getattr(self, name)) is not None}

    def issues(self) -> list[Issue]:
        """Fields without a topic, or with a choice of poses; units of another kind."""
        place, given = ("log", "poses"), self.fields
        if given and self.topic is None:
            return [Issue(place, f"{', '.join(given)}: fields of which topic's messages? give `topic`, too")]
        if given and (self.frame, self.child) != (None, None):
            return [Issue(place, "`frame` and `child` choose among poses, not among messages with fields")]
        reasons = {name: unit_reason(one.unit, UNITS[name]) for name, one in given.items()}
        return [Issue((*place, name, "unit"), text) for name, text in reasons.items() if text]

    def found(self, bag: Bag, taken: Collection[str]) -> str:
        """The topic.

        Args:
            bag: open.
            taken: topics that are the robot's odometry.

        Raises:
            LogError: there is none, or several, or it has messages of another type.
        """
        if self.topic is not None and self.fields:
            return bag.any_topic(self.topic, "poses", "poses", "topic")
        return bag.topic(self.topic, POSES if self.topic is None else (*POSES, IMU), "poses", taken=taken)

    def quantities(self, bag: Bag, topic: str) -> tuple[str, ...]:
        """What is measured."""
        if self.fields:
            return tuple(self.fields)
        return ("heading",) if bag.types[topic] == IMU else tuple(UNITS)

    def read(self, bag: Bag, topic: str, clock: Clock, *, skip: bool) -> Series:
        """What is measured, SI.

        Args:
            bag: open.
            topic: that was found.
            clock: that of the messages' headers, or of their recording.
            skip: whether messages without finite numbers are left out instead of refused.

        Raises:
            LogError: no messages, no such fields, numbers that are none.
        """
        given = self.fields
        if not given:
            poses = read_poses(bag, topic, clock, self.frame, self.child, skip=skip)
            return poses if bag.types[topic] != IMU else poses.with_values(poses.values[:, 2:])
        paths = [one.field for one in given.values()]
        series = read_fields(bag, topic, paths, clock, "poses", turned="heading" in given).finite(skip)
        series = series.without_repeats()
        if series.values.shape[1] > len(given):
            series = planar(series)
        return series.with_values(
            series.values * [unit_factor(one.unit, UNITS[name]) for name, one in given.items()]
        )
