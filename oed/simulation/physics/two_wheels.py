"""The differential drive: two driven wheels and a caster that slides."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from oed.foundation.quantities import Length, Ratio
from oed.simulation.physics.robot import PhysicsRobot, Support


class TwoWheelsAndCaster(PhysicsRobot):
    """Two driven wheels on one axle and a ball that slides on the floor with little friction.

    Attributes:
        caster: how far ahead of the axle the ball sits; negative behind it [m].
        caster_friction: its coefficient of sliding friction.
    """

    kind: Literal["two_wheels_and_caster"] = "two_wheels_and_caster"
    centre_of_mass: tuple[Length, Length] = (-0.02, 0.0)
    caster: Length = -0.09
    caster_friction: Annotated[Ratio, Field(ge=0)] = 0.01

    @property
    def supports(self) -> tuple[Support, ...]:
        """Right, left, caster."""
        left, ball = self.track / 2, min(self.radii) / 2
        return (
            self.wheel("right", 0.0, -left, 0),
            self.wheel("left", 0.0, left, 1),
            Support("caster", self.caster, 0.0, ball, self.caster_friction, driven=False),
        )
