"""A car with inertia: the single-track model, driven by its throttle, on tyres that slip."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.quantities import Angle, Ratio, Unit
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.integration import rodas3
from oed.kernel.dynamics.system import Input
from oed.robots.models.arcs import sinc
from oed.robots.models.wheels import Constant, PositiveLength, WheeledRobot

Acceleration = Annotated[float, Unit("m/s^2", "6 m/s^2")]
Stiffness = Annotated[float, Unit("m/s^2/rad", "25 m/s^2/rad"), Field(gt=0)]

HALVINGS = 40
"""Of the steady speed's interval: to rounding of its half."""
NEWTON_STEPS = 2
"""That follow, by which the steady speed has its first and second derivatives."""


class BicycleDynamic(WheeledRobot):
    """A car whose inputs are throttle and steering angle: a single-track model with mass and yaw inertia.

    Its origin is the centre of gravity, its further states are the speeds there, 0 where a drive begins.
    Tyres are linear: the force across a wheel is the cornering stiffness times the slip angle [Rajamani,
    Vehicle Dynamics and Control, 2012, 2.2 and 2.3]. All is per mass, as poses cannot tell a mass. A car may
    roll backwards.

    Slip angles are speeds across over speeds ahead, which rest has none of: the divisor is the root of v^2 +
    low_speed^2 [Pacejka, Tire and Vehicle Dynamics, 2012, 4.3.2, adds a small speed to it, too], so that
    slow tyres act as viscous friction and a slow car rolls as its steering says.

    Attributes:
        drive_gain: acceleration of the full throttle 1 [m/s^2]; -1 drives, or brakes, backwards as much.
        viscous_drag: deceleration per speed [1/s], as of a motor's counter-torque; `drive_gain` over it is
            the largest speed.
        rolling_resistance: deceleration at any speed [m/s^2]; nothing where it is not given.
        air_drag: deceleration per speed squared [1/m]; likewise.
        stiffness_front, stiffness_rear: cornering stiffness of an axle's tyres over the car's mass
            [m/s^2/rad].
        front_axle, rear_axle: distances from the centre of gravity to the axles [m].
        gyration_radius: root of the yaw inertia over the mass [m].
        steering_gain, steering_offset: the steering angle that acts is the gain times the commanded one plus
            the offset [rad]; each a parameter only where it is given.
        low_speed: below which tyres, and rolling resistance, act as viscous friction [m/s].
        substeps: steps of the integration (`rodas3`) in a period.
    """

    kind: Literal["bicycle_dynamic"] = "bicycle_dynamic"
    drive_gain: Annotated[Acceleration, Field(gt=0)]
    viscous_drag: Annotated[float, Unit("1/s", "1 1/s"), Field(gt=0)]
    rolling_resistance: Annotated[Acceleration, Field(ge=0)] | None = None
    air_drag: Annotated[float, Unit("1/m", "0.02 1/m"), Field(ge=0)] | None = None
    stiffness_front: Stiffness
    stiffness_rear: Stiffness
    front_axle: PositiveLength
    rear_axle: PositiveLength
    gyration_radius: PositiveLength
    steering_gain: Annotated[Ratio, Field(gt=0)] | None = None
    steering_offset: Angle | None = None
    low_speed: Annotated[float, Unit("m/s", "0.3 m/s"), Field(gt=0)] = 0.3
    substeps: Annotated[int, Field(ge=1, le=100)] = 2
    states: ClassVar[tuple[str, ...]] = (
        "x",
        "y",
        "heading",
        "forward_speed",
        "lateral_speed",
        "yaw_rate",
    )
    state_units: ClassVar[tuple[str, ...]] = ("m", "m", "rad", "m/s", "m/s", "rad/s")
    inputs: ClassVar[tuple[Input, ...]] = (
        Input("throttle", "throttle", ""),
        Input("steering_angle", "steering_angle", "rad"),
    )
    # What is 0 is precise relative to what a car may have.
    constants: ClassVar[tuple[Constant, ...]] = (
        Constant("drive_gain", "m/s^2"),
        Constant("viscous_drag", "1/s"),
        Constant("rolling_resistance", "m/s^2", size="drive_gain"),
        Constant("air_drag", "1/m", size=1.0),
        Constant("stiffness_front", "m/s^2/rad"),
        Constant("stiffness_rear", "m/s^2/rad"),
        Constant("front_axle", "m"),
        Constant("rear_axle", "m"),
        Constant("gyration_radius", "m"),
        Constant("steering_gain"),
        Constant("steering_offset", "rad", size=1.0),
    )

    @property
    def wheelbase(self) -> float:
        """Distance between the axles [m]."""
        return self.front_axle + self.rear_axle

    @property
    def body_width(self) -> float:
        """That of a cart of such a wheelbase [m]."""
        return 0.6 * self.wheelbase

    @property
    def integrates(self) -> bool:
        """Its speeds are, and on arcs its poses."""
        return self.integration == "arc"

    @property
    def refinement(self) -> tuple[BicycleDynamic, int]:
        """The car with a single step a period, and how many of these its period is made of: bounds over a
        single step are close, and fast.
        """
        coarse, finer = super().refinement
        if not self.integrates:
            return coarse, finer
        return coarse.model_copy(update={"substeps": 1}), finer * self.substeps

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Twist of steady driving: where the throttle balances the drag, that of cornering included."""
        return _steady(self)(inputs, parameters)

    def motion(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> tuple[Expression, Expression]:
        """The twist on whose arc the pose at the period's end lies, and the speeds there.

        Args:
            state: at the begin of the period, (6,), SI.
            inputs: throttle and steering angle, (2,).
            parameters: values, (p,), SI.
            period: [s]; 0 for the instant itself.
        """
        (ahead, across, yaw_rate), speeds = self._moved(state, inputs, parameters, period)
        half_turn = period * yaw_rate / 2
        cosine, sine, short = ca.cos(half_turn), ca.sin(half_turn), sinc(half_turn)
        along, beside = cosine * ahead + sine * across, cosine * across - sine * ahead
        return ca.vertcat(along / short, beside / short, yaw_rate), speeds

    def step(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The state (6,) after a period: where `motion` leads, without the arc, of which it has no need.

        Args:
            state: at the begin of the period, (6,), SI.
            inputs: throttle and steering angle, (2,).
            parameters: values, (p,), SI.
            period: [s].
        """
        if self.integration != "arc":
            return super().step(state, inputs, parameters, period)
        (ahead, across, yaw_rate), speeds = self._moved(state, inputs, parameters, period)
        cosine, sine = ca.cos(state[2]), ca.sin(state[2])
        return ca.vertcat(
            state[0] + period * (cosine * ahead - sine * across),
            state[1] + period * (sine * ahead + cosine * across),
            state[2] + period * yaw_rate,
            speeds,
        )

    def _moved(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> tuple[list[Expression], Expression]:
        # Mean velocities of a period as the car sees them at its begin, and the speeds at its end.
        mean, speeds = _integrated(self)(state[3:], inputs, parameters, period)
        return ca.vertsplit(mean), speeds

    def accelerations(self, speeds: Expression, inputs: Expression, parameters: Expression) -> Expression:
        """Derivatives (3,) of forward speed, lateral speed and yaw rate [Rajamani, 2012, 2.2 and 2.3].

        Args:
            speeds: these themselves, (3,), SI.
            inputs: throttle and steering angle, (2,).
            parameters: values, (p,), SI.
        """
        own, (ahead, across, yaw_rate) = self._by_name(parameters), ca.vertsplit(speeds)
        steered, divisor = self._steered(inputs, own), self._divisor(ahead)
        front, rear = across + own["front_axle"] * yaw_rate, across - own["rear_axle"] * yaw_rate
        sliding = ahead * ca.sin(steered) - front * ca.cos(steered)
        force_front = own["stiffness_front"] * sliding / divisor
        force_rear = -own["stiffness_rear"] * rear / divisor
        turning = force_front * ca.cos(steered)
        moment = own["front_axle"] * turning - own["rear_axle"] * force_rear
        drive = own["drive_gain"] * inputs[0] - self._drag(ahead, own)
        return ca.vertcat(
            drive - force_front * ca.sin(steered) + across * yaw_rate,
            turning + force_rear - ahead * yaw_rate,
            moment / own["gyration_radius"] ** 2,
        )

    def cornering(self, ahead: Expression, inputs: Expression, parameters: Expression) -> Expression:
        """Twist (3,) of steady cornering at a forward speed [m/s]: where forces across and moments balance.

        The yaw rate tends to V delta / (L + K V^2) for small angles [Rajamani, 2012, 3.3].

        Args:
            ahead: forward speed [m/s].
            inputs: throttle and steering angle, (2,).
            parameters: values, (p,), SI.
        """
        own = self._by_name(parameters)
        steered, divisor = self._steered(inputs, own), self._divisor(ahead)
        front, rear = own["front_axle"], own["rear_axle"]
        wheelbase, cosine = front + rear, ca.cos(steered)
        # Both axles' forces are shares of V times the yaw rate; of these the slips, of these the speeds.
        across = rear - divisor * ahead * front / (wheelbase * own["stiffness_rear"])
        slipping = divisor * ahead * rear / (wheelbase * own["stiffness_front"] * cosine)
        yaw_rate = ahead * ca.sin(steered) / ((across + front) * cosine + slipping)
        return ca.vertcat(ahead, across * yaw_rate, yaw_rate)

    def deceleration(self, ahead: Expression, inputs: Expression, parameters: Expression) -> Expression:
        """What drag and steady cornering take of a forward speed [m/s^2].

        Args:
            ahead: forward speed [m/s].
            inputs: throttle and steering angle, (2,).
            parameters: values, (p,), SI.
        """
        own = self._by_name(parameters)
        _, across, yaw_rate = ca.vertsplit(self.cornering(ahead, inputs, parameters))
        share = own["rear_axle"] / (own["front_axle"] + own["rear_axle"])
        held = ca.tan(self._steered(inputs, own)) * share * ahead * yaw_rate
        return self._drag(ahead, own) + held - across * yaw_rate

    def _drag(self, ahead: Expression, own: Mapping[str, Expression]) -> Expression:
        divisor = self._divisor(ahead)
        rolling, air = own.get("rolling_resistance", 0), own.get("air_drag", 0)
        return (own["viscous_drag"] + rolling / divisor + air * divisor) * ahead

    def _divisor(self, ahead: Expression) -> Expression:
        # The magnitude of a speed, rounded at rest.
        return ca.sqrt(ahead**2 + self.low_speed**2)

    def _steered(self, inputs: Expression, own: Mapping[str, Expression]) -> Expression:
        return own.get("steering_gain", 1) * inputs[1] + own.get("steering_offset", 0)

    def _by_name(self, parameters: Expression) -> dict[str, Expression]:
        return {one.name: parameters[place] for place, one in enumerate(self.parameters)}


@lru_cache(maxsize=32)
def _integrated(robot: BicycleDynamic) -> ca.Function:
    # The function (speeds, inputs, parameters, period) -> mean velocities as seen from the period's begin,
    # speeds at its end.
    inputs, parameters = ca.SX.sym("inputs", 2), ca.SX.sym("p", len(robot.parameters))
    begin, period, now = ca.SX.sym("speeds", 3), ca.SX.sym("period"), ca.SX.sym("now", 6)
    cosine, sine, speeds = ca.cos(now[2]), ca.sin(now[2]), now[3:]
    velocity = ca.vertcat(cosine * speeds[0] - sine * speeds[1], sine * speeds[0] + cosine * speeds[1])
    # Where the car is, seen from where the period began, goes first: what an elimination begins with at the
    # other end is solved without it, and it follows by products alone.
    slope = ca.vertcat(velocity, speeds[2], robot.accelerations(speeds, inputs, parameters))
    given = [now, inputs, parameters]
    derivative = ca.Function("derivative", given, [slope])
    jacobian = ca.Function("jacobian", given, [ca.jacobian(slope, now)])
    ended, mean = rodas3(
        lambda state: derivative(state, inputs, parameters),
        lambda state: jacobian(state, inputs, parameters),
        ca.vertcat(ca.SX.zeros(3), begin),
        period,
        robot.substeps * robot._finer,
    )
    return ca.Function("integrated", [begin, inputs, parameters, period], [mean[:3], ended[3:]])


@lru_cache(maxsize=32)
def _steady(robot: BicycleDynamic) -> ca.Function:
    # The function (inputs, parameters) -> twist of steady driving.
    inputs, parameters = ca.SX.sym("inputs", 2), ca.SX.sym("p", len(robot.parameters))
    ahead, names = ca.SX.sym("ahead"), [one.name for one in robot.parameters]
    wanted = parameters[names.index("drive_gain")] * inputs[0]
    excess = robot.deceleration(ahead, inputs, parameters) - wanted
    given = [ahead, inputs, parameters]
    too_fast = ca.Function("too_fast", given, [excess * wanted > 0])
    newton = ca.Function("newton", given, [ahead - excess / ca.gradient(excess, ahead)])
    # No faster than with viscous drag alone.
    most, share = wanted / parameters[names.index("viscous_drag")], ca.SX(0)
    for halving in range(1, HALVINGS + 1):
        further = share + 0.5**halving
        share = ca.if_else(too_fast(further * most, inputs, parameters), share, further)
    found = share * most
    for _ in range(NEWTON_STEPS):
        found = newton(found, inputs, parameters)
    return ca.Function("steady", [inputs, parameters], [robot.cornering(found, inputs, parameters)])
