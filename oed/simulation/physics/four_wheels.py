"""The skid-steer robot: four driven wheels that cannot be steered."""

from __future__ import annotations

from typing import Literal

from oed.robots.models.wheels import PositiveLength
from oed.simulation.physics.robot import PhysicsRobot, Support


class FourWheels(PhysicsRobot):
    """Four driven wheels, the two of a side at the same commanded speed; a motor for each.

    Attributes:
        wheelbase: distance of front and rear axles [m].
    """

    kind: Literal["four_wheels"] = "four_wheels"
    wheelbase: PositiveLength = 0.16

    @property
    def supports(self) -> tuple[Support, ...]:
        """Front right, rear right, front left, rear left."""
        ahead, left = self.wheelbase / 2, self.track / 2
        return (
            self.wheel("front_right", ahead, -left, 0),
            self.wheel("rear_right", -ahead, -left, 1),
            self.wheel("front_left", ahead, left, 2),
            self.wheel("rear_left", -ahead, left, 3),
        )
