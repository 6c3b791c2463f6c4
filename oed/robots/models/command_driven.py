"""A robot that takes its speed and its yaw rate as commands: what its own controller makes of them."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.quantities import Duration, Ratio, Unit
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input
from oed.robots.models.lag import after_lag, mean_of_lag
from oed.robots.models.wheels import Constant, WheeledRobot

COMMANDS = ("commanded_speed", "commanded_yaw_rate")
"""Quantities of the inputs of a robot on commands, in their order."""
Gain = Annotated[Ratio, Field(gt=0)]
Lag = Annotated[Duration, Field(gt=0)]
TurnPerWay = Annotated[float, Unit("rad/m", "3 deg/m")]
WayPerTurn = Annotated[float, Unit("m/rad", "2 mm/rad")]


class Unicycle(WheeledRobot):
    """A robot whose inputs are the speed v [m/s] and the yaw rate omega [rad/s] that it is asked for.

    It drives at gain_v v + v_per_omega omega and turns at gain_omega omega + omega_per_v v. These may be
    commands, or what odometry of a wrong wheel size and track says. Each effect after the gains is there only
    where its key is given.

    Attributes:
        gain_v: what the robot makes of a speed.
        gain_omega: what it makes of a yaw rate.
        omega_per_v: turn to the left per way ahead [rad/m], as of wheels of unequal size.
        v_per_omega: way ahead per turn to the left [m/rad], as of an origin beside the centre of spins.
        lag_v: tau [s]: the speed follows as a first-order lag. It is a further state `speed` [m/s], 0 where
            a drive begins.
        lag_omega: tau [s]: likewise the yaw rate; a further state `yaw_rate` [rad/s].
    """

    kind: Literal["unicycle"] = "unicycle"
    gain_v: Gain = 1.0
    gain_omega: Gain = 1.0
    omega_per_v: TurnPerWay | None = None
    v_per_omega: WayPerTurn | None = None
    lag_v: Lag | None = None
    lag_omega: Lag | None = None
    inputs: ClassVar[tuple[Input, ...]] = (
        Input("v", COMMANDS[0], "m/s"),
        Input("omega", COMMANDS[1], "rad/s"),
    )
    constants: ClassVar[tuple[Constant, ...]] = (
        Constant("gain_v"),
        Constant("gain_omega"),
        Constant("omega_per_v", "rad/m", size=1.0),
        Constant("v_per_omega", "m/rad", size=1.0),
        Constant("lag_v", "s"),
        Constant("lag_omega", "s"),
    )

    @property
    def states(self) -> tuple[str, ...]:  # type: ignore[override]
        """The pose, and the speed and the yaw rate that lag."""
        return ("x", "y", "heading", *(name for name, _, _ in self._lagging))

    @property
    def state_units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI units of the states."""
        units = {"speed": "m/s", "yaw_rate": "rad/s"}
        return ("m", "m", "rad", *(units[name] for name, _, _ in self._lagging))

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward speed, 0, yaw rate: what the robot tends to where it lags."""
        own = self._by_name(parameters)
        speed = own["gain_v"] * inputs[0] + own.get("v_per_omega", 0) * inputs[1]
        yaw_rate = own["gain_omega"] * inputs[1] + own.get("omega_per_v", 0) * inputs[0]
        return ca.vertcat(speed, 0, yaw_rate)

    def mean_twist(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The twist with the means of what lags.

        The heading at the period's end is exact. Position takes speed and turn for even: its error is of the
        order of T^3.
        """
        own, means = self._by_name(parameters), ca.vertsplit(twist)
        for at, (_, lag, place) in enumerate(self._lagging, start=3):
            means[place] = mean_of_lag(state[at], twist[place], own[lag], period)
        return ca.vertcat(*means)

    def internal_step(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """What lags, at the period's end, from its means."""
        own = self._by_name(parameters)
        return ca.vertcat(
            ca.SX(0, 1),
            *(
                after_lag(state[at], twist[place], own[lag], period)
                for at, (_, lag, place) in enumerate(self._lagging, start=3)
            ),
        )

    @property
    def _lagging(self) -> tuple[tuple[str, str, int], ...]:
        # State, parameter and place in the twist of what lags.
        both = (("speed", "lag_v", 0), ("yaw_rate", "lag_omega", 2))
        return tuple(one for one in both if getattr(self, one[1]) is not None)

    def _by_name(self, parameters: Expression) -> dict[str, Expression]:
        return {one.name: parameters[place] for place, one in enumerate(self.parameters)}
