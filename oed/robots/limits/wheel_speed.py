"""Limit on the wheels' angular speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

from oed.foundation.errors import Flaw
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.limit import InputLimit, Rows, TwoSided, rest_flaws

Pair = Annotated[tuple[float, float], TwoSided("rad/s", "10 rad/s")]


class WheelSpeed(InputLimit):
    """Every wheel's speed within its bounds [rad/s]."""

    name: ClassVar[str] = "wheel_speed"
    quantity: ClassVar[str] = "wheel_speed"
    unit: ClassVar[str] = "rad/s"
    bounds: Pair | None = None
    each: Mapping[str, Pair] | None = None

    def rows(self, drive: Drive) -> Rows:
        """One row per wheel and value that bounds the speed."""
        return self.bounded(drive.input_values, drive.system)

    def flaws(self, system: System, space: Space) -> list[Flaw]:
        """No wheels, or bounds that exclude rest."""
        flaws = super().flaws(system, space)
        return flaws or rest_flaws(self, self.bounds_by_name(system).values(), self.unit, space)

    def input_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """The bounds of every wheel."""
        return self.bounds_by_name(system)
