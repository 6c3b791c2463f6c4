"""A robot's inputs in a ROS bag: joints, commands, any field of any message, or odometry's poses."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.quantities import Length
from oed.kernel.dynamics.system import Input, System
from oed.logs.bag_fields import FieldPath
from oed.logs.input_forms import AngleForm, InputForm, SpeedForm, TicksForm
from oed.logs.integrals import Held
from oed.logs.odometry import odometry_issues
from oed.logs.tables.columns import Short

FORMS: dict[str, type[InputForm]] = {
    "speed": SpeedForm,
    "value": SpeedForm,
    "angle": AngleForm,
    "ticks": TicksForm,
}
OF_COUNTERS = ("ticks_per_turn", "gear", "cumulative", "zero")
"""Keys that only some forms have."""
ODOMETRY = "nav_msgs/msg/Odometry"
TWISTS = {
    "geometry_msgs/msg/Twist": "",
    "geometry_msgs/msg/TwistStamped": "twist.",
    "geometry_msgs/msg/TwistWithCovarianceStamped": "twist.twist.",
    ODOMETRY: "twist.twist.",
}
"""Where messages have their twist."""
ACKERMANN = {
    "ackermann_msgs/msg/AckermannDrive": "",
    "ackermann_msgs/msg/AckermannDriveStamped": "drive.",
}
"""Where messages have the speed of a car's rear axle, and the angle of its virtual front wheel."""


@dataclass(frozen=True)
class Meant:
    """Where messages of a type have an input.

    Attributes:
        path: of the field.
        unit: it is in; SI where None.
        held: how it holds: commands until the next one, what was measured in straight lines.
    """

    path: str
    unit: str | None
    held: Held


def meant(entry: Input, model: System) -> dict[str, Meant]:
    """Where messages of each type have an input of a robot; nothing for one that has no such name."""
    twist = {"commanded_speed": "linear.x", "commanded_yaw_rate": "angular.z"}.get(entry.quantity)
    if twist is not None:
        held: dict[str, Held] = {ODOMETRY: "between"}
        return {
            kind: Meant(f"{prefix}{twist}", None, held.get(kind, "next")) for kind, prefix in TWISTS.items()
        }
    drive = {"wheel_speed": "speed", "steering_angle": "steering_angle"}.get(entry.quantity)
    if drive is None or not _drives_behind(model):
        return {}
    unit = "m/s" if drive == "speed" else None
    return {kind: Meant(f"{prefix}{drive}", unit, "next") for kind, prefix in ACKERMANN.items()}


def _drives_behind(model: System) -> bool:
    # Of a car whose rear wheels are driven the speed is no other for being steered: that of the rear axle.
    quantities = [entry.quantity for entry in model.inputs]
    if sorted(quantities) != ["steering_angle", "wheel_speed"]:
        return False
    speeds = [
        model.speed_of([1.0 if one == "wheel_speed" else angle for one in quantities]) for angle in (0.0, 0.3)
    ]
    return abs(speeds[1] - speeds[0]) <= 1e-9 * speeds[0]


class BagInput(Component):
    """One of the robot's inputs: a joint's, or a field of a topic's messages.

    Attributes:
        joint: its name in the joint states; by default the only joint that has the words of the input's
            name ("right", "left", "steering", ...).
        topic: of other messages than joint states.
        field: path of the number in these, such as "wheel.left.velocity" or "data[0]"; by default where
            messages of the topic's type have this input.
        form: from its "angle" (a wheel's, unwrapped), from its "speed" (a steered wheel's "value"), or from
            "ticks"; of a joint the angle where it is logged, of a field the speed. A joint's position is
            read as it is for a steering angle.
        sign: -1 where the joint turns the other way round.
        unit: SI by default; of a wheel also of its rim: "m/s", "mm", ...
        radius: of the wheel, where the unit is that of its rim; the robot's nominal one by default.
        wrap: full range where the angle, or the counter, begins anew.
        zero: what a steering encoder shows straight ahead.
        held: how speeds hold; "between" for straight lines between messages, "next" (of commands) until the
            next one, "previous" for means.
        ticks_per_turn, gear, cumulative: of ticks, as in tables.
    """

    joint: str | None = None
    topic: str | None = None
    field: FieldPath | None = None
    form: Literal["angle", "speed", "value", "ticks"] | None = None
    sign: Literal[1, -1] = 1
    unit: str | None = None
    radius: Annotated[Length, Field(gt=0)] | None = None
    wrap: Annotated[float, Field(gt=0)] | None = None
    zero: float = 0.0
    held: Held | None = None
    ticks_per_turn: Annotated[float, Field(gt=0)] | None = None
    gear: Annotated[float, Field(gt=0)] = 1.0
    cumulative: bool = False

    def made(self, form: str, **usual: Any) -> InputForm:
        """The form in which it is logged, with these values of keys that are not given."""
        kind = FORMS[form]
        given = {name: getattr(self, name) for name in kind.model_fields if name in self.model_fields_set}
        known = {name: value for name, value in usual.items() if name in kind.model_fields}
        return kind(**{**known, **given, "form": form})

    def issues(self, entry: Input, model: System) -> list[Issue]:
        """Keys that exclude each other, and forms and units that do not fit the input."""
        place = ("log", "inputs", entry.name)
        if self.joint is not None and self.topic is not None:
            return [Issue((*place, "joint"), "is one of joint states'; `topic` is of other messages")]
        if self.field is not None and self.topic is None:
            return [Issue((*place, "field"), "is one of which topic's messages? give `topic`, too")]
        form = self.form or ("speed" if entry.drives else "value")
        missing = [key for key in OF_COUNTERS if key in self.model_fields_set - set(FORMS[form].model_fields)]
        if missing:
            return [Issue((*place, missing[0]), f"is a key of form: ticks, and the form is {form}")]
        if form == "ticks" and self.ticks_per_turn is None:
            return [Issue((*place, "ticks_per_turn"), "is missing: how many ticks does a turn have?")]
        if self.form is None and self.topic is None:
            # Whether the joint's angle or its speed is read shows in the bag.
            return []
        key, reason = self.made(form).reason_against(entry, model.lever(entry))
        return [Issue((*place, key), reason)] if reason else []


class OdometryTopic(Component):
    """Poses that odometry has summed up: their increments are the robot's speed and yaw rate.

    Attributes:
        form: "poses".
        topic: of odometry, poses or transforms.
        frame, child: which of them, where the topic has several.
    """

    form: Literal["poses"]
    topic: str
    frame: str | None = None
    child: str | None = None

    def issues(self, model: System) -> list[Issue]:
        """A robot of other inputs."""
        return odometry_issues(model)


def source_of(
    given: BagInput, places: Collection[str], commands: str | None, joints: bool
) -> Literal["topic", "joint_states", "commands"]:
    """Where an input is read: a speed and a yaw rate are no joint's, and what no commands have is one's.

    Args:
        given: what the study says of it.
        places: types of the messages that have it, as `meant` knows.
        commands: topic of the commands, where it is given.
        joints: whether there are joint states.
    """
    if given.topic is not None:
        return "topic"
    if given.joint is not None or not places:
        return "joint_states"
    if commands is not None or ODOMETRY in places:
        return "commands"
    return "joint_states" if joints else "commands"


def _sort(value: Any) -> str:
    # No input of a robot is called form.
    form = value.get("form") if isinstance(value, Mapping) else getattr(value, "form", None)
    return "poses" if form == "poses" else "inputs"


AnyBagInputs = Annotated[
    Annotated[dict[str, Annotated[BagInput, Short("joint")]], Tag("inputs")]
    | Annotated[OdometryTopic, Tag("poses")],
    Discriminator(_sort),
]
"""A bag's key `inputs`: by the inputs' names, or odometry's poses."""
