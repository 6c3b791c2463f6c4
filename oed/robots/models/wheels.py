"""What two-sided wheeled robots have in common: their inputs, their geometry, the paper's matrix c."""

from __future__ import annotations

from typing import Annotated, ClassVar

import casadi as ca
from pydantic import Field, model_validator

from oed.foundation.component import Component
from oed.foundation.quantities import Length
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
