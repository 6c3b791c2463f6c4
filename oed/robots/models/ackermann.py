"""Ackermann steering, as a bicycle: driven rear wheels, one steered front wheel in the middle."""

from __future__ import annotations

from math import pi
from typing import Annotated, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.quantities import Ratio
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter
from oed.robots.models.model import Model
from oed.robots.models.wheels import SteeredGeometry


class Ackermann(SteeredGeometry, Model):
    """Rear wheels of `wheel_radius` [m], driven; front wheels steered `wheelbase` [m] ahead of them.

    The origin is the middle of the rear axle. The steering angle that acts is `steering_gain` times the
    commanded one plus `steering_offset` [rad].
    """

    kind: Literal["ackermann"] = "ackermann"
    steering_gain: Annotated[Ratio, Field(gt=0)] = 1.0

    @property
    def inputs(self) -> tuple[Input, ...]:  # type: ignore[override]
        """Speed of the rear wheels, steering angle commanded."""
        # Wheels that stand across the robot do not let it roll.
        most = (pi / 2 - abs(self.steering_offset)) / self.steering_gain
        return (
            Input("wheel_speed", "wheel_speed", "rad/s"),
            Input("steering_angle", "steering_angle", "rad", below=most),
        )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius, wheelbase [m], steering_offset [rad], steering_gain [1]."""
        return (*self.geometry_parameters, Parameter("steering_gain", self.steering_gain, ""))

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward speed V = r w, 0, yaw rate V tan(delta) / L [Rajamani, Vehicle Dynamics, 2.2]."""
        speed = parameters[0] * inputs[0]
        steered = parameters[3] * inputs[1] + parameters[2]
        return ca.vertcat(speed, 0, speed * ca.tan(steered) / parameters[1])
