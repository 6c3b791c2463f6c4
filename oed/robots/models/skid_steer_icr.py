"""Skid steer by its instantaneous centres of rotation: what slip does, as a geometry of its own."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from oed.foundation.quantities import Length, Ratio
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter
from oed.robots.models.wheels import TWO_WHEEL_SPEEDS, LinearInCoefficients, PositiveLength, matrix_names

Alpha = Annotated[Ratio, Field(gt=0)]


class SkidSteerIcr(LinearInCoefficients):
    """Skid steer with the sides' instantaneous centres of rotation at y_icr_left > y_icr_right, the robot's
    at x_icr, all relative to its origin [m]; alpha is what is left of each side's wheel speed.

    [Martinez, Mandow, Morales, Pedraza, Garcia-Cerezo: Approximating kinematics for tracked mobile robots,
    2005; Mandow et al.: Experimental kinematics for wheeled skid-steer mobile robots, 2007]. The wheel radius
    is taken as known: it is not identifiable beside the alphas.
    """

    kind: Literal["skid_steer_icr"] = "skid_steer_icr"
    wheel_radius: PositiveLength
    y_icr_left: PositiveLength
    y_icr_right: Annotated[Length, Field(lt=0)]
    x_icr: Length = 0.0
    alpha_right: Alpha = 1.0
    alpha_left: Alpha = 1.0
    inputs: ClassVar[tuple[Input, ...]] = TWO_WHEEL_SPEEDS
    skids: ClassVar[bool] = True
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = matrix_names(3, 2)

    @model_validator(mode="after")
    def _robot_within_its_centres(self) -> SkidSteerIcr:
        if abs(self.x_icr) > 10 * (self.y_icr_left - self.y_icr_right):
            raise ValueError("x_icr lies far outside the robot; is its unit right?")
        return self

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """y_icr_left, y_icr_right, x_icr [m], alpha_right, alpha_left [1]."""
        return (
            Parameter("y_icr_left", self.y_icr_left, "m"),
            Parameter("y_icr_right", self.y_icr_right, "m"),
            Parameter("x_icr", self.x_icr, "m", self.y_icr_left - self.y_icr_right),
            Parameter("alpha_right", self.alpha_right, ""),
            Parameter("alpha_left", self.alpha_left, ""),
        )

    def coefficients(self, parameters: Expression) -> Expression:
        """C (3, 2) of yaw rate, forward and lateral speed [Martinez et al., eqs 2-4]."""
        left, right, ahead, alpha_right, alpha_left = ca.vertsplit(parameters)
        width = left - right
        speed_right, speed_left = self.wheel_radius * alpha_right, self.wheel_radius * alpha_left
        yaw = ca.horzcat(speed_right, -speed_left) / width
        forward = ca.horzcat(speed_right * left, -speed_left * right) / width
        return ca.vertcat(yaw, forward, -ahead * yaw)
