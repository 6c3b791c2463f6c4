"""Sensors that sit somewhere on the robot and are read of its pose."""

from __future__ import annotations

from typing import Annotated, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.quantities import Duration
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.sensor import Moment, Start
from oed.robots.models.arcs import chord
from oed.robots.sensors.drift import DriftingSensor
from oed.robots.sensors.mounting import LeverArm, Pose, place_text
from oed.robots.sensors.prior import InitialPose, known_to, start_of


class PlacedSensor(DriftingSensor):
    """A sensor that follows a point of the robot.

    Attributes:
        initial_pose: "unknown" (eliminated), "known", "resting" (unknown, at rest), or
            the standard deviations of a prior.
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
        late = known_to(self.latency)
        own = () if late is None else (Nuisance("latency", 0.0, "s", late.get("")),)
        return (*self.lever_arm.nuisances, *own)

    @property
    def remark(self) -> str:
        """Where the point is, unless it is the robot's origin."""
        place = place_text(self.lever_arm.x, self.lever_arm.y)
        late = "" if self.latency == "known" else ", by a time later that is not known"
        return (f", taken {place}" if place else "") + late + self.drift_remark

    def pose(self, moment: Moment) -> Pose:
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

    def sensor_pose(self, moment: Moment) -> Pose:
        """The sensor's own pose then: x, y [m], heading [rad]."""
        return self.lever_arm.pose(self.pose(moment), moment)

    def position(self, moment: Moment) -> tuple[Expression, Expression]:
        """Where the point is: x, y [m]."""
        return self.sensor_pose(moment)[:2]
