"""Skid steer whose slip is put together: a lag of the yaw rate, an effective track that grows in turns, a
centre of rotation beside the origin, and a drift out of bends.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from oed.foundation.quantities import Duration, Length, LengthPerYawRate, Unit
from oed.kernel.dynamics.expression import Expression
from oed.robots.models.lag import after_lag, mean_of_lag
from oed.robots.models.model import Model
from oed.robots.models.wheels import Constant, TwoSidedRobot, matrix_names

Drift = Annotated[float, Unit("s^2", "0.04 s^2")]

SOFT_YAW_RATE = 0.05
"""Yaw rate [rad/s] over which the corner of its magnitude at 0 is rounded."""
SOFT_DRIFT = 0.01
"""Yaw rate [rad/s] over which that corner is rounded where it drives a drift."""
SOFT_WHEEL_SPEED = 0.1
"""Wheel speed [rad/s] over which the measure of curvature, which rest leaves open, is rounded."""


class SkidSteerSlip(TwoSidedRobot):
    """Two sides whose wheels slip; each effect is there only where its key is given.

    With none of them it is the differential drive. What slips takes less or more turning out of the same
    wheel speeds [Wong, Theory of Ground Vehicles; Mandow et al.: Experimental kinematics for wheeled
    skid-steer mobile robots, 2007].

    Attributes:
        yaw_lag: tau [s]: the yaw rate follows the one that the wheels ask for as a first-order lag. It is a
            further state `yaw_rate` [rad/s], 0 where a drive begins.
        track_per_yaw_rate: k [m s/rad]: the effective track is track + k |yaw rate|. The yaw rate is the one
            of the plain track, (r_R w_R - r_L w_L) / track, so that the effective track follows from the
            inputs at once; the one that results would have to be solved for.
        track_per_curvature: k [m]: the effective track is track + k s, with s of `tightness`.
        x_icr, y_icr: how far ahead of the origin and to its left the centre of spins lies [m]: the lateral
            speed is -x_icr, the forward speed y_icr times the yaw rate more.
        drift: k [s^2]: in bends the wheels slide outwards, at the lateral speed -k V Omega |Omega|. The
            friction that holds the robot in its bend takes so much sliding.
    """

    kind: Literal["skid_steer_slip"] = "skid_steer_slip"
    yaw_lag: Annotated[Duration, Field(gt=0)] | None = None
    track_per_yaw_rate: LengthPerYawRate | None = None
    track_per_curvature: Length | None = None
    x_icr: Length | None = None
    y_icr: Length | None = None
    drift: Drift | None = None
    skids: ClassVar[bool] = True
    # Of what is 0, a precision refers to a track that is doubled, at 1 rad/s or on a spin, and to a drift as
    # fast as the way ahead at 1 rad/s.
    constants: ClassVar[tuple[Constant, ...]] = (
        Constant("yaw_lag", "s"),
        Constant("track_per_yaw_rate", "m*s/rad", size="track"),
        Constant("track_per_curvature", "m", size="track"),
        Constant("x_icr", "m", size="track"),
        Constant("y_icr", "m", size="track"),
        Constant("drift", "s^2", size=1.0),
    )

    @model_validator(mode="after")
    def _a_track_in_every_turn(self) -> SkidSteerSlip:
        if self.track + (self.track_per_curvature or 0.0) <= 0:
            raise ValueError("track_per_curvature leaves no track on a spin")
        for name in ("x_icr", "y_icr"):
            if abs(getattr(self, name) or 0.0) > 10 * self.track:
                raise ValueError(f"{name} lies far outside the robot; is its unit right?")
        return self

    @property
    def states(self) -> tuple[str, ...]:  # type: ignore[override]
        """The pose, and the yaw rate of a robot whose yaw rate lags."""
        return ("x", "y", "heading", *(() if self.yaw_lag is None else ("yaw_rate",)))

    @property
    def state_units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI units of the states."""
        return ("m", "m", "rad", *(() if self.yaw_lag is None else ("rad/s",)))

    @property
    def coefficient_names(self) -> tuple[tuple[str, ...], ...]:  # type: ignore[override]
        """Names of the matrix c where at most x_icr is there."""
        others = (self.yaw_lag, self.track_per_yaw_rate, self.track_per_curvature, self.y_icr, self.drift)
        if any(one is not None for one in others):
            return ()
        return matrix_names(2 if self.x_icr is None else 3, 2)

    def coefficients(self, parameters: Expression) -> Expression:
        """Matrix c (2, 2) of the paper [Choi, eq. 6], with x_icr a third row for the lateral speed.

        Raises:
            NotImplementedError: the twist is not linear in any coefficients.
        """
        if not self.coefficient_names:
            return Model.coefficients(self, parameters)
        matrix = super().coefficients(parameters)
        ahead = self._value("x_icr", parameters)
        return matrix if ahead is None else ca.vertcat(matrix, -ahead * matrix[0, :])

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward speed V = (r_R w_R + r_L w_L) / 2, lateral speed, yaw rate (r_R w_R - r_L w_L) / B of the
        effective track B: what the robot tends to where its yaw rate lags.
        """
        if self.coefficient_names:
            return super().twist(inputs, parameters)
        right, left = parameters[0] * inputs[0], parameters[1] * inputs[1]
        yaw_rate = (right - left) / self._effective_track(inputs, parameters)
        return self._slid((right + left) / 2, yaw_rate, parameters)

    def tightness(self, inputs: Expression) -> Expression:
        """How tightly wheel speeds (2,) make a robot turn: s = (w_R - w_L)^2 / (w_R^2 + w_L^2) / 2 in [0, 1].

        0 on a straight, 1/2 where one side stands, 1 on a spin, where the curvature is infinite. Of wheels
        alike it is (B kappa / 2)^2 / (1 + (B kappa / 2)^2) for the curvature kappa: its square, saturated.
        """
        squares = inputs[0] ** 2 + inputs[1] ** 2 + SOFT_WHEEL_SPEED**2
        return (inputs[0] - inputs[1]) ** 2 / squares / 2

    def mean_twist(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The twist with the mean of the lagging yaw rate, W + (Omega - W) (1 - e^-r) / r with r = T / tau,
        from Omega on, for the W asked for.

        The heading at the period's end is exact. Position takes the turn for even: its error is of the order
        of V T^3 (Omega - W) / (12 tau), across.
        """
        lag = self._value("yaw_lag", parameters)
        if lag is None:
            return twist
        mean = mean_of_lag(state[3], twist[2], lag, period)
        return self._slid(twist[0] - self._or_zero("y_icr", parameters) * twist[2], mean, parameters)

    def internal_step(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The yaw rate at the period's end, W + (Omega - W) e^-r, from its mean: nothing without a lag."""
        lag = self._value("yaw_lag", parameters)
        if lag is None:
            return super().internal_step(state, twist, parameters, period)
        return after_lag(state[3], twist[2], lag, period)

    def _effective_track(self, inputs: Expression, parameters: Expression) -> Expression:
        track = parameters[2]
        per_yaw_rate = self._value("track_per_yaw_rate", parameters)
        per_curvature = self._value("track_per_curvature", parameters)
        found = track
        if per_yaw_rate is not None:
            plain = (parameters[0] * inputs[0] - parameters[1] * inputs[1]) / track
            found += per_yaw_rate * (ca.sqrt(plain**2 + SOFT_YAW_RATE**2) - SOFT_YAW_RATE)
        return found if per_curvature is None else found + per_curvature * self.tightness(inputs)

    def _slid(self, speed: Expression, yaw_rate: Expression, parameters: Expression) -> Expression:
        # The twist of wheels that roll at a mean speed while the robot turns.
        x_icr, y_icr, drift = (self._or_zero(name, parameters) for name in ("x_icr", "y_icr", "drift"))
        magnitude = ca.sqrt(yaw_rate**2 + SOFT_DRIFT**2)
        outwards = drift * speed * yaw_rate * magnitude
        return ca.vertcat(speed + y_icr * yaw_rate, -x_icr * yaw_rate - outwards, yaw_rate)

    def _or_zero(self, name: str, parameters: Expression) -> Expression:
        value = self._value(name, parameters)
        return 0 if value is None else value

    def _value(self, name: str, parameters: Expression) -> Expression | None:
        # Of a parameter that may be absent.
        names = [entry.name for entry in self.parameters]
        return parameters[names.index(name)] if name in names else None
