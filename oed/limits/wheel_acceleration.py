"""Limit on the wheels' angular acceleration."""

from __future__ import annotations

from typing import Annotated, ClassVar

from oed.limits.limit import InputLimit, Rows, TwoSided
from oed.models.model import Model
from oed.rollout import Drive


class WheelAcceleration(InputLimit):
    """Every wheel's acceleration within `bounds` [rad/s^2]."""

    name: ClassVar[str] = "wheel_acceleration"
    quantity: ClassVar[str] = "wheel_speed"
    bounds: Annotated[tuple[float, float], TwoSided("rad/s^2", "20 rad/s^2")]

    def rows(self, drive: Drive) -> Rows:
        """One row per wheel and value that bounds the acceleration."""
        return self.bounded(drive.input_rates[:, self.indices(drive.model)], "rad/s^2")

    def rate_bounds(self, model: Model) -> dict[str, tuple[float, float]]:
        """The bounds of every wheel."""
        return self.bounds_by_name(model)
