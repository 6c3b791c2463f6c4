"""Sizes that no robot has and no drive takes: valid numbers that hardly mean what they say."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from math import hypot, inf, isfinite, pi
from typing import TYPE_CHECKING, Any

from oed.foundation.errors import Issue
from oed.foundation.quantities import Unit, parse_quantity

if TYPE_CHECKING:
    from oed.kernel.problem import Problem

Key = tuple[str | int, ...]

LONGEST = 24 * 3600.0
"""Duration [s] beyond which no drive is meant: a day."""
FARTHEST = 1e6
"""Size [m] of a room beyond which none is meant: a thousand kilometres."""
WIDEST = 1e3
"""Size [m] of a robot beyond which none is meant."""
LARGEST_WHEEL = 2.5
"""Radius [m] of a wheel beyond which none is meant: the largest tyres made have 2 m."""
METRES = 1.0
"""Least size [m] of a robot that looks like a number without its unit: it was in mm, cm or inches."""
WHEELS = 2.0
"""How many times any other length of its robot a wheel's radius is that is taken for a mistake."""
SMALL_WHEEL = 100.0
"""How many times its wheels' radius a robot is long that is taken for a mistake, where there is no room."""
NOISY = 1 / 8
"""Share of the room's shorter side that is no noise of a position."""
LEAST_NOISE = 0.5
"""Least noise [m] that looks like a number without its unit."""
UNSURE = 0.5
"""Noise [rad, rad/s] of an angle, or of its rate, beyond which none is meant."""
LATE = 10.0
"""Latency, or lag [s], beyond which none is meant."""
SIGHT = 1e5
"""Distance [m] beyond which nothing is seen from the ground: a hundred kilometres."""
FULL_TURN = 2 * pi
OTHER_UNITS = {"m": ("cm", "mm"), "rad": ("deg",), "rad/s": ("deg/s",), "s": ("ms",)}
"""SI unit -> units that are often left out."""


def size_issues(robot: object, problem: Problem) -> Iterator[Issue]:
    """Durations, rooms, robots, noise and places of absurd sizes: of which a unit is missing, or wrong.

    Args:
        robot: of the problem.
        problem: whose parts are looked at.
    """
    yield from _question(("trajectory", "duration"), problem.design.duration, "s", LONGEST, "a day")
    shorter, longer = _room(problem)
    if FARTHEST < longer < inf:
        text = f"the room is {longer / 1e3:g} km across, too far for a robot: is its unit right?"
        yield Issue(("limits", "workspace"), text)
    yield from _robot_issues(robot, shorter)
    yield from _noise_issues(problem, shorter)
    yield from _sensor_issues(problem, shorter)
    yield from _angle_issues(problem)


def _room(problem: Problem) -> tuple[float, float]:
    # Its shorter and longer side [m], infinite where nothing bounds it.
    bounds = {name: pair for one in problem.limits for name, pair in one.state_bounds().items()}
    sides = [high - low for low, high in (bounds.get(name, (-inf, inf)) for name in ("x", "y"))]
    return min(sides), max(sides)


def _robot_issues(robot: object, room: float) -> Iterator[Issue]:
    for name, size in _sizes(robot, "s"):
        yield from _question(("robot", name), size, "s", LATE, f"{LATE:g} s")
    # How far the body reaches is compared with the room by the room itself.
    lengths = {name: abs(size) for name, size in _sizes(robot, "m") if name != "body_radius"}
    wheels = {name: size for name, size in lengths.items() if name.startswith("wheel_radius")}
    others = {name: size for name, size in lengths.items() if name not in wheels}
    whole = WHEELS * max(others.values(), default=inf)
    for name, size in wheels.items():
        yield from _question(
            ("robot", name),
            size,
            "m",
            *min(
                (max(room / 2, METRES / 2), f"half of its room of {room:g} m"),
                (LARGEST_WHEEL, "any wheel has"),
                (whole or inf, f"{WHEELS:g} times the robot's other sizes"),
            ),
        )
    tallest = SMALL_WHEEL * max(wheels.values(), default=inf) if room == inf else inf
    for name, size in others.items():
        yield from _question(
            ("robot", name),
            size,
            "m",
            *min(
                (max(room, METRES), f"its room of {room:g} m"),
                (WIDEST, "any robot has"),
                (max(tallest, METRES), f"{SMALL_WHEEL:g} times its wheels' radius"),
            ),
        )


def _noise_issues(problem: Problem, room: float) -> Iterator[Issue]:
    known = {
        "m": (max(NOISY * room, LEAST_NOISE), f"an eighth of a room of {room:g} m"),
        "rad": (UNSURE, f"{UNSURE:g} rad"),
        "rad/s": (UNSURE, f"{UNSURE:g} rad/s"),
    }
    for place, sensor in _sensors(problem):
        for unit, most in known.items():
            for key, size in _noises(sensor, unit):
                yield from _question((*place, *key), size, unit, *most)


def _sensors(problem: Problem) -> list[tuple[Key, Any]]:
    if not problem.sensors:
        return [(("measurement",), problem.measurement)]
    return [(("measurement", place), sensor) for place, sensor in enumerate(problem.sensors)]


def _sensor_issues(problem: Problem, room: float) -> Iterator[Issue]:
    # When and where they read, and where what they see stands.
    for key, sensor in _sensors(problem):
        for name, size in _sizes(sensor, "s"):
            yield from _question((*key, name), size, "s", LATE, f"{LATE:g} s")
        most = min((max(room, METRES), f"its room of {room:g} m"), (WIDEST, "any robot has"))
        for part in ("lever_arm", "mounting"):
            # However little may be known of it.
            sizes = (one for one in _sizes(getattr(sensor, part, None), "m") if one[0] != "deviation")
            for name, size in sizes:
                yield from _question((*key, part, name), abs(size), "m", *most)
        places = getattr(sensor, "places", ())
        for number, one in enumerate(places):
            near = _whereabouts(problem) or [other[:2] for other in places if other is not one]
            far = min((hypot(one[0] - x, one[1] - y) for x, y in near), default=0.0)
            if far > SIGHT:
                text = f"is {far / 1e3:.4g} km from everything else, too far to be seen: is its unit right?"
                yield Issue((*key, f"{sensor.point}s", number), text)


def _whereabouts(problem: Problem) -> list[tuple[float, float]]:
    # Points that the robot is near, where its room or its starts say so.
    bounds = {name: pair for one in problem.limits for name, pair in one.state_bounds().items()}
    starts = problem.design.fixed_starts
    if {"x", "y"} <= bounds.keys() and all(map(isfinite, (*bounds["x"], *bounds["y"]))):
        return list(product(bounds["x"], bounds["y"]))
    return [] if starts is None or not problem.designed else [(x, y) for x, y, *_ in starts.tolist()]


def _noises(sensor: object, unit: str) -> Iterator[tuple[Key, float]]:
    yield from (((name,), size) for name, size in _sizes(sensor, unit) if name == "noise")
    inside = _sizes(getattr(sensor, "noise", None), unit)
    yield from ((("noise", name), size) for name, size in inside)


def _angle_issues(problem: Problem) -> Iterator[Issue]:
    starts, units = problem.design.fixed_starts, problem.model.state_units
    for start in [] if starts is None else starts.tolist():
        for size in [abs(value) for value, unit in zip(start, units, strict=False) if unit == "rad"]:
            yield from _question(("trajectory", "start", "heading"), size, "rad", FULL_TURN, "a full turn")
    angles = [entry.name for entry in problem.model.inputs if entry.unit == "rad"]
    for limit in problem.limits:
        pairs = limit.input_bounds(problem.model).items()
        sizes = {max(map(abs, pair)) for name, pair in pairs if name in angles}
        for size in sizes | {abs(size) for _, size in _sizes(limit, "rad")}:
            yield from _question(("limits", limit.name), size, "rad", FULL_TURN, "a full turn")


def _question(key: Key, size: float, unit: str, most: float, what: str) -> Iterator[Issue]:
    # People give sizes with few digits; one that is computed has not lost its unit.
    if size > most and float(f"{size:.3g}") == size:
        given = f"{size:g}"
        meant = [one for one in OTHER_UNITS[unit] if parse_quantity(f"{given} {one}", unit) <= most]
        hint = f"did you mean '{given} {meant[0]}'?" if meant else "is its unit right?"
        yield Issue(key, f"{given} is taken as {given} {unit}, more than {what}; {hint}")


def _sizes(part: object, unit: str) -> Iterator[tuple[str, float]]:
    # The fields of a part that are quantities of this unit.
    for name, field in getattr(type(part), "model_fields", {}).items():
        value: Any = getattr(part, name)
        if isinstance(value, float) and any(
            isinstance(one, Unit) and one.si == unit for one in _notes(field)
        ):
            yield name, value


def _notes(field: Any) -> Iterator[Any]:
    # What annotations say of a field, those inside of `... | None` too.
    waiting = [field.rebuild_annotation()]
    while waiting:
        one = waiting.pop()
        yield from getattr(one, "__metadata__", ())
        waiting += getattr(one, "__args__", ())
        origin = getattr(one, "__origin__", None)
        waiting += [] if origin is None or isinstance(origin, type) else [origin]
