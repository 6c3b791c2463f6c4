"""Random limits on inputs, on the body's motion and on where a run ends; rooms are in `rooms`."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np

from ..oracle.robots import Robot
from .quantities import Quantity, log_uniform, one_of

Rng = np.random.Generator


def draw_input_limits(
    rng: Rng, robot: Robot, speed: float, period: float, degree: int, *, rest: bool
) -> dict[str, Any]:
    """Limits on wheels and steering; `speed` is the fastest wheel's [rad/s]. Or on commands."""
    if robot.inputs == ("v", "omega"):
        return _draw_command_limits(rng, robot, speed, period, rest=rest)
    wheels = [name for name in robot.inputs if name.startswith("wheel_speed")]
    limits = {"wheel_speed": _each(rng, wheels, speed, "rad/s", zero=rest)}
    if rng.random() < 0.5:
        rate = speed / period * log_uniform(rng, 0.1, 10)
        limits["wheel_acceleration"] = _each(rng, wheels, rate, "rad/s^2", zero=True)
    if degree >= 2 and rng.random() < 0.25:
        jerk = speed / period**2 * log_uniform(rng, 0.1, 10)
        limits["wheel_jerk"] = _each(rng, wheels, jerk, "rad/s^3", zero=True)
    if "steering_angle" in robot.inputs:
        angle = float(rng.uniform(0.2, 1.1))
        limits["steering_angle"] = _each(rng, ["steering_angle"], angle, "rad", zero=True)
        if rng.random() < 0.4:
            rate = angle / period * log_uniform(rng, 0.1, 10)
            limits["steering_rate"] = _each(rng, ["steering_angle"], rate, "rad/s", zero=True)
    return limits


def _draw_command_limits(
    rng: Rng, robot: Robot, speed: float, period: float, *, rest: bool
) -> dict[str, Any]:
    # A robot turns as fast as its side moves that is `body_radius` away.
    limits = {}
    for name, entry, size, unit in (
        ("speed", "v", speed * robot.body_radius, "m/s"),
        ("yaw_rate", "omega", speed, "rad/s"),
    ):
        limits[f"commanded_{name}"] = _each(rng, [entry], size, unit, zero=rest)
        if rng.random() < 0.4:
            rate, of_rate = size / period * log_uniform(rng, 0.1, 10), name.replace("yaw_rate", "yaw_speed")
            limits[f"commanded_{of_rate.replace('speed', 'acceleration')}"] = _each(
                rng, [entry], rate, f"{unit}^2", zero=True
            )
    return limits


def _each(rng: Rng, names: list[str], size: float, unit: str, *, zero: bool) -> Any:
    sort = rng.random()
    if sort < 0.15:
        return {name: _pair(rng, size * rng.uniform(0.7, 1.0), unit, zero=zero) for name in names}
    return Quantity(size, unit) if sort < 0.7 else _pair(rng, size, unit, zero=zero)


def _pair(rng: Rng, size: float, unit: str, *, zero: bool) -> list[Quantity]:
    # Around 0, on one side of it, or well away from it where rest is not asked for.
    low = one_of(rng, (-size, -size * rng.uniform(0.1, 1), 0.0, *([] if zero else [0.3 * size])))
    return [Quantity(low, unit), Quantity(size, unit)]


def bounds_of(limits: dict[str, Any], robot: Robot) -> np.ndarray[Any, Any]:
    """Bounds (inputs, 2) of every input."""
    rows = []
    for name in robot.inputs:
        commands = {"v": "commanded_speed", "omega": "commanded_yaw_rate"}
        wheel = "wheel_speed" if name.startswith("wheel_speed") else "steering_angle"
        given = limits[commands.get(name, wheel)]
        given = given[name] if isinstance(given, dict) else given
        rows.append(given if isinstance(given, list) else (-given, given))
    return np.array(rows, dtype=float)


def draw_motion_limits(rng: Rng, robot: Robot, speed: float, turning: float) -> dict[str, Any]:
    """Limits on the body's motion, for the fastest speed [m/s] and yaw rate [rad/s]."""
    limits: dict[str, Any] = {}
    if rng.random() < 0.2:
        limits["body_speed"] = _around(rng, speed * rng.uniform(0.3, 1.2), "m/s")
    if rng.random() < 0.2:
        limits["yaw_rate"] = _around(rng, turning * rng.uniform(0.2, 1.2), "rad/s")
    if rng.random() < 0.2:
        limits["lateral_acceleration"] = Quantity(speed * turning * rng.uniform(0.05, 0.5), "m/s^2")
    if rng.random() < 0.1:
        limits["turning_radius"] = Quantity(speed / turning * log_uniform(rng, 0.05, 2), "m")
    if robot.trailer is not None and rng.random() < 0.5:
        limits["trailer_angle"] = _around(rng, rng.uniform(0.2, pi / 2), "rad")
    return limits


def _around(rng: Rng, size: float, unit: str) -> Any:
    if rng.random() < 0.7:
        return Quantity(size, unit)
    return [Quantity(-size * rng.uniform(0.1, 1), unit), Quantity(size, unit)]


def draw_end_limits(rng: Rng, way: float, place: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Limits on the path's length and its end, for a way [m] and a place that can be reached."""
    limits: dict[str, Any] = {}
    if rng.random() < 0.15:
        limits["path_length"] = Quantity(way * rng.uniform(0.1, 1.0), "m")
    if rng.random() < 0.1:
        at = {"x": Quantity(place[0], "m"), "y": Quantity(place[1], "m")}
        tolerance = {"tolerance": Quantity(way * log_uniform(rng, 1e-3, 0.3), "m")}
        limits["end_position"] = one_of(rng, ("start", {**at, **tolerance}, {"at": "start", **tolerance}))
    if rng.random() < 0.1:
        at = one_of(rng, ("start", Quantity(rng.uniform(-pi, pi), "rad")))
        limits["end_heading"] = {"at": at, "tolerance": Quantity(rng.uniform(0.02, 2.0), "rad")}
    return limits
