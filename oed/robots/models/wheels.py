"""What wheeled robots have in common: inputs and geometry of two sides or a steered axle, the matrix c."""

from __future__ import annotations

from typing import Annotated, ClassVar

import casadi as ca
from pydantic import Field, model_validator

from oed.foundation.component import Component
from oed.foundation.quantities import Angle, Length
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter

PositiveLength = Annotated[Length, Field(gt=0)]

TWO_WHEEL_SPEEDS = (
    Input("wheel_speed_right", "wheel_speed", "rad/s"),
    Input("wheel_speed_left", "wheel_speed", "rad/s"),
)

COEFFICIENT_NAMES = (("c11", "c12"), ("c21", "c22"))


class TwoSidedGeometry(Component):
    """Wheel radii and track of a robot with a right and a left side; lengths in m.

    Either `wheel_radius` for both sides, or `wheel_radius_right` and `wheel_radius_left`.
    """

    short_forms: ClassVar[tuple[str, ...]] = ("wheel_radius",)
    wheel_radius: PositiveLength | None = None
    wheel_radius_right: PositiveLength | None = None
    wheel_radius_left: PositiveLength | None = None
    track: PositiveLength

    @property
    def body_width(self) -> float:
        """The track [m]."""
        return self.track

    @model_validator(mode="after")
    def _one_way_to_give_radii(self) -> TwoSidedGeometry:
        sides = (self.wheel_radius_right, self.wheel_radius_left)
        both = all(side is not None for side in sides)
        neither = all(side is None for side in sides)
        if not ((self.wheel_radius is not None and neither) or (self.wheel_radius is None and both)):
            raise ValueError("expected either wheel_radius, or both wheel_radius_right and wheel_radius_left")
        return self

    @property
    def radii(self) -> tuple[float, float]:
        """Nominal wheel radii (right, left) [m]."""
        if self.wheel_radius is not None:
            return self.wheel_radius, self.wheel_radius
        assert self.wheel_radius_right is not None
        assert self.wheel_radius_left is not None
        return self.wheel_radius_right, self.wheel_radius_left

    @property
    def geometry_parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius_right, wheel_radius_left, track [m]."""
        right, left = self.radii
        return (
            Parameter("wheel_radius_right", right, "m"),
            Parameter("wheel_radius_left", left, "m"),
            Parameter("track", self.track, "m"),
        )


class SteeredGeometry(Component):
    """A wheel of `wheel_radius` [m], a steered axle `wheelbase` [m] ahead of one that is not, and by how much
    the steering is off, `steering_offset` [rad].
    """

    wheel_radius: PositiveLength
    wheelbase: PositiveLength
    steering_offset: Angle = 0.0

    @property
    def body_width(self) -> float:
        """That of a cart of such a wheelbase [m]."""
        return 0.6 * self.wheelbase

    @property
    def geometry_parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius, wheelbase [m], steering_offset [rad]."""
        return (
            Parameter("wheel_radius", self.wheel_radius, "m"),
            Parameter("wheelbase", self.wheelbase, "m"),
            Parameter("steering_offset", self.steering_offset, "rad", 1.0),
        )


def two_sided_coefficients(
    radius_right: Expression, radius_left: Expression, track: Expression
) -> Expression:
    """C = [[r_R/B, -r_L/B], [r_R/2, r_L/2]] (2, 2): [1/1; m] per unit of wheel angle [Choi, eq. 6].

    Args:
        radius_right: [m].
        radius_left: [m].
        track: [m].
    """
    return ca.vertcat(
        ca.horzcat(radius_right / track, -radius_left / track),
        ca.horzcat(radius_right / 2, radius_left / 2),
    )
