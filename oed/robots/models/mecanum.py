"""Four mecanum wheels: rollers at 45 degrees let the robot move sideways as well."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter
from oed.robots.models.model import Model, coefficient_twist
from oed.robots.models.wheels import PositiveLength

CORNERS = ("front_left", "front_right", "rear_left", "rear_right")


class Mecanum(Model):
    """Four mecanum wheels of `wheel_radius` [m]; their rollers' axes seen from above form an X.

    Only the sum of half the wheelbase and half the track [m] matters for the motion.
    [Muir and Neuman, Kinematic modeling of wheeled mobile robots, 1987]
    """

    kind: Literal["mecanum"] = "mecanum"
    wheel_radius: PositiveLength
    half_wheelbase_plus_half_track: PositiveLength
    sideways: ClassVar[bool] = True
    inputs: ClassVar[tuple[Input, ...]] = tuple(
        Input(f"wheel_speed_{corner}", "wheel_speed", "rad/s") for corner in CORNERS
    )
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = (
        ("c11", "c12", "c13", "c14"),
        ("c21", "c22", "c23", "c24"),
        ("c31", "c32", "c33", "c34"),
    )

    @property
    def body_width(self) -> float:
        """As much as its length [m]."""
        return self.half_wheelbase_plus_half_track

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius, half_wheelbase_plus_half_track [m]."""
        return (
            Parameter("wheel_radius", self.wheel_radius, "m"),
            Parameter("half_wheelbase_plus_half_track", self.half_wheelbase_plus_half_track, "m"),
        )

    def coefficients(self, parameters: Expression) -> Expression:
        """C (3, 4) of yaw rate, forward and lateral speed: least squares of the wheels' rolling."""
        radius, arm = parameters[0], parameters[1]
        yaw, ahead, left = ca.DM([[-1, 1, -1, 1]]), ca.DM([[1, 1, 1, 1]]), ca.DM([[-1, 1, 1, -1]])
        return ca.vertcat(radius / (4 * arm) * yaw, radius / 4 * ahead, radius / 4 * left)

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward and lateral speed, yaw rate."""
        return coefficient_twist(self, inputs, parameters)
