"""The differential drive whose pose is that of a point beside the middle of its axle."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from oed.foundation.quantities import Length
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter
from oed.robots.models.model import Model, coefficient_twist
from oed.robots.models.wheels import (
    COEFFICIENT_NAMES,
    TWO_WHEEL_SPEEDS,
    TwoSidedGeometry,
    two_sided_coefficients,
)


class OffsetDrive(TwoSidedGeometry, Model):
    """Two driven wheels, tracked at a point `sensor_offset` [m] to the left of the middle of their axle.

    That point's forward speed is V - Omega * offset: all four coefficients are independent of each other,
    so linear least squares tells radii, track and offset.
    """

    kind: Literal["offset_drive"] = "offset_drive"
    sensor_offset: Length = 0.0
    inputs: ClassVar[tuple[Input, ...]] = TWO_WHEEL_SPEEDS
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = COEFFICIENT_NAMES

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius_right, wheel_radius_left, track, sensor_offset [m]."""
        return (*self.geometry_parameters, Parameter("sensor_offset", self.sensor_offset, "m", self.track))

    def coefficients(self, parameters: Expression) -> Expression:
        """C (2, 2): the paper's, its forward row less `sensor_offset` times the yaw row."""
        centre = two_sided_coefficients(parameters[0], parameters[1], parameters[2])
        return ca.vertcat(centre[0, :], centre[1, :] - parameters[3] * centre[0, :])

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward speed of the tracked point, 0, yaw rate."""
        return coefficient_twist(self, inputs, parameters)
