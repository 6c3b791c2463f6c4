"""The differential drive: two driven wheels on one axle, no slip."""

from __future__ import annotations

from typing import ClassVar, Literal

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter
from oed.robots.models.model import Model, coefficient_twist
from oed.robots.models.wheels import (
    COEFFICIENT_NAMES,
    TWO_WHEEL_SPEEDS,
    TwoSidedGeometry,
    two_sided_coefficients,
)


class DifferentialDrive(TwoSidedGeometry, Model):
    """Two driven wheels at distance `track` [m]; parameters wheel_radius_right, wheel_radius_left, track."""

    kind: Literal["differential_drive"] = "differential_drive"
    inputs: ClassVar[tuple[Input, ...]] = TWO_WHEEL_SPEEDS
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = COEFFICIENT_NAMES

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius_right, wheel_radius_left, track [m]."""
        return self.geometry_parameters

    def coefficients(self, parameters: Expression) -> Expression:
        """Matrix c (2, 2) of the paper [Choi, eq. 6]."""
        return two_sided_coefficients(parameters[0], parameters[1], parameters[2])

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward speed, 0, yaw rate [Choi, eqs 2, 4 with no slip]."""
        return coefficient_twist(self, inputs, parameters)
