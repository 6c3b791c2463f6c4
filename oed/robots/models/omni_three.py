"""Three omnidirectional wheels, 120 degrees apart."""

from __future__ import annotations

from math import sqrt
from typing import ClassVar, Literal

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter
from oed.robots.models.model import Model, coefficient_twist
from oed.robots.models.wheels import PositiveLength

PLACES = {"front_left": (0.5, sqrt(0.75)), "rear": (-1.0, 0.0), "front_right": (0.5, -sqrt(0.75))}
"""Where the wheels stand, ahead of the origin and to its left: cosine and sine of 60, 180 and -60 degrees."""


class OmniThree(Model):
    """Three omnidirectional wheels of `wheel_radius` [m], each `centre_distance` [m] from the origin.

    Every wheel rolls across the line from the origin to it, counter-clockwise for a positive speed.
    """

    kind: Literal["omni_three"] = "omni_three"
    wheel_radius: PositiveLength
    centre_distance: PositiveLength
    sideways: ClassVar[bool] = True
    inputs: ClassVar[tuple[Input, ...]] = tuple(
        Input(f"wheel_speed_{place}", "wheel_speed", "rad/s") for place in PLACES
    )
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = (
        ("c11", "c12", "c13"),
        ("c21", "c22", "c23"),
        ("c31", "c32", "c33"),
    )

    @property
    def body_width(self) -> float:
        """Width of the triangle of its wheels [m]."""
        return 1.5 * self.centre_distance

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius, centre_distance [m]."""
        return (
            Parameter("wheel_radius", self.wheel_radius, "m"),
            Parameter("centre_distance", self.centre_distance, "m"),
        )

    def coefficients(self, parameters: Expression) -> Expression:
        """C (3, 3) of yaw rate, forward and lateral speed: the inverse of r w = J (forward, lateral, yaw)."""
        radius, distance = parameters[0], parameters[1]
        cosines, sines = zip(*PLACES.values(), strict=True)
        ahead, left = -ca.DM([sines]), ca.DM([cosines])
        yaw = radius / (3 * distance) * ca.DM.ones(1, 3)
        return ca.vertcat(yaw, 2 * radius / 3 * ahead, 2 * radius / 3 * left)

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward and lateral speed, yaw rate."""
        return coefficient_twist(self, inputs, parameters)
