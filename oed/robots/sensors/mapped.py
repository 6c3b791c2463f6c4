"""Sensors that see points of the room, whose places may be unknown; distances to beacons among them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue
from oed.foundation.quantities import Length
from oed.foundation.text import count, listing
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.sensor import Moment, Sensor
from oed.robots.sensors.placed import PlacedSensor
from oed.robots.sensors.prior import PosePrior, known_to

NEAREST = 1e-3
"""Distance [m] at which a range is rounded off, so that it has derivatives at the point itself."""
MOST_LISTED = 6
"""Points beyond which they are counted, not listed."""
MOST_PLACES = 5000
"""Points at most: a check of so many takes 0.2 GB, in proportion to their number."""
MOST_UNKNOWN = 200
"""Points at most whose places are unknown: the derivatives by their coordinates grow with the square."""
AXES = (("x", "m"), ("y", "m"), ("heading", "rad"))
"""What places consist of, with SI units."""

LengthMap = Literal["known", "unknown"] | Annotated[Length, Field(gt=0)]


class MappedSensor(PlacedSensor):
    """A sensor that sees points of the room.

    Attributes:
        map: whether the points' places are "known", "unknown" (eliminated; those given are what is designed
            for, and where a fit begins), or the standard deviation of their prior. With nothing else to say
            where it is, an unknown map is in the frame of the robot's first start.
    """

    point: ClassVar[str] = "point"
    map: LengthMap | PosePrior = "known"

    @property
    @abstractmethod
    def places(self) -> tuple[tuple[float, ...], ...]:
        """Nominal coordinates of every point: x, y [m], and of some their heading [rad]."""

    @property
    def labels(self) -> tuple[str, ...]:
        """What the points are called: numbers from 1."""
        return tuple(str(number + 1) for number in range(len(self.places)))

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The sensor's place, its latency, and the places of points that are not known."""
        known = known_to(self.map)
        if known is None:
            return super().nuisances
        return (
            *super().nuisances,
            *(
                Nuisance(f"{self.point}_{label}.{axis}", value, unit, known.get(unit, known.get("")))
                for label, place in zip(self.labels, self.places, strict=True)
                for value, (axis, unit) in zip(place, AXES, strict=False)
            ),
        )

    @property
    def gauge(self) -> tuple[str, ...]:
        """The pose, where neither it nor any point is known beforehand."""
        free = self.map == "unknown" and self.initial_pose in ("unknown", "resting")
        return tuple(axis for axis, _ in AXES) if free else ()

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Points that are too many, or where another one is."""
        most, which = (
            (MOST_PLACES, "") if self.map == "known" else (MOST_UNKNOWN, " whose places are not known")
        )
        if len(self.places) > most:
            text = f"expected at most {most} {self.point}s{which}, got {len(self.places)}"
            return [Issue(("measurement", f"{self.point}s"), text)]
        found, firsts, labels = [], dict[tuple[float, ...], int](), self.labels
        for number, place in enumerate(self.places):
            first = firsts.setdefault(place, number)
            if first < number:
                text = f"is where {self.point} {labels[first]} is; give each a place of its own"
                found.append(Issue(("measurement", f"{self.point}s", number), text))
        return found

    @property
    def frame(self) -> tuple[str, ...]:
        """Nuisances that define the frame where nothing else does, as many as it has directions: the place of
        the first point, and its heading or the direction in which the second is seen from it.
        """
        (first, *others), axes = self.places, [axis for axis, _ in AXES]
        own = [f"{self.point}_{self.labels[0]}.{axis}" for axis in axes[: len(first)]]
        if len(first) < len(AXES) and others:
            along = abs(others[0][0] - first[0]) > abs(others[0][1] - first[1])
            own.append(f"{self.point}_{self.labels[1]}.{'y' if along else 'x'}")
        return tuple(own)

    def seen(self, moment: Moment) -> list[list[Expression]]:
        """Coordinates of every point."""
        return [
            [
                moment.nuisances.get(f"{self.point}_{label}.{axis}", value)
                for value, (axis, _) in zip(place, AXES, strict=False)
            ]
            for label, place in zip(self.labels, self.places, strict=True)
        ]

    @property
    def _points(self) -> str:
        # `3 beacons at (3, 0) m, ...`
        return f"{count(len(self.places), self.point)}{_at(self.places)}"

    @property
    def remark(self) -> str:
        """Where the sensor is, and that the points' places are not known."""
        how = {"known": "", "unknown": "not known"}.get(str(self.map), "known roughly")
        return super().remark + (f", the {self.point}s' places {how}" if how else "")


def _at(places: Sequence[Sequence[float]]) -> str:
    points = [f"({place[0]:g}, {place[1]:g}) m" for place in places]
    return f" at {listing(points)}" if len(points) <= MOST_LISTED else ""


def points_seen(sensors: Sequence[Sensor]) -> Array:
    """Nominal places x, y [m] of all points that sensors see, (k, 2)."""
    places = [place[:2] for one in sensors if isinstance(one, MappedSensor) for place in one.places]
    return np.array(places, dtype=float).reshape(-1, 2)


def distance(square: Expression) -> Expression:
    """The root of a squared distance [m], rounded off where that is 0."""
    return ca.sqrt(square + NEAREST**2)


class Ranges(MappedSensor):
    """Distances [m] from a point of the robot to every beacon.

    Attributes:
        beacons: their positions x, y [m].
        noise: standard deviation of one distance [m].
        bias: of every distance alike: "known" (none), "unknown" (eliminated), or the standard deviation of
            its prior [m].
        map: of the beacons: "known", "unknown", or the standard deviation of their coordinates [m].
    """

    kind: Literal["ranges"] = "ranges"
    point = "beacon"
    beacons: Annotated[tuple[tuple[Length, Length], ...], Field(min_length=1)]
    noise: Annotated[Length, Field(gt=0)]
    bias: Literal["known", "unknown"] | Annotated[Length, Field(gt=0)] = "known"
    map: LengthMap = "known"

    @property
    def places(self) -> tuple[tuple[float, ...], ...]:
        """Of the beacons."""
        return self.beacons

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The bias as well, where it is not known."""
        known = known_to(self.bias)
        bias = () if known is None else (Nuisance("bias", 0.0, "m", known.get("")),)
        return (*super().nuisances, *bias)

    def reading(self, moment: Moment) -> Expression:
        """One distance per beacon."""
        x, y = self.position(moment)
        squares = [(x - beacon_x) ** 2 + (y - beacon_y) ** 2 for beacon_x, beacon_y in self.seen(moment)]
        bias = moment.nuisances.get("bias", 0.0)
        return ca.vertcat(*(distance(square) + bias for square in squares))

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma for every beacon."""
        return ca.SX.eye(len(self.beacons)) / self.noise

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of every distance."""
        return ("m",) * len(self.beacons)

    @property
    def entries(self) -> tuple[str, ...]:
        """The beacons' numbers."""
        return tuple(f"[{label}]" for label in self.labels)

    @property
    def subject(self) -> str:
        """The distances, to beacons at their places."""
        return f"the distances to {self._points}"

    @property
    def remark(self) -> str:
        """That of its place, and that there is a bias."""
        return super().remark + ("" if self.bias == "known" else ", plus a bias that is not known")

    def brief(self, samples: int) -> str:
        """The distances, and how often."""
        distances = f"the distances to {count(len(self.beacons), self.point)}"
        return f"{distances} at {count(len(self.columns(samples)), 'time')}"
