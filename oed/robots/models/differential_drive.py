"""The differential drive: two driven wheels on one axle, no slip; tracked at their middle or beside it."""

from __future__ import annotations

from typing import Literal

import casadi as ca

from oed.foundation.quantities import Length
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Parameter
from oed.robots.models.wheels import TwoSided


class DifferentialDrive(TwoSided):
    """Two driven wheels at distance `track` [m]; parameters wheel_radius_right, wheel_radius_left, track."""

    kind: Literal["differential_drive"] = "differential_drive"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius_right, wheel_radius_left, track [m]."""
        return self.geometry_parameters


class OffsetDrive(TwoSided):
    """Two driven wheels, tracked at a point `sensor_offset` [m] to the left of the middle of their axle.

    That point's forward speed is V - Omega * offset: all four coefficients are independent of each other,
    so linear least squares identifies radii, track and offset.
    """

    kind: Literal["offset_drive"] = "offset_drive"
    sensor_offset: Length = 0.0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius_right, wheel_radius_left, track, sensor_offset [m]."""
        return (*self.geometry_parameters, Parameter("sensor_offset", self.sensor_offset, "m", self.track))

    def coefficients(self, parameters: Expression) -> Expression:
        """C (2, 2): the paper's, its forward row less `sensor_offset` times the yaw row."""
        centre = super().coefficients(parameters)
        return ca.vertcat(centre[0, :], centre[1, :] - parameters[3] * centre[0, :])
