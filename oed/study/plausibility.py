"""Sizes that no robot has and no drive takes: valid numbers that hardly mean what they say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from oed.foundation.errors import Flaw
from oed.foundation.quantities import Unit
from oed.foundation.text import significant
from oed.kernel.dynamics.space import Space
from oed.robots.limits import Limit
from oed.robots.limits.workspace import workspace_of
from oed.robots.models import Model

LONGEST = 1e7
"""Duration [s] beyond which no drive is meant: four months."""
YEAR = 365.25 * 24 * 3600
FARTHEST = 1e6
"""Size [m] of a room beyond which none is meant: a thousand kilometres."""
WIDEST = 1e3
"""Size [m] of a robot beyond which none is meant."""
MUCH_LARGER = 4.0
"""How many times as long as the room's longer side a size of the robot is that is taken for a mistake."""
METRES = 1.0
"""Least size [m] of a robot that looks like a number without its unit: it was in mm, cm or inches."""


def size_flaws(robot: Model, space: Space, limits: Sequence[Limit]) -> Iterator[Flaw]:
    """Durations, rooms and robots of absurd sizes, and robots that are larger than their room.

    Args:
        robot: of the study.
        space: of its drives.
        limits: that they satisfy.
    """
    if space.duration > LONGEST:
        years = significant(2)(space.duration / YEAR)
        text = f"{space.duration:g} s are {years} years, too long for a drive: is its unit right?"
        yield Flaw(("trajectory", "duration"), text)
    room = workspace_of(limits)
    side = FARTHEST
    if room is not None:
        x_min, x_max, y_min, y_max = room.extent
        side = max(x_max - x_min, y_max - y_min)
    if FARTHEST < side < float("inf"):
        text = f"the room is {side / 1e3:g} km across, too far for a robot: is its unit right?"
        yield Flaw(("limits", "workspace"), text)
    largest, what = min((MUCH_LARGER * side, "its room"), (WIDEST, "any robot"))
    for name, size in _lengths(robot):
        if abs(size) > max(largest, METRES) and _as_written(size):
            where = f" of {side:g} m" if what == "its room" else ""
            text = f"{size:g} m is larger than {what}{where}: is a unit missing, or wrong? e.g. '{size:g} cm'"
            yield Flaw(("robot", name), text)


def _as_written(size: float) -> bool:
    # People give sizes with few digits; one that is computed has not lost its unit.
    return float(f"{size:.3g}") == size


def _lengths(robot: Model) -> Iterator[tuple[str, float]]:
    # As the study gives them; how far the body reaches is compared with the room by the room itself.
    for name, field in type(robot).model_fields.items():
        value: Any = getattr(robot, name)
        is_length = any(isinstance(one, Unit) and one.si == "m" for one in _notes(field))
        if name != "body_radius" and isinstance(value, float) and is_length:
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
