"""Sensors that sit somewhere on the robot, and what is known of the pose that a drive begins in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import casadi as ca
from pydantic import Field, model_validator

from oed.foundation.component import Component
from oed.foundation.quantities import Angle, Duration, Length
from oed.foundation.text import given_text, listing
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.measurement import Nuisance
from oed.kernel.measurement.sensor import Moment, Sensor, Start
from oed.robots.models.arcs import chord


def place_text(ahead: float, left: float) -> str:
    """`10 cm ahead of and 2 cm to the left of the robot's origin` [m]; "" of the origin itself."""
    sides = ((ahead, "ahead of", "behind"), (left, "to the left of", "to the right of"))
    parts = [
        f"{given_text(abs(offset), 'm')} {plus if offset > 0 else minus}"
        for offset, plus, minus in sides
        if offset
    ]
    return f"{listing(parts)} the robot's origin" if parts else ""


class PosePrior(Component):
    """A prior of the initial pose: standard deviations [m, rad].

    `heading` is that of a trailer's angle as well; of a yaw rate that lags nothing is taken to be known.
    """

    position: Annotated[Length, Field(gt=0)]
    heading: Annotated[Angle, Field(gt=0)]


InitialPose = Literal["unknown", "known"] | PosePrior


def start_of(initial_pose: InitialPose) -> Start:
    """What is known of the states that a drive begins in, as the kernel asks for it."""
    return (known_to(initial_pose) or {}) if isinstance(initial_pose, PosePrior) else initial_pose


def known_to(given: str | float | PosePrior) -> Mapping[str, float] | None:
    """Standard deviations of the prior of a constant, by their units ("" for any); {} where it is unknown,
    None where it is known and no nuisance.
    """
    if given == "known":
        return None
    if isinstance(given, PosePrior):
        return {"m": given.position, "rad": given.heading}
    return {"": given} if isinstance(given, float) else {}


class LeverArm(Component):
    """Where on the robot a sensor sits: ahead of its origin, and to the left [m].

    With `known: false` the place is a nuisance; `deviation` is the standard deviation of its prior.
    """

    x: Length = 0.0
    y: Length = 0.0
    known: bool = True
    deviation: Annotated[Length, Field(gt=0)] | None = None

    @model_validator(mode="after")
    def _deviation_of_what_is_unknown(self) -> LeverArm:
        if self.known and any(value is not None for name, value in self if name.endswith("deviation")):
            raise ValueError("a deviation belongs to a lever arm that is estimated: add known: false")
        return self

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """Its coordinates."""
        return (
            Nuisance("lever_arm.x", self.x, "m", self.deviation),
            Nuisance("lever_arm.y", self.y, "m", self.deviation),
        )


class PlacedSensor(Sensor):
    """A sensor that follows a point of the robot.

    Attributes:
        initial_pose: "unknown" (eliminated), "known", or the standard deviations of a prior.
        lever_arm: where on the robot that point is.
        latency: by how much later than it says a reading is taken of the robot: "known" (none), "unknown"
            (eliminated), or the standard deviation of its prior [s]. In logs whose poses are on a clock of
            their own it is the offset of that clock.
    """

    initial_pose: InitialPose = "unknown"
    lever_arm: LeverArm = LeverArm()
    latency: Literal["known", "unknown"] | Annotated[Duration, Field(gt=0)] = "known"

    @property
    def start_known(self) -> Start:
        """What is known of the initial pose."""
        return start_of(self.initial_pose)

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The lever arm's coordinates and the latency, where they are not known."""
        arm, late = self.lever_arm, known_to(self.latency)
        places = () if arm.known else arm.nuisances
        return (*places, *(() if late is None else (Nuisance("latency", 0.0, "s", late.get("")),)))

    @property
    def remark(self) -> str:
        """Where the point is, unless it is the robot's origin."""
        place = place_text(self.lever_arm.x, self.lever_arm.y)
        late = "" if self.latency == "known" else ", by a time later that is not known"
        return (f", taken {place}" if place else "") + late

    def pose(self, moment: Moment) -> tuple[Expression, Expression, Expression]:
        """The robot's pose x, y [m], heading [rad] that is read: as long ago as the latency, on the arc of
        the moment's twist.
        """
        x, y, heading = moment.state[0], moment.state[1], moment.state[2]
        if "latency" not in moment.nuisances:
            return x, y, heading
        back, twist = -moment.nuisances["latency"], moment.signals["twist"]
        gain, direction = chord(twist[2], heading, back, "arc")
        cosine, sine = ca.cos(direction), ca.sin(direction)
        return (
            x + gain * (cosine * twist[0] - sine * twist[1]),
            y + gain * (sine * twist[0] + cosine * twist[1]),
            heading + back * twist[2],
        )

    def position(self, moment: Moment) -> tuple[Expression, Expression]:
        """Where the point is: x, y [m]."""
        ahead = moment.nuisances.get("lever_arm.x", self.lever_arm.x)
        left = moment.nuisances.get("lever_arm.y", self.lever_arm.y)
        x, y, heading = self.pose(moment)
        cosine, sine = ca.cos(heading), ca.sin(heading)
        return x + ahead * cosine - left * sine, y + ahead * sine + left * cosine
