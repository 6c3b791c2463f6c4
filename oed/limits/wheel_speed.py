"""Limit on the wheels' angular speed."""

from __future__ import annotations

from typing import Annotated, ClassVar

from oed.errors import Flaw
from oed.limits.limit import InputLimit, Rows, TwoSided
from oed.models.model import Model
from oed.rollout import Drive
from oed.trajectory import DesignSpace


class WheelSpeed(InputLimit):
    """Every wheel's speed within `bounds` [rad/s]."""

    name: ClassVar[str] = "wheel_speed"
    quantity: ClassVar[str] = "wheel_speed"
    bounds: Annotated[tuple[float, float], TwoSided("rad/s", "10 rad/s")]

    def rows(self, drive: Drive) -> Rows:
        """One row per wheel and value that bounds the speed."""
        return self.bounded(drive.input_values[:, self.indices(drive.model)], "rad/s")

    def flaws(self, model: Model, space: DesignSpace) -> list[Flaw]:
        """No wheels, or a minimum speed that excludes rest."""
        low, high = self.bounds
        if space.rest_to_rest and not low <= 0 <= high:
            text = f"[{low:g}, {high:g}] rad/s excludes 0, which trajectory.rest_to_rest needs"
            return [Flaw(("limits", self.name), text)]
        return super().flaws(model, space)

    def input_bounds(self, model: Model) -> dict[str, tuple[float, float]]:
        """The bounds of every wheel."""
        return self.bounds_by_name(model)
