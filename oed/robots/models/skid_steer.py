"""Skid steer: the paper's robot, with longitudinal slip on the outer and the inner side of a turn; and by its
instantaneous centres of rotation, what slip does as a geometry of its own.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from oed.foundation.quantities import AngularSpeed, Length, Ratio
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input
from oed.robots.models.wheels import (
    TWO_WHEEL_SPEEDS,
    Constant,
    LinearInCoefficients,
    PositiveLength,
    TwoSidedRobot,
    matrix_names,
)

Slip = Annotated[Ratio, Field(lt=1)]
Alpha = Annotated[Ratio, Field(gt=0)]


class SkidSteer(TwoSidedRobot):
    """Four-wheel skid steer with slips i_o, i_i of the outer and inner side [Choi, eqs 1-6; Wong].

    The outer side is the one farther from the turn's centre: the one whose wheels turn faster, whatever
    the direction of travel. The two sides exchange roles over `slip_transition` [rad/s] of difference, as
    tanh, so that derivatives exist; on a straight and in a spin in place both have the mean slip.
    """

    kind: Literal["skid_steer"] = "skid_steer"
    slip_outer: Slip = 0.0
    slip_inner: Slip = 0.0
    slip_transition: Annotated[AngularSpeed, Field(gt=0)] = 0.1
    skids: ClassVar[bool] = True
    constants: ClassVar[tuple[Constant, ...]] = (Constant("slip_outer"), Constant("slip_inner"))

    def effective_inputs(self, inputs: Expression, parameters: Expression) -> Expression:
        """Wheel speeds less slip, w (1 - i), right and left [rad/s] [Choi, eq. 5]."""
        outer, inner = parameters[3], parameters[4]
        right_is_outer = self._right_is_outer(inputs)
        slip_right = inner + (outer - inner) * right_is_outer
        slip_left = outer + (inner - outer) * right_is_outer
        return ca.vertcat(inputs[0] * (1 - slip_right), inputs[1] * (1 - slip_left))

    def turning_radius(self, wheel_speeds: Expression) -> Expression:
        """Turning radius R' [m] at nominal parameters, positive for a centre on the left [Choi, eq. 1].

        Args:
            wheel_speeds: (2,) right and left [rad/s]. Infinite on a straight.
        """
        forward, _, yaw_rate = ca.vertsplit(self.twist(wheel_speeds, ca.DM(self.nominal)))
        return forward / yaw_rate

    def speed_ratio(self, wheel_speeds: Expression) -> Expression:
        """K_s = w_o / w_i, outer over inner wheel speed [Choi, eq. 3]."""
        right_over_left = wheel_speeds[0] / wheel_speeds[1]
        return ca.if_else(
            ca.fabs(wheel_speeds[0]) >= ca.fabs(wheel_speeds[1]), right_over_left, 1 / right_over_left
        )

    def _right_is_outer(self, inputs: Expression) -> Expression:
        # 1 where the right side is outer, 0 where the left is; the magnitudes are smooth at 0 as well.
        width = self.slip_transition
        magnitude = ca.sqrt(inputs * inputs + width * width)
        return (1 + ca.tanh((magnitude[0] - magnitude[1]) / width)) / 2


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
    constants: ClassVar[tuple[Constant, ...]] = (
        Constant("y_icr_left", "m"),
        Constant("y_icr_right", "m"),
        Constant("x_icr", "m", size="centres_apart"),
        Constant("alpha_right"),
        Constant("alpha_left"),
    )

    @property
    def centres_apart(self) -> float:
        """The effective track: the distance of the sides' centres [m]."""
        return self.y_icr_left - self.y_icr_right

    @model_validator(mode="after")
    def _robot_within_its_centres(self) -> SkidSteerIcr:
        if abs(self.x_icr) > 10 * self.centres_apart:
            raise ValueError("x_icr lies far outside the robot; is its unit right?")
        return self

    def coefficients(self, parameters: Expression) -> Expression:
        """C (3, 2) of yaw rate, forward and lateral speed [Martinez et al., eqs 2-4]."""
        left, right, ahead, alpha_right, alpha_left = ca.vertsplit(parameters)
        width = left - right
        speed_right, speed_left = self.wheel_radius * alpha_right, self.wheel_radius * alpha_left
        yaw = ca.horzcat(speed_right, -speed_left) / width
        forward = ca.horzcat(speed_right * left, -speed_left * right) / width
        return ca.vertcat(yaw, forward, -ahead * yaw)
