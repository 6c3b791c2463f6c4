"""Where on the robot a sensor sits, how it is turned, and what is known of that: its mounting."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, ClassVar

import casadi as ca
from pydantic import Field, model_validator

from oed.foundation.component import Component
from oed.foundation.quantities import Angle, Length
from oed.foundation.text import given_text, listing
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.sensor import Moment
from oed.robots.sensors.prior import PosePrior

PLACE: Mapping[str, str] = {"sensor_x": "m", "sensor_y": "m", "sensor_heading": "rad"}
"""What a mounting consists of, as estimates name it, with SI units: ahead of the robot's origin and to its
left, and how the sensor is turned."""
Pose = tuple[Expression, Expression, Expression]


def place_text(ahead: float, left: float) -> str:
    """`10 cm ahead of and 2 cm to the left of the robot's origin` [m]; "" of the origin itself."""
    sides = ((ahead, "ahead of", "behind"), (left, "to the left of", "to the right of"))
    parts = [
        f"{given_text(abs(offset), 'm')} {plus if offset > 0 else minus}"
        for offset, plus, minus in sides
        if offset
    ]
    return f"{listing(parts)} the robot's origin" if parts else ""


class Mount(Component):
    """Where on the robot a sensor sits: ahead of its origin, and to the left [m].

    With `known: false` the mounting is a nuisance; deviations are standard deviations of its prior.
    """

    names: ClassVar[tuple[str, ...]]
    """Of its nuisances, in the order of `PLACE`, as far as it has them."""
    x: Length = 0.0
    y: Length = 0.0
    known: bool = True

    @model_validator(mode="after")
    def _deviation_of_what_is_unknown(self) -> Mount:
        if self.known and any(value is not None for name, value in self if name.endswith("deviation")):
            raise ValueError(
                "a deviation belongs to a mounting that is estimated: omit it, or add known: false"
            )
        return self

    @property
    def sits(self) -> tuple[float, float, float]:
        """Ahead, to the left [m], turned to the left [rad]."""
        return self.x, self.y, 0.0

    @property
    @abstractmethod
    def deviations(self) -> dict[str, float]:
        """Standard deviations of what is known of it beforehand, by the names of `PLACE` [m, rad]."""

    @property
    def fixed(self) -> bool:
        """Whether ahead and to the left are known, and not to be estimated from logs."""
        return self.known

    @property
    def heading_fixed(self) -> bool:
        """Whether the angle is known, and not to be estimated from logs."""
        return self.known

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """What is not known of it."""
        if self.known:
            return ()
        each = zip(self.names, self.sits, PLACE.items(), strict=False)
        return tuple(
            Nuisance(name, value, unit, self.deviations.get(place)) for name, value, (place, unit) in each
        )

    def pose(self, robot: Pose, moment: Moment) -> Pose:
        """Of the sensor x, y [m], heading [rad], with the moment's nuisances, on a robot at a pose."""
        own = zip(self.names, self.sits, strict=False)
        ahead, left, *turned = (moment.nuisances.get(name, value) for name, value in own)
        x, y, heading = robot
        cosine, sine = ca.cos(heading), ca.sin(heading)
        return x + ahead * cosine - left * sine, y + ahead * sine + left * cosine, heading + sum(turned)


class LeverArm(Mount):
    """Of a sensor that reads a point of the robot.

    Attributes:
        deviation: standard deviation of its coordinates [m].
    """

    names: ClassVar = ("lever_arm.x", "lever_arm.y")
    deviation: Annotated[Length, Field(gt=0)] | None = None

    @property
    def deviations(self) -> dict[str, float]:
        """`deviation`, of both coordinates [m]."""
        return {} if self.deviation is None else dict.fromkeys(("sensor_x", "sensor_y"), self.deviation)

    @property
    def fixed(self) -> bool:
        """An arm of 0 is one that nobody gave: a sensor seldom sits where it should."""
        return self.known and bool(self.x or self.y)

    @property
    def heading_fixed(self) -> bool:
        """Never: it is not given."""
        return False


class Turned(Mount):
    """Of a sensor that looks somewhere.

    Attributes:
        heading: by how much it is turned to the left [rad].
    """

    heading: Angle = 0.0

    @property
    def sits(self) -> tuple[float, float, float]:
        """Ahead, to the left [m], turned to the left [rad]."""
        return self.x, self.y, self.heading


class CameraArm(Turned):
    """Of a camera, or of what else sees points of the room.

    Attributes:
        deviation: standard deviation of its coordinates [m].
        heading_deviation: of its heading [rad].
    """

    names: ClassVar = ("lever_arm.x", "lever_arm.y", "lever_arm.heading")
    deviation: Annotated[Length, Field(gt=0)] | None = None
    heading_deviation: Annotated[Angle, Field(gt=0)] | None = None

    @property
    def deviations(self) -> dict[str, float]:
        """`deviation`, of both coordinates [m], and `heading_deviation` [rad]."""
        each = zip(PLACE, (self.deviation, self.deviation, self.heading_deviation), strict=True)
        return {name: size for name, size in each if size is not None}


class Mounting(Turned):
    """Of a sensor that reads how itself has moved; estimated along with the parameters unless it is known.

    Attributes:
        deviation: standard deviations of what is known of it beforehand.
    """

    names: ClassVar = tuple(PLACE)
    known: bool = False
    deviation: PosePrior | None = None

    @property
    def deviations(self) -> dict[str, float]:
        """Of the prior [m, rad]."""
        known = self.deviation
        return {} if known is None else {name: known.of(unit) for name, unit in PLACE.items()}
