"""The paper's robot: four wheels, two sides, longitudinal slip on the outer and the inner side of a turn."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.quantities import AngularSpeed, Ratio
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Parameter
from oed.robots.models.wheels import TwoSided

Slip = Annotated[Ratio, Field(lt=1)]


class SkidSteer(TwoSided):
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

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius_right, wheel_radius_left, track [m], slip_outer, slip_inner [1]."""
        slips = (Parameter("slip_outer", self.slip_outer, ""), Parameter("slip_inner", self.slip_inner, ""))
        return self.geometry_parameters + slips

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
