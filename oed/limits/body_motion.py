"""Limits on how the body moves: speed, turning, what the tyres have to hold."""

from __future__ import annotations

from typing import Annotated, ClassVar

import casadi as ca
import numpy as np
from pydantic import Field

from oed.errors import Flaw
from oed.limits.limit import BareLimit, Rows, TwoSided, magnitude, rest_flaws
from oed.models.model import Model, moves_sideways
from oed.quantities import Length, Unit
from oed.rollout import Drive
from oed.trajectory import DesignSpace

Acceleration = Annotated[float, Unit("m/s^2", "0.5 m/s^2")]
CREEP = 2e-3
"""Speed [m/s] per metre of turning radius by which a robot may be too slow for its yaw rate."""
SOFT = 1e-3
"""Speed [m/s] over which the corner of a speed at rest is rounded, for optimisers."""


class BodySpeed(BareLimit):
    """The speed of the robot's origin within `bounds` [m/s]: forwards positive, backwards negative.

    A robot that also moves sideways keeps the whole speed below the larger bound.
    """

    name: ClassVar[str] = "body_speed"
    bounds: Annotated[tuple[float, float], TwoSided("m/s", "0.5 m/s")]

    def rows(self, drive: Drive) -> Rows:
        """Forward speed at every time checked; and the magnitude, where there is lateral speed."""
        low, high = self.bounds
        forward, count = drive.motion[:, 0], drive.motion.shape[0]
        size = max(abs(low), abs(high))
        if not moves_sideways(drive.model):
            return Rows(forward, np.full(count, low), np.full(count, high), size, "m/s")
        whole = magnitude(forward, drive.motion[:, 1], size)
        lower, upper = np.full(2 * count, low), np.full(2 * count, high)
        lower[count:], upper[count:] = -np.inf, size
        return Rows(ca.vertcat(forward, whole), lower, upper, size, "m/s")

    def motion_bounds(self) -> dict[int, tuple[float, float]]:
        """Of the forward speed; sideways no robot is faster than the larger bound."""
        size = max(map(abs, self.bounds))
        return {0: self.bounds, 1: (-size, size)}

    def flaws(self, model: Model, space: DesignSpace) -> list[Flaw]:
        """Bounds that exclude rest."""
        return rest_flaws(self, [self.bounds], "m/s", space)


class YawRate(BareLimit):
    """The yaw rate within `bounds` [rad/s], to the left positive."""

    name: ClassVar[str] = "yaw_rate"
    bounds: Annotated[tuple[float, float], TwoSided("rad/s", "60 deg/s")]

    def rows(self, drive: Drive) -> Rows:
        """Yaw rate at every time checked."""
        count, (low, high) = drive.motion.shape[0], self.bounds
        return Rows(
            drive.motion[:, 2],
            np.full(count, low),
            np.full(count, high),
            max(abs(low), abs(high)),
            "rad/s",
        )

    def motion_bounds(self) -> dict[int, tuple[float, float]]:
        """Of the yaw rate."""
        return {2: self.bounds}

    def flaws(self, model: Model, space: DesignSpace) -> list[Flaw]:
        """Bounds that exclude rest."""
        return rest_flaws(self, [self.bounds], "rad/s", space)


class LateralAcceleration(BareLimit):
    """Speed times yaw rate at most `bounds` [m/s^2] to either side: what keeps tyres from slipping."""

    name: ClassVar[str] = "lateral_acceleration"
    bounds: Annotated[Acceleration, Field(gt=0)]

    def rows(self, drive: Drive) -> Rows:
        """Acceleration across the path at every time checked; its magnitude, where there is lateral speed."""
        forward, lateral, yaw_rate = (drive.motion[:, column] for column in range(3))
        across = forward * yaw_rate
        if moves_sideways(drive.model):
            across = magnitude(across, lateral * yaw_rate, self.bounds)
        bound = np.full(drive.motion.shape[0], self.bounds)
        return Rows(across, -bound, bound, self.bounds, "m/s^2")


class TurningRadius(BareLimit):
    """Turns no tighter than radius `bounds` [m]: speed at least that many times the yaw rate.

    Its margin is in m/s: how much faster the robot is than its yaw rate needs, with `CREEP` to spare, so
    that a robot at rest does not count as turning too tightly.
    """

    name: ClassVar[str] = "turning_radius"
    bounds: Annotated[Length, Field(gt=0)]

    def rows(self, drive: Drive) -> Rows:
        """|speed| - radius * |yaw rate| at every time checked, corners rounded alike."""
        forward, lateral, yaw_rate = (drive.motion[:, column] for column in range(3))
        speed = ca.sqrt(forward**2 + lateral**2 + SOFT**2)
        needed = ca.sqrt((self.bounds * yaw_rate) ** 2 + SOFT**2)
        count = drive.motion.shape[0]
        spare = np.full(count, -CREEP * self.bounds)
        return Rows(speed - needed, spare, np.full(count, np.inf), self.bounds, "m/s")
