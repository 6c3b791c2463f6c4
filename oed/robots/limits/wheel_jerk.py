"""Limit on the wheels' angular jerk."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

from oed.foundation.errors import Flaw
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System
from oed.kernel.limit import InputLimit, Rows, TwoSided

Pair = Annotated[tuple[float, float], TwoSided("rad/s^3", "100 rad/s^3")]


class WheelJerk(InputLimit):
    """The rate of every wheel's acceleration within its bounds [rad/s^3].

    A drive of trapezoids, whose accelerations jump, has the jumps over one period as its jerk, those from
    rest and to rest included.
    """

    name: ClassVar[str] = "wheel_jerk"
    quantity: ClassVar[str] = "wheel_speed"
    unit: ClassVar[str] = "rad/s^3"
    bounds: Pair | None = None
    each: Mapping[str, Pair] | None = None

    def rows(self, drive: Drive) -> Rows:
        """One row per wheel and value that bounds the jerk."""
        return self.bounded(drive.input_jerks, drive.system)

    def flaws(self, system: System, space: Space) -> list[Flaw]:
        """No wheels, or splines whose acceleration jumps."""
        if space.spline.degree < 2:
            text = f"a degree-{space.spline.degree} spline has no jerk; take spline.degree 2 or more"
            return [Flaw(("limits", self.name), text)]
        return super().flaws(system, space)
