"""Absolute poses, as a laser tracker or motion capture gives them."""

from __future__ import annotations

from typing import Annotated, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue
from oed.foundation.text import count, listing
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.sensor import Moment
from oed.robots.sensors.logged import Noise
from oed.robots.sensors.mounting import LeverArm
from oed.robots.sensors.placed import PlacedSensor
from oed.robots.sensors.pose_noise import UNITS, Quantity
from oed.robots.sensors.pose_noise import AbsoluteNoise as AbsoluteNoise


class Poses(PlacedSensor):
    """Absolute x, y [m] and heading [rad], or some of them, at every n-th sample.

    Attributes:
        quantities: which of x, y, heading are read.
        noise: of one reading.
    """

    kind: Literal["poses"] = "poses"
    quantities: Annotated[tuple[Quantity, ...], Field(min_length=1)] = ("x", "y", "heading")
    noise: AbsoluteNoise = AbsoluteNoise()

    @property
    def angles(self) -> tuple[int, ...]:
        """The heading's place."""
        return tuple(place for place, name in enumerate(self.quantities) if name == "heading")

    def reading(self, moment: Moment) -> Expression:
        """The quantities, at the lever arm's end."""
        x, y = self.position(moment)
        read = {"x": x, "y": y, "heading": self.pose(moment)[2]}
        return ca.vertcat(*(read[quantity] for quantity in self.quantities))

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma of each quantity at the moment's twist; the inverse Cholesky factor of a covariance."""
        twist = moment.signals["twist"]
        return self.noise.whitening(self.quantities, twist[0] ** 2 + twist[1] ** 2, twist[2] ** 2)

    @property
    def joint_whitening(self) -> Array | None:
        """The inverse Cholesky factor of a covariance of all readings."""
        return self.noise.joint_whitening(self.quantities)

    @property
    def units(self) -> tuple[str, ...]:
        """The quantities' units."""
        return tuple(UNITS[name] for name in self.quantities)

    @property
    def subject(self) -> str:
        """The quantities."""
        return listing(self.quantities)

    @property
    def noise_text(self) -> str:
        """Quantity by quantity, and how it grows."""
        return self.noise.text(self.quantities)

    def brief(self, samples: int) -> str:
        """How many are read, and what of them."""
        given = set(self.quantities)
        noun = "pose" if len(given) == 3 else "heading" if given == {"heading"} else "position"
        times = count(len(self.columns(samples)), noun)
        return times if noun == "heading" else f"{times} ({listing(self.quantities)})"

    @property
    def noises(self) -> dict[str, Noise]:
        """The noise of each quantity; {} of a covariance."""
        return self.noise.of_each(self.quantities)

    @property
    def mount(self) -> LeverArm:
        """The lever arm."""
        return self.lever_arm

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Quantities without noise or given twice, a covariance of another size."""
        twice = len(set(self.quantities)) < len(self.quantities)
        issues = [Issue(("measurement", "quantities"), "a quantity is listed twice")] if twice else []
        return issues + self.noise.issues(self.quantities, len(self.columns(samples)))
