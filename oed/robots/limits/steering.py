"""Limits on a steered wheel: its angle and how fast that changes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

from oed.foundation.errors import Flaw
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System, label_of
from oed.kernel.limit import InputLimit, Rows, TwoSided, rest_flaws

AnglePair = Annotated[tuple[float, float], TwoSided("rad", "40 deg")]
RatePair = Annotated[tuple[float, float], TwoSided("rad/s", "60 deg/s")]


class SteeringAngle(InputLimit):
    """Every steering angle within its bounds [rad]."""

    name: ClassVar[str] = "steering_angle"
    in_degrees: ClassVar[bool] = True
    quantity: ClassVar[str] = "steering_angle"
    unit: ClassVar[str] = "rad"
    bounds: AnglePair | None = None
    each: Mapping[str, AnglePair] | None = None

    def rows(self, drive: Drive) -> Rows:
        """One row per steered wheel and value that bounds its angle."""
        return self.bounded(drive.input_values, drive.system)

    def flaws(self, system: System, space: Space) -> list[Flaw]:
        """No steering, bounds without 0 where it begins and ends there, or beyond the model's equations."""
        flaws = super().flaws(system, space)
        if flaws:
            return flaws
        pairs = self.bounds_by_name(system).values()
        return rest_flaws(self, pairs, self.unit, space) + self._beyond(system)

    def _beyond(self, system: System) -> list[Flaw]:
        below = {entry.name: entry.below for entry in system.inputs}
        far = [
            name
            for name, pair in self.bounds_by_name(system).items()
            if max(abs(bound) for bound in pair) >= below[name]
        ]
        if not far:
            return []
        text = f"{', '.join(far)} must stay below {below[far[0]]:.4g} rad, or {label_of(system)} cannot roll"
        return [Flaw(("limits", self.name), text)]

    def input_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """The bounds of every steering angle."""
        return self.bounds_by_name(system)


class SteeringRate(InputLimit):
    """The rate of every steering angle within its bounds [rad/s]."""

    name: ClassVar[str] = "steering_rate"
    in_degrees: ClassVar[bool] = True
    quantity: ClassVar[str] = "steering_angle"
    unit: ClassVar[str] = "rad/s"
    bounds: RatePair | None = None
    each: Mapping[str, RatePair] | None = None

    def rows(self, drive: Drive) -> Rows:
        """One row per steered wheel and value that bounds its rate."""
        return self.bounded(drive.input_rates, drive.system)

    def rate_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """The bounds of every steering rate."""
        return self.bounds_by_name(system)
