"""Landmarks and tags as a camera, a radar or a lidar sees them: ranges, bearings, orientations."""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from typing import Annotated, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.quantities import Angle, Length
from oed.foundation.text import count, given_text, listing
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.description import deviations_text
from oed.kernel.measurement.sensor import Moment
from oed.robots.sensors.mapped import NEAREST, LengthMap, MappedSensor, distance
from oed.robots.sensors.mounting import CameraArm
from oed.robots.sensors.prior import PosePrior

UNITS = {"range": "m", "bearing": "rad", "orientation": "rad"}
"""SI units of what is seen."""
USUAL = {"range": "3 cm", "bearing": "1 deg", "orientation": "2 deg"}
"""Usual noise, for examples."""
Point = tuple[Length, Length]
Tag = tuple[Length, Length, Angle]
Id = int | str


class SightNoise(Component):
    """Standard deviations of what is seen of one point.

    Attributes:
        range: [m].
        bearing: [rad].
        orientation: [rad].
        centre: how well the point itself is met, across the line of sight [m]: seen from nearby it makes a
            larger angle, sqrt(bearing^2 + (centre / distance)^2).
    """

    range: Annotated[Length, Field(gt=0)] | None = None
    bearing: Annotated[Angle, Field(gt=0)] | None = None
    orientation: Annotated[Angle, Field(gt=0)] | None = None
    centre: Annotated[Length, Field(ge=0)] = 0.005

    def of(self, quantity: str) -> float | None:
        """The standard deviation of a quantity, SI; None where it is not given."""
        found: float | None = getattr(self, quantity)
        return found


class Sights(MappedSensor):
    """Points of the room, each seen from the robot: some of range, bearing, orientation, point by point."""

    quantities: tuple[str, ...]
    noise: SightNoise
    lever_arm: CameraArm = CameraArm()  # type: ignore[assignment]  # Another mounting.
    ids: tuple[Id, ...] | None = None

    @abstractmethod
    def _orientation(self, place: list[Expression], heading: Expression) -> Expression:
        """How far a point is turned to the left of the camera [rad], which looks along `heading`."""

    @property
    def labels(self) -> tuple[str, ...]:
        """The ids, or numbers from 1."""
        return super().labels if self.ids is None else tuple(map(str, self.ids))

    def reading(self, moment: Moment) -> Expression:
        """The quantities, point by point."""
        x, y, heading = self.sensor_pose(moment)
        cosine, sine = ca.cos(heading), ca.sin(heading)
        values = []
        for place in self.seen(moment):
            along, across = place[0] - x, place[1] - y
            square = along**2 + across**2
            # At the point itself every direction is as good as another.
            ahead = ca.if_else(square > 0, cosine * along + sine * across, NEAREST)
            read = {
                "range": distance(square),
                "bearing": ca.atan2(cosine * across - sine * along, ahead),
                "orientation": self._orientation(place, heading),
            }
            values += [read[name] for name in self.quantities]
        return ca.vertcat(*values)

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma of every entry; a bearing's is larger from nearby."""
        x, y = self.position(moment)
        weights = []
        for place in self.seen(moment):
            square = (place[0] - x) ** 2 + (place[1] - y) ** 2
            met = (self.noise.centre / distance(square)) ** 2 if self.noise.centre else 0.0
            for name in self.quantities:
                variance = (self.noise.of(name) or ca.inf) ** 2 + (met if name == "bearing" else 0.0)
                weights.append(1 / ca.sqrt(variance))
        return ca.SX(ca.diag(ca.vertcat(*weights)))

    @property
    def angles(self) -> tuple[int, ...]:
        """Bearings and orientations."""
        return tuple(place for place, unit in enumerate(self.units) if unit == "rad")

    @property
    def wrapping(self) -> tuple[int, ...]:
        """All of these."""
        return self.angles

    @property
    def units(self) -> tuple[str, ...]:
        """The quantities', point by point."""
        return tuple(UNITS[name] for name in self.quantities) * len(self.places)

    @property
    def entries(self) -> tuple[str, ...]:
        """The quantities and of which point, as `.range[7]`."""
        return tuple(f".{name}[{label}]" for label in self.labels for name in self.quantities)

    @property
    def deviations(self) -> tuple[float, ...]:
        """Those from far away."""
        return tuple(self.noise.of(name) or 0.0 for name in self.quantities) * len(self.places)

    @property
    def subject(self) -> str:
        """The quantities, and of which points."""
        return f"the {listing([f'{name}s' for name in self.quantities])} of {self._points}"

    @property
    def noise_text(self) -> str:
        """Quantity by quantity, and what is added from nearby."""
        sizes = [
            f"{given_text(self.noise.of(name) or 0.0, UNITS[name])} in {name}" for name in self.quantities
        ]
        near = "bearing" in self.quantities and self.noise.centre
        more = f", the point met to {given_text(self.noise.centre, 'm')} across" if near else ""
        return f"{deviations_text(*sizes)}{more}"

    def brief(self, samples: int) -> str:
        """What is seen, and how often."""
        seen = f"the {listing([f'{name}s' for name in self.quantities])} of"
        times = count(len(self.columns(samples)), "time")
        return f"{seen} {count(len(self.places), self.point)} at {times}"

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Quantities without noise or listed twice, ids or places that do not tell the points apart."""
        issues = (
            super().issues(system, samples) if self.ids is None or len(self.ids) == len(self.places) else []
        )
        if len(set(self.quantities)) < len(self.quantities):
            issues.append(Issue(("measurement", "quantities"), "a quantity is listed twice"))
        missing = [name for name in self.quantities if self.noise.of(name) is None]
        if missing:
            example = ", ".join(f"{name}: {USUAL[name]}" for name in missing)
            text = f"the noise of {listing(missing)} is needed to weight the readings: noise: {{{example}}}"
            issues.append(Issue(("measurement", "noise"), text))
        if self.ids is not None and len(self.ids) != len(self.places):
            text = (
                f"expected one id for each of the {count(len(self.places), self.point)}, got {len(self.ids)}"
            )
            issues.append(Issue(("measurement", "ids"), text))
        twice = sorted(label for label, times in Counter(self.labels).items() if times > 1)
        if twice:
            issues.append(Issue(("measurement", "ids"), f"the id {listing(twice)} is listed twice"))
        return issues


class Landmarks(Sights):
    """Landmarks seen from the robot: their distance and direction.

    Attributes:
        landmarks: their places x, y [m].
        ids: what logs call them; numbers from 1 by default.
        quantities: range [m], bearing to the left of where the sensor looks [rad], or both.
        noise: of one landmark.
        map: of the landmarks: "known", "unknown", or the standard deviation of their coordinates [m].
        lever_arm: where on the robot the sensor sits, and where it looks.
    """

    kind: Literal["landmarks"] = "landmarks"
    point = "landmark"
    landmarks: Annotated[tuple[Point, ...], Field(min_length=1)]
    quantities: Annotated[tuple[Literal["range", "bearing"], ...], Field(min_length=1)] = ("range", "bearing")
    noise: SightNoise = SightNoise()
    map: LengthMap = "known"

    @property
    def places(self) -> tuple[tuple[float, ...], ...]:
        """Of the landmarks."""
        return self.landmarks

    def _orientation(self, place: list[Expression], heading: Expression) -> Expression:
        return ca.SX(0)


class Tags(Sights):
    """Tags (AprilTag, ArUco) seen from the robot: their distance, their direction and how they are turned.

    Attributes:
        tags: their poses x, y [m], heading [rad].
        ids: what logs call them; numbers from 1 by default.
        quantities: some of range [m], bearing to the left of where the camera looks [rad] and orientation,
            how far the tag is turned to the left of it [rad].
        noise: of one tag.
        map: of the tags: "known", "unknown", or standard deviations {position, heading} of their poses.
        lever_arm: where on the robot the camera sits, and where it looks.
    """

    kind: Literal["tags"] = "tags"
    point = "tag"
    tags: Annotated[tuple[Tag, ...], Field(min_length=1)]
    quantities: Annotated[tuple[Literal["range", "bearing", "orientation"], ...], Field(min_length=1)] = (
        "range",
        "bearing",
        "orientation",
    )
    noise: SightNoise = SightNoise()
    map: Literal["known", "unknown"] | PosePrior = "known"

    @property
    def places(self) -> tuple[tuple[float, ...], ...]:
        """Of the tags."""
        return self.tags

    def _orientation(self, place: list[Expression], heading: Expression) -> Expression:
        return place[2] - heading
