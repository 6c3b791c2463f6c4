"""A robot with a right and a left side as a controller sees it: radii, a distance, limits on its speeds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

from oed.robots.limits import BodySpeed, Limit, YawRateLimit
from oed.robots.models import Model

Pair = tuple[float, float]


@dataclass(frozen=True)
class Sides:
    """Effective wheel radii of both sides and the sides' distance [m].

    Forward speed (r_R w_R + r_L w_L) / 2, yaw rate (r_R w_R - r_L w_L) / separation, of the point midway.
    """

    radius_right: float
    radius_left: float
    separation: float

    @property
    def sound(self) -> bool:
        """Whether all three are positive and finite."""
        sizes = (self.radius_right, self.radius_left, self.separation)
        return all(isfinite(size) and size > 0 for size in sizes)

    def forward(self, right: Pair, left: Pair) -> Pair:
        """Least and largest forward motion for wheel motion within bounds (right, left)."""
        low, high = (
            (self.radius_right * one + self.radius_left * other) / 2
            for one, other in zip(right, left, strict=True)
        )
        return low, high

    def turning(self, right: Pair, left: Pair) -> Pair:
        """Least and largest yaw motion for wheel motion within bounds (right, left)."""
        low, high = (
            (self.radius_right * one - self.radius_left * other) / self.separation
            for one, other in zip(right, left[::-1], strict=True)
        )
        return low, high


def controller_limits(model: Model, sides: Sides, limits: Iterable[Limit]) -> dict[str, Any]:
    """A study's limits as the groups `linear` and `angular` of the parameters of ros2_control's
    diff_drive_controller; {} where no limit is known.

    The limits on body speed and yaw rate themselves, and the largest that the limits on the wheels allow: a
    straight, and a turn in place. At both at once the wheels may still be asked for more than they can.
    The controller's limit on acceleration makes ramps of the steps between commands.

    Args:
        model: the robot.
        sides: its radii and track, which turn wheel speeds into motion.
        limits: the study's.
    """
    known = tuple(limits)
    speed = _tightest(model, [limit.input_bounds(model) for limit in known])
    rate = _tightest(model, [limit.rate_bounds(model) for limit in known])
    groups = {
        ("linear", "x"): (_both(sides.forward(*speed), known, BodySpeed), sides.forward(*rate)),
        ("angular", "z"): (_both(sides.turning(*speed), known, YawRateLimit), sides.turning(*rate)),
    }
    found = {name: _group(*pair) for name, pair in groups.items()}
    return {group: {axis: entries} for (group, axis), entries in found.items() if entries}


def _tightest(model: Model, tables: list[dict[str, Pair]]) -> tuple[Pair, Pair]:
    # Of the right and the left wheel, in the order of the robot's inputs.
    right, left = (_within([table[name] for table in tables if name in table]) for name in model.input_names)
    return right, left


def _within(pairs: Iterable[Pair]) -> Pair:
    # A controller that may not stop its robot would be no safer.
    low, high = -inf, inf
    for least, most in pairs:
        low, high = max(low, least), min(high, most)
    return min(low, 0.0), max(high, 0.0)


def _both(bounds: Pair, limits: tuple[Limit, ...], kind: type[BodySpeed | YawRateLimit]) -> Pair:
    return _within([bounds, *(limit.bounds for limit in limits if isinstance(limit, kind))])


def _group(velocity: Pair, acceleration: Pair) -> dict[str, Any]:
    # The switches are those of releases up to Jazzy; later ones go by the numbers alone.
    entries: dict[str, Any] = {}
    if all(map(isfinite, velocity)):
        low, high = velocity
        entries |= {"has_velocity_limits": True, "max_velocity": float(high), "min_velocity": float(low)}
    # Without a number of its own, braking is limited as speeding up is.
    most = min(acceleration[1], -acceleration[0])
    if isfinite(most) and most > 0:
        entries |= {"has_acceleration_limits": True, "max_acceleration": float(most)}
    return entries
