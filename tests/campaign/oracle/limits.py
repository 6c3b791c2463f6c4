"""Limits on the true motion, looked at densely: between samples, at both ends of each period, at every knot.

Each check gives how far a limit is exceeded at most, in the limit's unit; negative where it is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_interp_spline

from .robots import Robot, Twist, robot_of
from .shapes import obstacle_clearance, obstacle_size, room_clearance, room_size
from .splines import Run
from .track import Track

Array = npt.NDArray[Any]

CREEP = 2e-3
"""Yaw rate [rad/s] over which a turning radius is rounded at rest, as its documentation states."""
HEADING_TOLERANCE, PLACE_TOLERANCE = pi / 180, 0.01
"""Of ends, where a study says none [rad, m]."""


_INPUTS = {
    "wheel_speed": (0, "wheel_speed"),
    "wheel_acceleration": (1, "wheel_speed"),
    "wheel_jerk": (2, "wheel_speed"),
    "steering_angle": (0, "steering_angle"),
    "steering_rate": (1, "steering_angle"),
    "commanded_speed": (0, "v"),
    "commanded_acceleration": (1, "v"),
    "commanded_yaw_rate": (0, "omega"),
    "commanded_yaw_acceleration": (1, "omega"),
}
"""Which derivative each limit on inputs bounds, and how the names of its inputs begin."""


@dataclass(frozen=True)
class Excess:
    """How far a drive exceeds a limit at most.

    Attributes:
        limit: its key in a study.
        amount: in its unit, negative where it is kept.
        size: what a tolerance is a share of.
    """

    limit: str
    amount: float
    size: float


def excesses(study: Mapping[str, Any], runs: Sequence[Run], points: int = 200) -> list[Excess]:
    """Every limit's excess over all runs, looked at `points` times a sample and knot interval, and finer
    where walls and obstacles are close.
    """
    robot = robot_of(study["robot"])
    found: dict[str, Excess] = {}
    for run in runs:
        for one in _of_run(study, robot, run, points):
            before = found.get(one.limit)
            if before is None or one.amount > before.amount:
                found[one.limit] = one
    return list(found.values())


def _of_run(study: Mapping[str, Any], robot: Robot, run: Run, points: int) -> Iterator[Excess]:
    limits, space = study["limits"], study["trajectory"]
    track = Track(robot, run, space.get("integration", "arc"))
    for name, (checked, quantity) in _INPUTS.items():
        if name in limits:
            yield _inputs(name, limits[name], robot, _values(run, checked, points), quantity)
    twists = None
    for name, check in _BODY.items():
        if name in limits:
            twists = twists or motions(robot, run, track, points)
            yield check(limits[name], robot, twists)
    if "turning_radius" in limits and robot.lag is None and run.degree:
        yield _turning(limits["turning_radius"], robot, _about_to_turn(limits["turning_radius"], robot, run))
    yield from _places(limits, robot, track, points)
    yield from _ends(limits, robot, run, track)


def _values(run: Run, order: int, points: int) -> Array:
    # What bounds an input or a derivative of it; of what has no derivative, that of the straight lines from
    # the first value through what is held in each period's middle on to the last value.
    if order == 0:
        return run.held if run.degree == 0 else np.vstack([run.dense(0, points), run.held])
    if order <= run.degree:
        return run.dense(order, points)
    times = np.concatenate([[0.0], (np.arange(run.samples) + 0.5) * run.period, [run.duration]])
    values = np.vstack([run.coefficients[:1], run.held, run.coefficients[-1:]])
    slopes = make_interp_spline(times, values, k=1).derivative()
    nudge = run.period / 8
    if order == 1:
        return slopes(np.concatenate([times[:-1] + nudge, times[1:] - nudge]))
    # Their acceleration jumps at every period's middle, the first and the last included: a motor that needs
    # a period for a change of it has this jerk.
    return (slopes(times[1:-1] + nudge) - slopes(times[1:-1] - nudge)) / run.period


def pair(bounds: Any) -> tuple[float, float]:
    """(min, max) of a bound given as one number or as two."""
    return (
        (float(bounds[0]), float(bounds[1])) if isinstance(bounds, list) else (-float(bounds), float(bounds))
    )


def _inputs(name: str, bounds: Any, robot: Robot, values: Array, quantity: str) -> Excess:
    own = [entry for entry in robot.inputs if entry.startswith(quantity)]
    each = {entry: pair(bounds[entry] if isinstance(bounds, Mapping) else bounds) for entry in own}
    amount = -np.inf
    for entry, (low, high) in each.items():
        column = values[:, robot.inputs.index(entry)]
        if len(column):
            amount = max(amount, float(column.max() - high), float(low - column.min()))
    return Excess(name, amount, max(abs(bound) for both in each.values() for bound in both))


def motions(robot: Robot, run: Run, track: Track, points: int) -> Twist:
    """Twists that a limit on motion looks at: of the splines at all times and of what is held of them; where
    the yaw rate lags, what the robot truly does from the beginning to the end of every period.
    """
    if robot.lag is not None:
        return track.lagging(points)
    return _asked(robot, run.held if run.degree == 0 else np.vstack([run.dense(0, points), run.held]))


def _asked(robot: Robot, values: Array) -> Twist:
    # The twists of inputs (K, inputs).
    nominal = [np.array([[value]]) for value in robot.values]
    return tuple(np.ravel(np.broadcast_to(one, (1, len(values)))) for one in robot.asked(values, nominal))


def _body_speed(bounds: Any, robot: Robot, twists: Twist) -> Excess:
    low, high = pair(bounds)
    size = max(abs(low), abs(high))
    amount = max(float(twists[0].max() - high), float(low - twists[0].min()))
    if robot.sideways:
        amount = max(amount, float(np.hypot(twists[0], twists[1]).max() - size))
    return Excess("body_speed", amount, size)


def _yaw_rate(bounds: Any, robot: Robot, twists: Twist) -> Excess:
    low, high = pair(bounds)
    amount = max(float(twists[2].max() - high), float(low - twists[2].min()))
    return Excess("yaw_rate", amount, max(abs(low), abs(high)))


def _lateral(bound: Any, robot: Robot, twists: Twist) -> Excess:
    speed = np.hypot(twists[0], twists[1]) if robot.sideways else twists[0]
    return Excess("lateral_acceleration", float(np.abs(speed * twists[2]).max() - bound), float(bound))


def _turning(radius: Any, robot: Robot, twists: Twist) -> Excess:
    return Excess("turning_radius", float(_lacking(radius, twists).max()), float(radius))


def _lacking(radius: Any, twists: Twist) -> Array:
    speed, needed = twists[0] ** 2 + twists[1] ** 2, (radius * twists[2]) ** 2
    return radius * (needed - speed) / (needed + speed + 2 * (CREEP * radius) ** 2)


def _about_to_turn(radius: Any, robot: Robot, run: Run, points: int = 200, places: int = 40) -> Twist:
    # The twists around the tightest turns: a robot that reverses turns on the spot for less than the time
    # from one point to the next.
    breaks = np.unique(run.knots)
    inside = np.linspace(1e-6, 1 - 1e-6, points)
    times = breaks[:-1, None] + np.diff(breaks)[:, None] * inside
    steps = np.diff(breaks) / points
    for _ in range(4):
        twists = _asked(robot, run.at(0, times.ravel()))
        lacking = _lacking(radius, twists).reshape(times.shape)
        rows = np.argsort(-lacking.max(axis=1))[:places]
        best = np.take_along_axis(times[rows], lacking[rows].argmax(axis=1)[:, None], axis=1)
        times, steps = best + 2 * steps[rows, None] * np.linspace(-1, 1, points), 4 * steps[rows] / points
        # Nobody looks past a knot.
        piece = np.clip(np.searchsorted(breaks, best, side="right") - 1, 0, len(breaks) - 2)
        margin = 1e-6 * np.diff(breaks)[piece]
        times = np.clip(times, breaks[piece] + margin, breaks[piece + 1] - margin)
    return _asked(robot, run.at(0, times.ravel()))


_BODY: dict[str, Callable[[Any, Robot, Twist], Excess]] = {
    "body_speed": _body_speed,
    "yaw_rate": _yaw_rate,
    "lateral_acceleration": _lateral,
    "turning_radius": _turning,
}


def _places(limits: Mapping[str, Any], robot: Robot, track: Track, points: int) -> Iterator[Excess]:
    radius = robot.body_radius
    if "trailer_angle" in limits:
        low, high = pair(limits["trailer_angle"])
        angles = track.trailer(points)
        amount = max(float(angles.max() - high), float(low - angles.min()))
        yield Excess("trailer_angle", amount, max(abs(low), abs(high)))
    if "workspace" in limits:
        room = limits["workspace"]
        clearance = track.least(lambda x, y: room_clearance(room, x, y), points, radius)
        yield Excess("workspace", radius - clearance, room_size(room))
    if "obstacles" in limits:
        size = min(obstacle_size(one) for one in limits["obstacles"]) + radius
        clearances = [
            track.least(lambda x, y, one=one: obstacle_clearance(one, x, y), points, radius)
            for one in limits["obstacles"]
        ]
        yield Excess("obstacles", radius - min(clearances), size)


def _ends(limits: Mapping[str, Any], robot: Robot, run: Run, track: Track) -> Iterator[Excess]:
    if "path_length" in limits:
        amount = float(np.hypot(track.mean[0], track.mean[1]).sum() * run.period)
        yield Excess("path_length", amount - limits["path_length"], float(limits["path_length"]))
    first, last = track.states[:3, 0], track.states[:3, -1]
    if "end_position" in limits:
        given = limits["end_position"]
        given = {"at": given} if isinstance(given, str) else given
        place = given.get("at", given)
        wanted = first[:2] if place == "start" else np.array([place["x"], place["y"]])
        tolerance = float(given.get("tolerance", PLACE_TOLERANCE))
        yield Excess("end_position", float(np.hypot(*(last[:2] - wanted))) - tolerance, tolerance)
    if "end_heading" in limits:
        given = limits["end_heading"]
        given = given if isinstance(given, Mapping) else {"at": given}
        wanted = first[2] if given["at"] == "start" else given["at"]
        tolerance = float(given.get("tolerance", HEADING_TOLERANCE))
        away = abs((last[2] - wanted + pi) % (2 * pi) - pi)
        yield Excess("end_heading", float(away) - tolerance, tolerance)
