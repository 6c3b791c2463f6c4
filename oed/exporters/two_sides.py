"""A robot with a right and a left side as a controller sees it: two radii and a distance."""

from __future__ import annotations

import math
from dataclasses import dataclass

Pair = tuple[float, float]


@dataclass(frozen=True)
class Sides:
    """Effective wheel radii of both sides and the sides' distance [m].

    Forward speed (r_R w_R + r_L w_L) / 2, yaw rate (r_R w_R - r_L w_L) / separation, of the point midway.
    """

    radius_right: float
    radius_left: float
    separation: float

    @property
    def sound(self) -> bool:
        """Whether all three are positive and finite."""
        sizes = (self.radius_right, self.radius_left, self.separation)
        return all(math.isfinite(size) and size > 0 for size in sizes)

    def forward(self, right: Pair, left: Pair) -> Pair:
        """Least and largest forward motion for wheel motion within bounds (right, left)."""
        low, high = (
            (self.radius_right * one + self.radius_left * other) / 2
            for one, other in zip(right, left, strict=True)
        )
        return low, high

    def turning(self, right: Pair, left: Pair) -> Pair:
        """Least and largest yaw motion for wheel motion within bounds (right, left)."""
        low, high = (
            (self.radius_right * one - self.radius_left * other) / self.separation
            for one, other in zip(right, left[::-1], strict=True)
        )
        return low, high
