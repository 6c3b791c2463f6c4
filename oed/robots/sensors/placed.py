"""Sensors that sit somewhere on the robot, what is known of the pose that a drive begins in, and distances to
beacons.
"""

from __future__ import annotations

from typing import Annotated, Literal

import casadi as ca
from pydantic import Field, model_validator

from oed.foundation.component import Component
from oed.foundation.quantities import Angle, Length
from oed.foundation.text import count, given_text, listing
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.measurement import Nuisance
from oed.kernel.measurement.sensor import Moment, Sensor, Start

NEAREST = 1e-3
"""Distance [m] at which a range is rounded off, so that it has derivatives at the beacon itself."""
MOST_PLACES = 6
"""Beacons beyond which they are counted, not listed."""


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
    if isinstance(initial_pose, PosePrior):
        return {"m": initial_pose.position, "rad": initial_pose.heading}
    return initial_pose


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
        if self.known and self.deviation is not None:
            raise ValueError("a deviation belongs to a lever arm that is estimated: add known: false")
        return self


class PlacedSensor(Sensor):
    """A sensor that follows a point of the robot.

    Attributes:
        initial_pose: "unknown" (eliminated), "known", or the standard deviations of a prior.
        lever_arm: where on the robot that point is.
    """

    initial_pose: InitialPose = "unknown"
    lever_arm: LeverArm = LeverArm()

    @property
    def start_known(self) -> Start:
        """What is known of the initial pose."""
        return start_of(self.initial_pose)

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The lever arm's coordinates, where they are not known."""
        arm = self.lever_arm
        if arm.known:
            return ()
        return (
            Nuisance("lever_arm.x", arm.x, "m", arm.deviation),
            Nuisance("lever_arm.y", arm.y, "m", arm.deviation),
        )

    @property
    def remark(self) -> str:
        """Where the point is, unless it is the robot's origin."""
        place = place_text(self.lever_arm.x, self.lever_arm.y)
        return f", taken {place}" if place else ""

    def position(self, moment: Moment) -> tuple[Expression, Expression]:
        """Where the point is: x, y [m]."""
        ahead = moment.nuisances.get("lever_arm.x", self.lever_arm.x)
        left = moment.nuisances.get("lever_arm.y", self.lever_arm.y)
        x, y, heading = moment.state[0], moment.state[1], moment.state[2]
        cosine, sine = ca.cos(heading), ca.sin(heading)
        return x + ahead * cosine - left * sine, y + ahead * sine + left * cosine


class Ranges(PlacedSensor):
    """Distances [m] from a point of the robot to every beacon.

    Attributes:
        beacons: their positions x, y [m].
        noise: standard deviation of one distance [m].
    """

    kind: Literal["ranges"] = "ranges"
    beacons: Annotated[tuple[tuple[Length, Length], ...], Field(min_length=1)]
    noise: Annotated[Length, Field(gt=0)]

    def reading(self, moment: Moment) -> Expression:
        """One distance per beacon."""
        x, y = self.position(moment)
        squares = [(x - beacon_x) ** 2 + (y - beacon_y) ** 2 for beacon_x, beacon_y in self.beacons]
        return ca.vertcat(*(ca.sqrt(square + NEAREST**2) for square in squares))

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma for every beacon."""
        return ca.SX.eye(len(self.beacons)) / self.noise

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of every distance."""
        return ("m",) * len(self.beacons)

    @property
    def subject(self) -> str:
        """The distances, to beacons at their places."""
        places = [f"({x:g}, {y:g}) m" for x, y in self.beacons]
        return f"{self._distances}{f' at {listing(places)}' if len(places) <= MOST_PLACES else ''}"

    @property
    def _distances(self) -> str:
        return f"the distances to {count(len(self.beacons), 'beacon')}"

    def brief(self, samples: int) -> str:
        """The distances, and how often."""
        return f"{self._distances} at {count(len(self.columns(samples)), 'time')}"
