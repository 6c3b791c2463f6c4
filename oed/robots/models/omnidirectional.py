"""Wheels with rollers let robots move sideways as well: four mecanum wheels, or three omnidirectional."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import ClassVar, Literal, Self

import casadi as ca
from pydantic import model_validator

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input
from oed.robots.models.wheels import Constant, LinearInCoefficients, PositiveLength, matrix_names

CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
PLACES = {"front_left": (0.5, sqrt(0.75)), "rear": (-1.0, 0.0), "front_right": (0.5, -sqrt(0.75))}
"""Where the wheels stand, ahead of the origin and to its left: cosine and sine of 60, 180 and -60 degrees."""


class RollerWheels(LinearInCoefficients):
    """A robot on wheels with rollers, each at a place that its speed and its radius are named after.

    Either `wheel_radius` [m] for all of them, which is one parameter then, or a radius for each.
    """

    wheel_radius: PositiveLength | None = None
    sideways: ClassVar[bool] = True
    places: ClassVar[Sequence[str]] = ()
    """Of the wheels, in the order of the inputs."""

    @model_validator(mode="after")
    def _one_way_to_give_radii(self) -> Self:
        own = [getattr(self, name) is not None for name in radius_names(self.places)]
        if (self.wheel_radius is None and not all(own)) or (self.wheel_radius is not None and any(own)):
            raise ValueError(
                f"expected either wheel_radius, or all of {', '.join(radius_names(self.places))}"
            )
        return self

    def radii(self, parameters: Expression) -> Expression:
        """The wheels' radii (1, wheels) [m], of the first parameters."""
        count = len(self.places)
        if self.wheel_radius is not None:
            return ca.repmat(parameters[0], 1, count)
        return ca.horzcat(*(parameters[place] for place in range(count)))


def radius_names(places: Sequence[str]) -> list[str]:
    """Names of the radii of wheels at some places."""
    return [f"wheel_radius_{place}" for place in places]


def _rollers(places: Sequence[str], arm: str) -> tuple[Constant, ...]:
    # Those that are not given are no parameters: the common radius, or the wheels' own.
    radii = ["wheel_radius", *radius_names(places)]
    return tuple(Constant(name, "m") for name in (*radii, arm))


class Mecanum(RollerWheels):
    """Four mecanum wheels; their rollers' axes seen from above form an X.

    Of one `wheel_radius` [m], or each of its own: `wheel_radius_front_left` and so on. Only the sum of half
    the wheelbase and half the track [m] matters for the motion.
    [Muir and Neuman, Kinematic modeling of wheeled mobile robots, 1987]
    """

    kind: Literal["mecanum"] = "mecanum"
    wheel_radius_front_left: PositiveLength | None = None
    wheel_radius_front_right: PositiveLength | None = None
    wheel_radius_rear_left: PositiveLength | None = None
    wheel_radius_rear_right: PositiveLength | None = None
    half_wheelbase_plus_half_track: PositiveLength
    places: ClassVar[Sequence[str]] = CORNERS
    inputs: ClassVar[tuple[Input, ...]] = tuple(
        Input(f"wheel_speed_{corner}", "wheel_speed", "rad/s") for corner in CORNERS
    )
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = matrix_names(3, 4)
    constants: ClassVar[tuple[Constant, ...]] = _rollers(places, "half_wheelbase_plus_half_track")

    @property
    def body_width(self) -> float:
        """As much as its length [m]."""
        return self.half_wheelbase_plus_half_track

    def coefficients(self, parameters: Expression) -> Expression:
        """C (3, 4) of yaw rate, forward and lateral speed: least squares of the wheels' rolling."""
        radii, arm = self.radii(parameters), parameters[-1]
        yaw, ahead, left = ca.DM([[-1, 1, -1, 1]]), ca.DM([[1, 1, 1, 1]]), ca.DM([[-1, 1, 1, -1]])
        return ca.vertcat(radii / (4 * arm) * yaw, radii / 4 * ahead, radii / 4 * left)


class OmniThree(RollerWheels):
    """Three omnidirectional wheels, each `centre_distance` [m] from the origin.

    Of one `wheel_radius` [m], or each of its own: `wheel_radius_front_left` and so on. Every wheel rolls
    across the line from the origin to it, counter-clockwise for a positive speed.
    """

    kind: Literal["omni_three"] = "omni_three"
    wheel_radius_front_left: PositiveLength | None = None
    wheel_radius_rear: PositiveLength | None = None
    wheel_radius_front_right: PositiveLength | None = None
    centre_distance: PositiveLength
    places: ClassVar[Sequence[str]] = tuple(PLACES)
    inputs: ClassVar[tuple[Input, ...]] = tuple(
        Input(f"wheel_speed_{place}", "wheel_speed", "rad/s") for place in PLACES
    )
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = matrix_names(3, 3)
    constants: ClassVar[tuple[Constant, ...]] = _rollers(places, "centre_distance")

    @property
    def body_width(self) -> float:
        """Width of the triangle of its wheels [m]."""
        return 1.5 * self.centre_distance

    def coefficients(self, parameters: Expression) -> Expression:
        """C (3, 3) of yaw rate, forward and lateral speed: the inverse of r w = J (forward, lateral, yaw)."""
        radii, distance = self.radii(parameters), parameters[-1]
        cosines, sines = zip(*PLACES.values(), strict=True)
        ahead, left = -ca.DM([sines]), ca.DM([cosines])
        return ca.vertcat(radii / (3 * distance), 2 * radii / 3 * ahead, 2 * radii / 3 * left)
