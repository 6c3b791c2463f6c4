"""The tricycle: one steered and driven wheel in front, two free wheels behind."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter
from oed.robots.models.model import Model
from oed.robots.models.wheels import SteeredGeometry


class Tricycle(SteeredGeometry, Model):
    """A wheel of `wheel_radius` [m], driven and steered, `wheelbase` [m] ahead of the free wheels' axle.

    The origin is the middle of that axle. The steering angle that acts is the commanded one plus
    `steering_offset` [rad].
    """

    kind: Literal["tricycle"] = "tricycle"
    inputs: ClassVar[tuple[Input, ...]] = (
        Input("wheel_speed", "wheel_speed", "rad/s"),
        Input("steering_angle", "steering_angle", "rad"),
    )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius, wheelbase [m], steering_offset [rad]."""
        return self.geometry_parameters

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward speed r w cos(delta), 0, yaw rate r w sin(delta) / L, of the steered wheel's velocity
        along and across the robot, L ahead of its origin.
        """
        speed, steered = parameters[0] * inputs[0], inputs[1] + parameters[2]
        return ca.vertcat(speed * ca.cos(steered), 0, speed * ca.sin(steered) / parameters[1])
