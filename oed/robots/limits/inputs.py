"""Limits on the inputs: wheels' speeds, steered wheels' angles, commands, and how fast these change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Generic, Literal, TypeVar

from oed.foundation.errors import Issue
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System, label_of
from oed.kernel.limit import InputLimit, Rows, TwoSided, rest_issues

SpeedPair = Annotated[tuple[float, float], TwoSided("rad/s", "10 rad/s")]
AccelerationPair = Annotated[tuple[float, float], TwoSided("rad/s^2", "20 rad/s^2")]
JerkPair = Annotated[tuple[float, float], TwoSided("rad/s^3", "100 rad/s^3")]
AnglePair = Annotated[tuple[float, float], TwoSided("rad", "40 deg")]
RatePair = Annotated[tuple[float, float], TwoSided("rad/s", "60 deg/s")]
CommandPair = Annotated[tuple[float, float], TwoSided("m/s", "0.5 m/s")]
CommandRatePair = Annotated[tuple[float, float], TwoSided("m/s^2", "1 m/s^2")]
YawAccelerationPair = Annotated[tuple[float, float], TwoSided("rad/s^2", "3 rad/s^2")]
ThrottlePair = Annotated[tuple[float, float], TwoSided("", "50 %")]
ThrottleRatePair = Annotated[tuple[float, float], TwoSided("1/s", "2 1/s")]
FULL = 1.0
"""The full throttle."""
Pair = TypeVar("Pair", bound=tuple[float, float])


class DerivativeLimit(InputLimit, Generic[Pair]):
    """A limit on all inputs of one quantity, or on their rates."""

    order: ClassVar[Literal[0, 1, 2]]
    """Which derivative of the inputs is limited: 0 for themselves."""
    bounds: Pair | None = None
    each: Mapping[str, Pair] | None = None

    def rows(self, drive: Drive) -> Rows:
        """One row per input and value that bounds the derivative."""
        return self.bounded(
            (drive.input_values, drive.input_rates, drive.input_jerks)[self.order], drive.system
        )

    def input_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """The bounds of a limit on the inputs themselves, by the inputs' names."""
        return {} if self.order else self.bounds_by_name(system)

    def rate_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """The bounds of a limit on the inputs' rates, by the inputs' names."""
        return self.bounds_by_name(system) if self.order == 1 else {}

    def issues(self, system: System, space: Space) -> list[Issue]:
        """No such inputs, splines without that derivative, bounds without rest or beyond the equations."""
        degree = space.stored_spline.degree
        if degree < 2 and self.order == 2:
            text = f"a degree-{degree} spline has no jerk; take spline.degree 2 or more"
            return [Issue(("limits", self.name), text)]
        issues = super().issues(system, space)
        if issues or self.order:
            return issues
        return rest_issues(self, self.bounds_by_name(system).values(), self.unit, space) + self._beyond(
            system
        )

    def _beyond(self, system: System) -> list[Issue]:
        below = {entry.name: entry.below for entry in system.inputs}
        pairs = self.bounds_by_name(system).items()
        far = [name for name, pair in pairs if max(map(abs, pair)) >= below[name]]
        if not far:
            return []
        text = f"must stay below {below[far[0]]:.4g} {self.unit}, or {label_of(system)} cannot roll"
        return [Issue(("limits", self.name), f"{', '.join(far)} {text}")]


class WheelSpeed(DerivativeLimit[SpeedPair]):
    """Every wheel's speed within its bounds [rad/s]."""

    name, quantity, unit, order = "wheel_speed", "wheel_speed", "rad/s", 0


class WheelAcceleration(DerivativeLimit[AccelerationPair]):
    """Every wheel's acceleration within its bounds [rad/s^2]."""

    name, quantity, unit, order = "wheel_acceleration", "wheel_speed", "rad/s^2", 1


class WheelJerk(DerivativeLimit[JerkPair]):
    """The rate of every wheel's acceleration within its bounds [rad/s^3].

    A drive of trapezoids, whose accelerations jump, has the jumps over one period as its jerk, those from
    rest and to rest included.
    """

    name, quantity, unit, order = "wheel_jerk", "wheel_speed", "rad/s^3", 2


class SteeringAngle(DerivativeLimit[AnglePair]):
    """Every steering angle within its bounds [rad]."""

    name, quantity, unit, order = "steering_angle", "steering_angle", "rad", 0
    in_degrees = True


class SteeringRate(DerivativeLimit[RatePair]):
    """The rate of every steering angle within its bounds [rad/s]."""

    name, quantity, unit, order = "steering_rate", "steering_angle", "rad/s", 1
    in_degrees = True


class CommandedSpeed(DerivativeLimit[CommandPair]):
    """The speed that a robot is asked for within its bounds [m/s]."""

    name, quantity, unit, order = "commanded_speed", "commanded_speed", "m/s", 0


class CommandedAcceleration(DerivativeLimit[CommandRatePair]):
    """The rate of the speed that a robot is asked for within its bounds [m/s^2]."""

    name, quantity, unit, order = "commanded_acceleration", "commanded_speed", "m/s^2", 1


class CommandedYawRate(DerivativeLimit[RatePair]):
    """The yaw rate that a robot is asked for within its bounds [rad/s]."""

    name, quantity, unit, order = "commanded_yaw_rate", "commanded_yaw_rate", "rad/s", 0
    in_degrees = True


class CommandedYawAcceleration(DerivativeLimit[YawAccelerationPair]):
    """The rate of the yaw rate that a robot is asked for within its bounds [rad/s^2]."""

    name, quantity, unit, order = "commanded_yaw_acceleration", "commanded_yaw_rate", "rad/s^2", 1
    in_degrees = True


class Throttle(DerivativeLimit[ThrottlePair]):
    """The throttle within its bounds, as shares of the full one: backwards negative."""

    name, quantity, unit, order = "throttle", "throttle", "", 0

    def issues(self, system: System, space: Space) -> list[Issue]:
        """No throttle, bounds without rest, or more than the full one."""
        issues = super().issues(system, space)
        most = max((abs(one) for pair in self.bounds_by_name(system).values() for one in pair), default=0.0)
        if issues or most <= FULL:
            return issues
        return [
            Issue(("limits", self.name), f"{most:g} is more than the full throttle, 1; give shares of it")
        ]


class ThrottleRate(DerivativeLimit[ThrottleRatePair]):
    """The rate of the throttle within its bounds [1/s]."""

    name, quantity, unit, order = "throttle_rate", "throttle", "1/s", 1
