"""Example robots: one or more of every listed kind, each with an independent twist.

A new robot is tested by being added to `EXAMPLES`; `test_models.py` fails until it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import cars
import casadi as ca
import numpy as np
import oracle
import pytest

from oed.robots.models import (
    Ackermann,
    BicycleDynamic,
    DifferentialDrive,
    Mecanum,
    Model,
    OffsetDrive,
    OmniThree,
    PythonRobot,
    SkidSteer,
    SkidSteerIcr,
    SkidSteerSlip,
    TractorTrailer,
    Tricycle,
    Unicycle,
)

RADIUS, TRACK = 0.049, 0.18


@dataclass(frozen=True)
class Example:
    """A robot, and its twist (and effective inputs, and further states) written independently of the package.

    `internal` and `mean` are further states after a period, and what the twist of the inputs comes to in it,
    of state, twist, period and parameters; of a robot with inertia both are `motion`, of state, inputs,
    period and parameters. `ambiguities` counts combinations of parameters that no poses (and
    no trailer's angle) tell apart.
    """

    name: str
    model: Model
    twist: Callable[[np.ndarray], np.ndarray]
    effective: Callable[[np.ndarray], np.ndarray] = np.asarray
    internal: Callable[..., np.ndarray] | None = None
    mean: Callable[..., np.ndarray] | None = None
    motion: Callable[..., tuple[np.ndarray, np.ndarray]] | None = None
    ambiguities: int = 0

    def moved(self, state: np.ndarray, inputs: np.ndarray, period: float) -> np.ndarray:
        """The twist (3,) that stands for a period from a state on."""
        if self.motion is not None:
            return self.motion(state, inputs, period, self.model.nominal)[0]
        twist = self.twist(inputs)
        parameters = np.array(self.model.nominal)
        return twist if self.mean is None else self.mean(state, twist, period, parameters)

    @property
    def on_arcs(self) -> bool:
        """Whether its twist is the same all along a period."""
        return self.mean is None and self.motion is None

    @property
    def has_further_states(self) -> bool:
        """Whether it says how states after the pose follow."""
        return self.internal is not None or self.motion is not None

    def further(self, state: np.ndarray, inputs: np.ndarray, period: float) -> np.ndarray:
        """The states after the pose, after a period."""
        if self.motion is not None:
            return self.motion(state, inputs, period, self.model.nominal)[1]
        assert self.internal is not None
        return self.internal(state, self.twist(inputs), period, np.array(self.model.nominal))


def _two_sided(name: str, model: Model, radii: tuple[float, float], slips=(0.0, 0.0)) -> Example:
    def effective(speeds):
        return oracle.skid_speeds(speeds, *slips)

    return Example(
        name,
        model,
        lambda speeds: oracle.differential_twist(effective(speeds), *radii, TRACK),
        effective,
        ambiguities=1 if isinstance(model, SkidSteer) else 0,
    )


def _wheels_twist(rolling: np.ndarray, radius: float | np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The twist that fits wheels best whose rolling speed is rolling @ (forward, lateral, yaw rate)."""
    return lambda speeds: np.linalg.lstsq(rolling, radius * np.asarray(speeds), rcond=None)[0]


def _mecanum(arm: float) -> np.ndarray:
    # Front left, front right, rear left, rear right: rollers at 45 degrees, forming an X from above.
    return np.array([[1, -1, -arm], [1, 1, arm], [1, 1, -arm], [1, -1, arm]])


def _omni(distance: float) -> np.ndarray:
    angles = np.deg2rad([60, 180, 300])
    return np.column_stack([-np.sin(angles), np.cos(angles), np.full(3, distance)])


def _offset_twist(speeds: np.ndarray, offset: float) -> np.ndarray:
    forward, _, yaw_rate = oracle.differential_twist(speeds, 0.051, 0.047, TRACK)
    return np.array([forward - yaw_rate * offset, 0.0, yaw_rate])


def _icr_twist(speeds: np.ndarray, left: float, right: float, ahead: float, alphas) -> np.ndarray:
    # A side's tread moves with the body's velocity at its centre of rotation: V_side = vx - y_side * yaw.
    treads = RADIUS * np.asarray(alphas) * speeds
    forward, yaw_rate = np.linalg.solve([[1, -right], [1, -left]], treads)
    return np.array([forward, -ahead * yaw_rate, yaw_rate])


def _tricycle_twist(inputs: np.ndarray, radius: float, wheelbase: float, offset, gain=1.0) -> np.ndarray:
    # The velocity of the steered wheel, seen from the free axle's middle.
    velocity = radius * inputs[0] * np.exp(1j * (gain * inputs[1] + offset))
    return np.array([velocity.real, 0.0, velocity.imag / wheelbase])


def _ackermann_twist(inputs: np.ndarray, radius: float, wheelbase: float, offset, gain) -> np.ndarray:
    speed = radius * inputs[0]
    turning_radius = wheelbase / np.tan(gain * inputs[1] + offset)
    return np.array([speed, 0.0, speed / turning_radius])


def _trailer_angle(
    state: np.ndarray, twist: np.ndarray, period: float, parameters: np.ndarray, steps: int = 100
) -> np.ndarray:
    """The trailer's angle, from where its axle's middle is dragged: no velocity across the trailer."""
    offset, length = parameters[3:5]

    def rate(angle: float) -> float:
        # The hitch's velocity in the tractor's frame, and what of it is across the trailer.
        ahead, left = twist[0], -offset * twist[2]
        return (left * np.cos(angle) - ahead * np.sin(angle)) / length - twist[2]

    angle, step = float(state[3]), period / steps
    for _ in range(steps):
        first = rate(angle)
        second = rate(angle + step / 2 * first)
        third = rate(angle + step / 2 * second)
        fourth = rate(angle + step * third)
        angle += step / 6 * (first + 2 * second + 2 * third + fourth)
    return np.array([angle])


def _slip_twist(inputs: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Of all effects: track + k |yaw rate| + k s, s by the angle whose tangent is turning over driving."""
    right, left = np.array(parameters[:2]) * inputs
    track, per_yaw_rate, per_curvature = parameters[-6:-3]
    turning, driving = np.abs(np.subtract(*inputs)) / 2, np.hypot(np.sum(inputs) / 2, 0.1 / np.sqrt(2))
    tightness = np.sin(np.arctan2(turning, driving)) ** 2
    asked = np.hypot((right - left) / track, 0.05) - 0.05
    yaw_rate = (right - left) / (track + per_yaw_rate * asked + per_curvature * tightness)
    return _slid((right + left) / 2, yaw_rate, parameters)


def _slid(speed: float, yaw_rate: float, parameters: np.ndarray) -> np.ndarray:
    """About a centre of its own, and outwards as far as friction has to hold it in its bend."""
    ahead, beside, drift = parameters[-3:]
    outwards = drift * speed * yaw_rate * np.hypot(yaw_rate, 0.01)
    return np.array([speed + beside * yaw_rate, -ahead * yaw_rate - outwards, yaw_rate])


def _lagging(begin: float, asked: float, period: float, lag: float, steps: int) -> tuple[float, float]:
    """A rate after a period, and its integral over it, by small steps of its differential equation."""
    rate, turned, step = float(begin), 0.0, period / steps
    for _ in range(steps):
        slopes = [(asked - rate) / lag]
        for share in (step / 2, step / 2, step):
            slopes.append((asked - rate - share * slopes[-1]) / lag)
        turned += step * (rate + step / 6 * (slopes[0] + slopes[1] + slopes[2]))
        rate += step / 6 * (slopes[0] + 2 * slopes[1] + 2 * slopes[2] + slopes[3])
    return rate, turned


def _lagging_yaw_rate(
    state: np.ndarray, twist: np.ndarray, period: float, parameters: np.ndarray, steps: int = 100
) -> np.ndarray:
    return np.array([_lagging(state[3], twist[2], period, parameters[3], steps)[0]])


def _lagging_twist(
    state: np.ndarray, twist: np.ndarray, period: float, parameters: np.ndarray, steps: int = 100
) -> np.ndarray:
    turned = _lagging(state[3], twist[2], period, parameters[3], steps)[1]
    mean = turned / period if period else state[3]
    return _slid(twist[0] - parameters[-2] * twist[2], mean, parameters)


def _lagging_commands(
    state: np.ndarray, twist: np.ndarray, period: float, parameters: np.ndarray, steps: int = 100
) -> np.ndarray:
    rates = zip(state[3:], twist[[0, 2]], parameters[-2:], strict=True)
    return np.array([_lagging(begin, asked, period, lag, steps)[0] for begin, asked, lag in rates])


def _lagging_commands_twist(
    state: np.ndarray, twist: np.ndarray, period: float, parameters: np.ndarray, steps: int = 100
) -> np.ndarray:
    rates = zip(state[3:], twist[[0, 2]], parameters[-2:], strict=True)
    ways = [_lagging(begin, asked, period, lag, steps)[1] for begin, asked, lag in rates]
    speed, yaw_rate = np.array(ways) / period if period else state[3:]
    return np.array([speed, 0.0, yaw_rate])


def _commanded_twist(inputs: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """Speed and yaw rate are [[gain_v, v_per_omega], [omega_per_v, gain_omega]] @ what is asked for."""
    speed, yaw_rate = gains @ inputs
    return np.array([speed, 0.0, yaw_rate])


SLIP = {
    "wheel_radius_right": 0.051,
    "wheel_radius_left": 0.047,
    "track": TRACK,
    "track_per_yaw_rate": 0.02,
    "track_per_curvature": 0.07,
    "x_icr": -0.03,
    "y_icr": 0.02,
    "drift": 0.03,
}

RADII_OF_FOUR = {
    "wheel_radius_front_left": 0.05,
    "wheel_radius_front_right": 0.052,
    "wheel_radius_rear_left": 0.049,
    "wheel_radius_rear_right": 0.047,
}
RADII_OF_THREE = {
    "wheel_radius_front_left": 0.04,
    "wheel_radius_rear": 0.043,
    "wheel_radius_front_right": 0.038,
}
COMMANDED = {"gain_v": 0.95, "gain_omega": 0.85, "omega_per_v": 0.06, "v_per_omega": -0.02}
GAINS = np.array([[0.95, -0.02], [0.06, 0.85]])

EXAMPLES: dict[str, tuple[Example, ...]] = {
    "differential_drive": (
        _two_sided("differential", DifferentialDrive(wheel_radius=RADIUS, track=TRACK), (RADIUS, RADIUS)),
        _two_sided(
            "differential_unequal",
            DifferentialDrive(wheel_radius_right=0.051, wheel_radius_left=0.047, track=TRACK),
            (0.051, 0.047),
        ),
    ),
    "skid_steer": (
        _two_sided("skid_no_slip", SkidSteer(wheel_radius=RADIUS, track=TRACK), (RADIUS, RADIUS)),
        _two_sided(
            "skid_slip",
            SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=0.12, slip_inner=-0.05),
            (RADIUS, RADIUS),
            (0.12, -0.05),
        ),
    ),
    "offset_drive": (
        Example(
            "offset",
            OffsetDrive(wheel_radius_right=0.051, wheel_radius_left=0.047, track=TRACK, sensor_offset=0.03),
            lambda speeds: _offset_twist(speeds, 0.03),
        ),
    ),
    "skid_steer_icr": (
        Example(
            "icr",
            SkidSteerIcr(
                wheel_radius=RADIUS,
                y_icr_left=0.17,
                y_icr_right=-0.15,
                x_icr=-0.02,
                alpha_right=0.95,
                alpha_left=0.9,
            ),
            lambda speeds: _icr_twist(speeds, 0.17, -0.15, -0.02, (0.95, 0.9)),
        ),
    ),
    "skid_steer_slip": (
        Example(
            "slip",
            SkidSteerSlip(**SLIP),
            lambda inputs: _slip_twist(inputs, np.array(list(SLIP.values()))),
        ),
        Example(
            "slip_with_lag",
            SkidSteerSlip(**SLIP, yaw_lag=0.25),
            lambda inputs: _slip_twist(inputs, np.array(list(SLIP.values()))),
            internal=_lagging_yaw_rate,
            mean=_lagging_twist,
        ),
    ),
    "tricycle": (
        Example(
            "tricycle",
            Tricycle(wheel_radius=0.1, wheelbase=0.4, steering_offset=0.03),
            lambda inputs: _tricycle_twist(inputs, 0.1, 0.4, 0.03),
        ),
        Example(
            "tricycle_with_gain",
            Tricycle(wheel_radius=0.1, wheelbase=0.4, steering_offset=0.03, steering_gain=0.93),
            lambda inputs: _tricycle_twist(inputs, 0.1, 0.4, 0.03, 0.93),
        ),
    ),
    "ackermann": (
        Example(
            "ackermann",
            Ackermann(wheel_radius=0.05, wheelbase=0.33, steering_offset=-0.02, steering_gain=1.1),
            lambda inputs: _ackermann_twist(inputs, 0.05, 0.33, -0.02, 1.1),
        ),
    ),
    "mecanum": (
        Example(
            "mecanum",
            Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.3),
            _wheels_twist(_mecanum(0.3), 0.05),
        ),
        Example(
            "mecanum_unequal",
            Mecanum(**RADII_OF_FOUR, half_wheelbase_plus_half_track=0.3),
            _wheels_twist(_mecanum(0.3), np.array(list(RADII_OF_FOUR.values()))),
        ),
    ),
    "omni_three": (
        Example(
            "omni",
            OmniThree(wheel_radius=0.04, centre_distance=0.2),
            _wheels_twist(_omni(0.2), 0.04),
        ),
        Example(
            "omni_unequal",
            OmniThree(**RADII_OF_THREE, centre_distance=0.2),
            _wheels_twist(_omni(0.2), np.array(list(RADII_OF_THREE.values()))),
        ),
    ),
    "unicycle": (
        Example(
            "unicycle",
            Unicycle(gain_v=0.95, gain_omega=0.85),
            lambda inputs: _commanded_twist(inputs, np.diag([0.95, 0.85])),
        ),
        Example(
            "unicycle_with_lags",
            Unicycle(**COMMANDED, lag_v=0.2, lag_omega=0.35),
            lambda inputs: _commanded_twist(inputs, GAINS),
            internal=_lagging_commands,
            mean=_lagging_commands_twist,
        ),
    ),
    "tractor_trailer": tuple(
        Example(
            name,
            TractorTrailer(wheel_radius=RADIUS, track=TRACK, hitch_offset=offset, trailer_length=0.4),
            lambda speeds: oracle.differential_twist(speeds, RADIUS, RADIUS, TRACK),
            internal=_trailer_angle,
        )
        for name, offset in (("trailer", 0.1), ("trailer_on_axle", 0.0))
    ),
}

EXAMPLES["bicycle_dynamic"] = tuple(
    Example(
        name,
        BicycleDynamic(**car, substeps=2),
        partial(cars.steady_twist, car=car),
        motion=partial(cars.motion, names=list(car), steps=2),
    )
    for name, car in (("bicycle", cars.CAR), ("bicycle_all_effects", cars.EFFECTS))
)

EXAMPLES["python"] = (
    Example(
        "python",
        PythonRobot(
            object="oed.robots.models.differential_drive:OffsetDrive",
            wheel_radius_right=0.051,
            wheel_radius_left="4.7 cm",
            track=TRACK,
            sensor_offset=0.03,
        ).made(Model),
        lambda speeds: _offset_twist(speeds, 0.03),
    ),
)

ROBOTS = [example for examples in EXAMPLES.values() for example in examples]
PLANAR = [example for example in ROBOTS if len(example.model.states) == 3]
TWO_SIDED = [example for example in PLANAR if len(example.model.coefficient_names) == 2]
COEFFICIENT_ROBOTS = [example for example in ROBOTS if example.model.coefficient_names]

CORE = ("differential", "skid_slip", "ackermann", "mecanum", "trailer")
"""One of every sort. What hardly depends on a robot is tried on the others where there is time."""


def cases(examples: list[Example]) -> list:
    """Parameters for pytest: the examples by name, all but those of `CORE` marked slow."""
    return [
        pytest.param(one, id=one.name, marks=() if one.name in CORE else pytest.mark.slow) for one in examples
    ]


LARGEST = {
    "wheel_speed": 10.0,
    "steering_angle": 0.5,
    "commanded_speed": 0.5,
    "commanded_yaw_rate": 2.0,
    "throttle": 1.0,
}
"""Magnitude of the inputs drawn, by quantity."""


def draw_inputs(rng: np.random.Generator, count: int, model: Model | None = None) -> np.ndarray:
    """Inputs (count, inputs) whose magnitudes are far apart, so that the outer side is beyond doubt."""
    inputs = 2 if model is None else len(model.inputs)
    magnitudes = np.linspace(1.0, 9.0, inputs) + rng.uniform(-0.9, 0.9, (count, inputs))
    drawn = rng.permuted(magnitudes * rng.choice([-1.0, 1.0], (count, inputs)), axis=1)
    return drawn if model is None else sized(drawn, model)


def draw_state(rng: np.random.Generator, model: Model) -> np.ndarray:
    """A state (states,); nothing on tyres slides sideways fast."""
    slow = np.array([0.1 if name == "lateral_speed" else 1.0 for name in model.states])
    return slow * rng.uniform(-2, 2, len(slow))


def sized(tenths, model: Model) -> np.ndarray:
    """Inputs (..., inputs) from tenths of the largest that are drawn."""
    return np.array(tenths) * [LARGEST[entry.quantity] / 10 for entry in model.inputs]


def twist_of(model: Model, inputs, parameters=None) -> np.ndarray:
    """The package's own twist, nominal unless there are parameters."""
    values = model.nominal if parameters is None else parameters
    return np.array(ca.evalf(model.twist(ca.DM(inputs), ca.DM(values)))).ravel()


Motion = Callable[[np.ndarray, np.ndarray], np.ndarray]


@cache
def motion_by_parameters(robot: Example) -> Motion:
    """A robot's twist for inputs and any values of its parameters; of unlisted robots by the package."""
    if robot.model.kind in ("differential_drive", "skid_steer", "tractor_trailer"):

        def motion(inputs, parameters):
            right, left, track, *slips = parameters
            speeds = oracle.skid_speeds(inputs, *slips) if robot.model.kind == "skid_steer" else inputs
            return oracle.differential_twist(speeds, right, left, track)

        return motion
    if robot.model.kind == "skid_steer_slip":
        return lambda inputs, parameters: _slip_twist(
            inputs, np.concatenate([parameters[:3], parameters[-5:]])
        )
    inputs, parameters = ca.SX.sym("u", len(robot.model.inputs)), ca.SX.sym("p", len(robot.model.nominal))
    twist = ca.Function("twist", [inputs, parameters], [robot.model.twist(inputs, parameters)])
    return lambda inputs, parameters: np.array(twist(inputs, parameters)).ravel()


@cache
def motion_by_coefficients(robot: Example) -> Motion:
    """The same for any values of its coefficients c11, c12, ..., its other constants nominal."""

    def motion(inputs, coefficients):
        rows = len(robot.model.coefficient_names)
        yaw_rate, forward, *sideways = np.reshape(coefficients, (rows, -1)) @ robot.effective(inputs)
        return np.array([forward, sideways[0] if sideways else 0.0, yaw_rate])

    return motion
