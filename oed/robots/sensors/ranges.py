"""Distances to known beacons, as ultra-wideband radios give them."""

from __future__ import annotations

from typing import Annotated, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.quantities import Length
from oed.foundation.text import count, listing
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.sensor import Moment
from oed.robots.sensors.placed import PlacedSensor

NEAREST = 1e-3
"""Distance [m] at which a range is rounded off, so that it has derivatives at the beacon itself."""
MOST_PLACES = 6
"""Beacons beyond which they are counted, not listed."""


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
