"""Limit on the wheels' angular acceleration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System
from oed.kernel.limit import InputLimit, Rows, TwoSided

Pair = Annotated[tuple[float, float], TwoSided("rad/s^2", "20 rad/s^2")]


class WheelAcceleration(InputLimit):
    """Every wheel's acceleration within its bounds [rad/s^2]."""

    name: ClassVar[str] = "wheel_acceleration"
    quantity: ClassVar[str] = "wheel_speed"
    unit: ClassVar[str] = "rad/s^2"
    bounds: Pair | None = None
    each: Mapping[str, Pair] | None = None

    def rows(self, drive: Drive) -> Rows:
        """One row per input and value that bounds it."""
        return self.bounded(drive.input_rates, drive.system)

    def rate_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """The bounds of every input."""
        return self.bounds_by_name(system)
