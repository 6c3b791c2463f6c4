"""Wheels with rollers let robots move sideways as well: four mecanum wheels, or three omnidirectional."""

from __future__ import annotations

from math import sqrt
from typing import ClassVar, Literal

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input
from oed.robots.models.wheels import Constant, LinearInCoefficients, PositiveLength, matrix_names

CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
PLACES = {"front_left": (0.5, sqrt(0.75)), "rear": (-1.0, 0.0), "front_right": (0.5, -sqrt(0.75))}
"""Where the wheels stand, ahead of the origin and to its left: cosine and sine of 60, 180 and -60 degrees."""


class Mecanum(LinearInCoefficients):
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
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = matrix_names(3, 4)
    constants: ClassVar[tuple[Constant, ...]] = (
        Constant("wheel_radius", "m"),
        Constant("half_wheelbase_plus_half_track", "m"),
    )

    @property
    def body_width(self) -> float:
        """As much as its length [m]."""
        return self.half_wheelbase_plus_half_track

    def coefficients(self, parameters: Expression) -> Expression:
        """C (3, 4) of yaw rate, forward and lateral speed: least squares of the wheels' rolling."""
        radius, arm = parameters[0], parameters[1]
        yaw, ahead, left = ca.DM([[-1, 1, -1, 1]]), ca.DM([[1, 1, 1, 1]]), ca.DM([[-1, 1, 1, -1]])
        return ca.vertcat(radius / (4 * arm) * yaw, radius / 4 * ahead, radius / 4 * left)


class OmniThree(LinearInCoefficients):
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
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = matrix_names(3, 3)
    constants: ClassVar[tuple[Constant, ...]] = (
        Constant("wheel_radius", "m"),
        Constant("centre_distance", "m"),
    )

    @property
    def body_width(self) -> float:
        """Width of the triangle of its wheels [m]."""
        return 1.5 * self.centre_distance

    def coefficients(self, parameters: Expression) -> Expression:
        """C (3, 3) of yaw rate, forward and lateral speed: the inverse of r w = J (forward, lateral, yaw)."""
        radius, distance = parameters[0], parameters[1]
        cosines, sines = zip(*PLACES.values(), strict=True)
        ahead, left = -ca.DM([sines]), ca.DM([cosines])
        yaw = radius / (3 * distance) * ca.DM.ones(1, 3)
        return ca.vertcat(yaw, 2 * radius / 3 * ahead, 2 * radius / 3 * left)
