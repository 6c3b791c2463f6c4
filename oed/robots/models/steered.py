"""Robots that steer: the Ackermann steering of cars, as a bicycle, and the tricycle."""

from __future__ import annotations

from math import pi
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.quantities import Angle, Ratio
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input
from oed.robots.models.wheels import Constant, PositiveLength, WheeledRobot

Gain = Annotated[Ratio, Field(gt=0)]


class Steered(WheeledRobot):
    """A wheel of `wheel_radius` [m], and a steered axle `wheelbase` [m] ahead of one that is not.

    The steering angle that acts is `steering_gain` times the commanded (or logged) one plus `steering_offset`
    [rad]; a gain that is not given is 1, and no parameter.
    """

    wheel_radius: PositiveLength
    wheelbase: PositiveLength
    steering_offset: Angle = 0.0
    steering_gain: Gain | None = None
    constants: ClassVar[tuple[Constant, ...]] = (
        Constant("wheel_radius", "m"),
        Constant("wheelbase", "m"),
        Constant("steering_offset", "rad", size=1.0),
        Constant("steering_gain"),
    )

    def steered(self, angle: Expression, parameters: Expression) -> Expression:
        """The steering angle [rad] that acts of a commanded one."""
        gain = 1.0 if self.steering_gain is None else parameters[3]
        return gain * angle + parameters[2]

    @property
    def body_width(self) -> float:
        """That of a cart of such a wheelbase [m]."""
        return 0.6 * self.wheelbase


class Ackermann(Steered):
    """Rear wheels of `wheel_radius` [m], driven; front wheels steered `wheelbase` [m] ahead of them.

    The origin is the middle of the rear axle. The steering angle that acts is `steering_gain` times the
    commanded one plus `steering_offset` [rad].
    """

    kind: Literal["ackermann"] = "ackermann"
    steering_gain: Gain = 1.0

    @property
    def inputs(self) -> tuple[Input, ...]:  # type: ignore[override]
        """Speed of the rear wheels, steering angle commanded."""
        # Wheels that stand across the robot do not let it roll.
        most = (pi / 2 - abs(self.steering_offset)) / self.steering_gain
        return (
            Input("wheel_speed", "wheel_speed", "rad/s"),
            Input("steering_angle", "steering_angle", "rad", below=most),
        )

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward speed V = r w, 0, yaw rate V tan(delta) / L [Rajamani, Vehicle Dynamics, 2.2]."""
        speed, steered = parameters[0] * inputs[0], self.steered(inputs[1], parameters)
        return ca.vertcat(speed, 0, speed * ca.tan(steered) / parameters[1])


class Tricycle(Steered):
    """A wheel of `wheel_radius` [m], driven and steered, `wheelbase` [m] ahead of the free wheels' axle.

    The origin is the middle of that axle. The steering angle that acts is the commanded one, times
    `steering_gain` where that is given, plus `steering_offset` [rad].
    """

    kind: Literal["tricycle"] = "tricycle"
    inputs: ClassVar[tuple[Input, ...]] = (
        Input("wheel_speed", "wheel_speed", "rad/s"),
        Input("steering_angle", "steering_angle", "rad"),
    )

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward speed r w cos(delta), 0, yaw rate r w sin(delta) / L, of the steered wheel's velocity
        along and across the robot, L ahead of its origin.
        """
        speed, steered = parameters[0] * inputs[0], self.steered(inputs[1], parameters)
        return ca.vertcat(speed * ca.cos(steered), 0, speed * ca.sin(steered) / parameters[1])
