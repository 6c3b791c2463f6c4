"""What a node plays: the rows that a message says, with ramps where a drive does not begin or end at rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from oed.exporters.commands import Commands
from oed.exporters.request import Request
from oed.exporters.vehicle import Vehicle
from oed.foundation.arrays import ROUNDING, Array
from oed.foundation.errors import UserMistake
from oed.robots.limits import Limit
from oed.robots.models.arcs import chord

UNLIMITED = 1.0
"""Time [s] of a ramp where neither the study nor the drive says how fast inputs may change."""

Columns = tuple[tuple[str, ...], Array, tuple[bool, ...]]
"""Names with units, values (K, columns), and of each column whether it is a speed: slower drives scale it."""


@dataclass(frozen=True)
class Message:
    """A type of ROS message that commands a robot.

    Attributes:
        package, name: of the type.
        topic: on which controllers usually hear it.
        robots: which it commands, in words.
        fits: whether it commands a robot.
        columns: what it says of commands.
    """

    package: str
    name: str
    topic: str
    robots: str
    fits: Callable[[Vehicle], bool]
    columns: Callable[[Vehicle, Commands], Columns]


def _twists(vehicle: Vehicle, run: Commands) -> Columns:
    kept = [0, 1, 2] if vehicle.sideways else [0, 2]
    names = ("forward speed [m/s]", "lateral speed [m/s]", "yaw rate [rad/s]")
    return tuple(names[one] for one in kept), run.twists[:, kept], (True,) * len(kept)


def _steered(vehicle: Vehicle, run: Commands) -> Columns:
    place = [entry.quantity for entry in vehicle.inputs].index("steering_angle")
    values = np.column_stack([run.twists[:, 0], run.inputs[:, place]])
    return ("speed [m/s]", "steering angle [rad]"), values, (True, False)


def _wheels(vehicle: Vehicle, run: Commands) -> Columns:
    names = tuple(f"{entry.name} [{entry.unit}]" for entry in vehicle.inputs)
    return names, run.inputs, (True,) * len(names)


def _has_steering(vehicle: Vehicle) -> bool:
    return sorted(entry.quantity for entry in vehicle.inputs) == ["steering_angle", "wheel_speed"]


def _has_wheels_only(vehicle: Vehicle) -> bool:
    return all(entry.quantity == "wheel_speed" for entry in vehicle.inputs)


MESSAGES = {
    "twist_stamped": Message(
        "geometry_msgs", "TwistStamped", "/cmd_vel", "any robot", lambda _: True, _twists
    ),
    "twist": Message("geometry_msgs", "Twist", "/cmd_vel", "any robot", lambda _: True, _twists),
    "ackermann": Message(
        "ackermann_msgs",
        "AckermannDriveStamped",
        "/ackermann_cmd",
        "robots with a wheel speed and a steering angle",
        _has_steering,
        _steered,
    ),
    "joint_state": Message(
        "sensor_msgs",
        "JointState",
        "/joint_commands",
        "robots whose inputs are all wheel speeds",
        _has_wheels_only,
        _wheels,
    ),
    "float64_array": Message(
        "std_msgs",
        "Float64MultiArray",
        "/velocity_controller/commands",
        "robots whose inputs are all wheel speeds",
        _has_wheels_only,
        _wheels,
    ),
}
"""Messages by which a node commands a robot, by what they are asked for."""


def message_kind(vehicle: Vehicle, asked: str | None) -> str:
    """The name of the message that is asked for, or that suits a robot.

    Raises:
        UserMistake: there is none of that name, or it does not command such a robot, or nothing does.
    """
    pushing = [entry.name for entry in vehicle.inputs if entry.pushes]
    if pushing:
        text = f"no message commands a {pushing[0]}, which says no speed: take csv, json or rosbag2"
        raise UserMistake(text)
    kind = asked or ("ackermann" if _has_steering(vehicle) else "twist_stamped")
    if kind not in MESSAGES:
        raise UserMistake(f"message: expected one of {', '.join(MESSAGES)}, got {kind!r}")
    if not MESSAGES[kind].fits(vehicle):
        others = ", ".join(name for name, one in MESSAGES.items() if one.fits(vehicle))
        inputs = ", ".join(vehicle.input_names)
        raise UserMistake(
            f"message: {kind} commands {MESSAGES[kind].robots}; this one has {inputs}: take {others}"
        )
    return kind


@dataclass(frozen=True)
class PlayedRun:
    """A run as it is played, from rest to rest.

    Attributes:
        commands: its own, and those of the ramps before and after.
        lead: time [s] until its own begin.
    """

    commands: Commands
    lead: float

    @property
    def duration(self) -> float:
        """Time [s] until it is at rest."""
        return float(self.commands.times[-1])

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(np.hypot(*self.commands.twists[:, :2].T).sum() / self.commands.rate)

    @property
    def room(self) -> Array:
        """Least and largest x, then y, of the robot's origin [m], (2, 2)."""
        places = self.commands.poses[:, :2]
        return np.column_stack([places.min(axis=0), places.max(axis=0)])


def played_runs(request: Request) -> tuple[PlayedRun, ...]:
    """Every run of a drive at the design's own rate, from rest to rest.

    Where its first or last command is no step that the inputs may take at once, a ramp leads there: all
    speeds in proportion, along the arc of that command; what is steered is steered before, at standstill.
    """
    runs = _runs(request)
    limits = _largest_rates(request, runs)
    return tuple(_from_rest(run, limits) for run in runs)


def braking_time(request: Request) -> float:
    """Time [s] in which any speeds of a drive can be brought to 0, as fast as inputs may change."""
    runs = _runs(request)
    limits = _largest_rates(request, runs)
    return max(_ramp_time(inputs, run, limits) for run in runs for inputs in run.inputs)


def _runs(request: Request) -> tuple[Commands, ...]:
    return replace(request, rate=None).runs


def _largest_rates(request: Request, runs: tuple[Commands, ...]) -> Array:
    # Of each input, (inputs,): what the study allows, else the most that the drive itself asks for, and inf
    # where that says nothing.
    vehicle = request.vehicle
    limits = [one for one in vars(request.record.robot_study.limits).values() if isinstance(one, Limit)]
    tables = [] if vehicle.model is None else [one.rate_bounds(vehicle.model) for one in limits]
    found = []
    for place, name in enumerate(vehicle.input_names):
        allowed = [min(-low, high) for table in tables for low, high in [table.get(name, (-inf, inf))]]
        own = max(np.abs(np.diff(run.inputs[:-1, place])).max(initial=0.0) * run.rate for run in runs)
        found.append(min((one for one in allowed if 0 < one < inf), default=own or inf))
    return np.array(found)


def _ramp_time(inputs: Array, run: Commands, limits: Array) -> float:
    # From rest to speeds.
    speeds, rates = np.abs(inputs[run.moving]), limits[run.moving]
    times = np.where(np.isfinite(rates), speeds / rates, np.where(speeds > 0, UNLIMITED, 0.0))
    return float(times.max(initial=0.0))


def _from_rest(run: Commands, limits: Array) -> PlayedRun:
    steering, rising, falling = _steering(run, limits), _ramp(run, 0, limits), _ramp(run, -2, limits)
    before = [np.vstack(pair) for pair in zip(steering, rising, strict=True)]
    after = [one[::-1] for one in falling]
    own = run.inputs, run.twists
    inputs, twists = (
        np.vstack([first, middle[:-1], last, middle[-1:]])
        for first, middle, last in zip(before, own, after, strict=True)
    )
    poses = list(run.poses)
    for twist in before[1][::-1]:
        poses.insert(0, _moved(poses[0], twist, -1 / run.rate))
    for twist in after[1]:
        poses.append(_moved(poses[-1], twist, 1 / run.rate))
    commands = Commands(run.rate, inputs, run.moving, twists, np.array(poses))
    return PlayedRun(commands, len(before[0]) / run.rate)


def _ramp(run: Commands, place: int, limits: Array) -> tuple[Array, Array]:
    # Inputs and twists from rest to those of a command, without it; none where it is one step.
    inputs, twist = run.inputs[place], run.twists[place]
    count = math.ceil(_ramp_time(inputs, run, limits) * run.rate - ROUNDING)
    shares = (np.arange(count if count > 1 else 0)[:, None] + 0.5) / count if count else np.zeros((0, 1))
    return np.where(run.moving, shares * inputs, inputs), shares * twist


def _steering(run: Commands, limits: Array) -> tuple[Array, Array]:
    # What is steered, from straight ahead to where the run begins.
    angles = np.where(run.moving, 0.0, run.inputs[0])
    rates = np.where(np.isfinite(limits), limits, np.abs(angles) / UNLIMITED)
    turns = np.divide(np.abs(angles), rates, out=np.zeros_like(angles), where=angles != 0)
    count = math.ceil(turns.max() * run.rate - ROUNDING)
    shares = (np.arange(count)[:, None] + 1) / max(1, count)
    return shares * angles, np.zeros((count, 3))


def _moved(state: Array, twist: Array, seconds: float) -> Array:
    # Along the arc of a twist; what else the state has stays.
    forward, lateral, yaw_rate = twist
    gain, direction = map(float, chord(yaw_rate, state[2], seconds, "arc"))
    cosine, sine = math.cos(direction), math.sin(direction)
    moved = [gain * (forward * cosine - lateral * sine), gain * (forward * sine + lateral * cosine)]
    turn = seconds * yaw_rate
    return np.asarray(state + np.array([*moved, turn, *np.zeros(len(state) - 3)]))
