"""Limits on how the robot moves: speed, turning, what the tyres have to hold, its way, a trailer's angle."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue
from oed.foundation.quantities import Length, Unit
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System, follows_state, label_of
from oed.kernel.limit import BareLimit, LinearBound, PathLimit, Rows, TwoSided, magnitude, rest_issues
from oed.robots.models.model import robot_of
from oed.robots.models.twists import moves_sideways

Acceleration = Annotated[float, Unit("m/s^2", "0.5 m/s^2")]
CREEP = 2e-3
"""Yaw rate [rad/s] over which a turning radius, which rest has none of, is rounded."""
SOFT = 1e-4
"""Speed [m/s] over which the corner of the speed at rest is rounded, upwards, where a way is summed."""
TRAILER = "trailer_angle"
"""The state that a robot with a trailer has."""


class MotionLimit(BareLimit):
    """A limit on how the robot moves, at each instant by itself."""

    looks_at: ClassVar[Literal["state"]] = "state"
    unit: ClassVar[str]

    @abstractmethod
    def rows_at(self, motion: Expression, system: System) -> Rows:
        """The limit on twists (K, 3): what it asks of all of them, one thing after the other, (k * K,)."""

    def rows(self, drive: Drive) -> Rows:
        """The limit at every time checked."""
        return self.rows_at(drive.motion, drive.system)

    def motion_bounds(self) -> dict[int, tuple[float, float]]:
        """Bounds on parts of the twist, by their place: forward speed, lateral speed, yaw rate."""
        return {}

    def linear_bounds(self, system: System) -> Sequence[LinearBound]:
        """On the parts of the twist that are linear in the inputs; none for a robot that lags behind."""
        parts = {} if follows_state(system) else linear_motion(system)
        return [
            LinearBound(*parts[place], low, high)
            for place, (low, high) in self.motion_bounds().items()
            if place in parts
        ]

    def issues(self, system: System, space: Space) -> list[Issue]:
        """Bounds that exclude rest."""
        return rest_issues(self, self.motion_bounds().values(), self.unit, space)


class BodySpeed(MotionLimit):
    """The speed of the robot's origin within `bounds` [m/s]: forwards positive, backwards negative.

    A robot that also moves sideways keeps the whole speed below the larger bound.
    """

    name, unit = "body_speed", "m/s"
    bounds: Annotated[tuple[float, float], TwoSided("m/s", "0.5 m/s")]

    def rows_at(self, motion: Expression, system: System) -> Rows:
        """Forward speed; and the magnitude, where there is lateral speed."""
        low, high = self.bounds
        forward, count = motion[:, 0], motion.shape[0]
        size = max(abs(low), abs(high))
        if not moves_sideways(robot_of(system)):
            return Rows(forward, np.full(count, low), np.full(count, high), size, self.unit)
        whole = magnitude(forward, motion[:, 1], size)
        lower, upper = np.full(2 * count, low), np.full(2 * count, high)
        lower[count:], upper[count:] = -np.inf, size
        return Rows(ca.vertcat(forward, whole), lower, upper, size, self.unit)

    def motion_bounds(self) -> dict[int, tuple[float, float]]:
        """The bounds of the forward speed; sideways no robot is faster than the larger bound."""
        size = max(map(abs, self.bounds))
        return {0: self.bounds, 1: (-size, size)}


class YawRateLimit(MotionLimit):
    """The yaw rate within `bounds` [rad/s], to the left positive."""

    name, unit, in_degrees = "yaw_rate", "rad/s", True
    bounds: Annotated[tuple[float, float], TwoSided("rad/s", "60 deg/s")]

    def rows_at(self, motion: Expression, system: System) -> Rows:
        """Yaw rate."""
        count, (low, high) = motion.shape[0], self.bounds
        size = max(abs(low), abs(high))
        return Rows(motion[:, 2], np.full(count, low), np.full(count, high), size, self.unit)

    def motion_bounds(self) -> dict[int, tuple[float, float]]:
        """The bounds of the yaw rate."""
        return {2: self.bounds}


class LateralAcceleration(MotionLimit):
    """Speed times yaw rate at most `bounds` [m/s^2] to either side: what keeps tyres from slipping."""

    name, unit = "lateral_acceleration", "m/s^2"
    bounds: Annotated[Acceleration, Field(gt=0)]

    def rows_at(self, motion: Expression, system: System) -> Rows:
        """Acceleration across the path; its magnitude, where there is lateral speed."""
        forward, lateral, yaw_rate = (motion[:, column] for column in range(3))
        across = forward * yaw_rate
        if moves_sideways(robot_of(system)):
            across = magnitude(across, lateral * yaw_rate, self.bounds)
        bound = np.full(motion.shape[0], self.bounds)
        return Rows(across, -bound, bound, self.bounds, self.unit)


class TurningRadius(MotionLimit):
    """Turns no tighter than radius `bounds` R [m]: speed at least R times the yaw rate.

    Its margin, in m, is R (v^2 - (R Omega)^2) / (v^2 + (R Omega)^2): close to the limit by how much wider
    than R the robot turns, R on a straight, -R in place. At rest it is 0, and rounded near it: in
    place -R / 3 at `CREEP`, and only below a twentieth of that (9e-5 rad/s) within what is tolerated.
    """

    name, unit, loosened = "turning_radius", "m", "a turning radius {amount} smaller"
    bounds: Annotated[Length, Field(gt=0)]

    def rows_at(self, motion: Expression, system: System) -> Rows:
        """The margin, rounded at rest."""
        forward, lateral, yaw_rate = (motion[:, column] for column in range(3))
        radius = self.bounds
        speed, needed = forward**2 + lateral**2, (radius * yaw_rate) ** 2
        margin = radius * (speed - needed) / (speed + needed + 2 * (CREEP * radius) ** 2)
        count = motion.shape[0]
        return Rows(margin, np.zeros(count), np.full(count, np.inf), radius, self.unit)


class PathLength(BareLimit):
    """Each run no longer than `bounds` [m], as its battery (or cable) allows."""

    name: ClassVar[str] = "path_length"
    looks_at: ClassVar[Literal["run"]] = "run"
    bounds: Annotated[Length, Field(gt=0)]

    def rows(self, drive: Drive) -> Rows:
        """One row per run: the distance that its origin travels, at most a tenth of a millimetre per second
        more.
        """
        twist = drive.signals["twist"]
        steps = ca.sqrt(twist[:, 0] ** 2 + twist[:, 1] ** 2 + SOFT**2) * drive.period
        lengths = ca.vertcat(*(ca.sum1(run) for run in ca.vertsplit(steps, drive.samples)))
        return Rows(lengths, np.full(drive.runs, -np.inf), np.full(drive.runs, self.bounds), self.bounds, "m")


class TrailerAngleLimit(BareLimit, PathLimit):
    """The trailer's angle within `bounds` [rad]: 0 straight behind, before the trailer jackknifes."""

    name: ClassVar[str] = "trailer_angle"
    in_degrees: ClassVar[bool] = True
    bounds: Annotated[tuple[float, float], TwoSided("rad", "60 deg")]

    def rows_at(self, path: Expression, system: System) -> Rows:
        """The angle at every point."""
        angle = path[:, system.states.index(TRAILER)]
        count, (low, high) = angle.shape[0], self.bounds
        return Rows(angle, np.full(count, low), np.full(count, high), max(abs(low), abs(high)), "rad")

    def issues(self, system: System, space: Space) -> list[Issue]:
        """A robot without a trailer, or bounds that exclude 0, where every run begins."""
        low, high = self.bounds
        if TRAILER not in system.states:
            text = f"{label_of(system)} has no trailer"
        elif not low <= 0 <= high:
            text = f"[{low:g}, {high:g}] rad excludes 0, where every run begins"
        else:
            return []
        return [Issue(("limits", self.name), text)]


@lru_cache(maxsize=32)
def linear_motion(system: System) -> dict[int, tuple[Array, float]]:
    """Slopes (inputs,) and offset of each part of the twist that is linear in the inputs, by its place."""
    inputs = ca.SX.sym("inputs", len(system.inputs))
    twist = robot_of(system).twist(inputs, ca.DM(system.nominal))
    slopes = ca.jacobian(twist, inputs)
    at_rest = ca.Function("at_rest", [inputs], [slopes, twist])(0)
    table, offsets = np.array(at_rest[0]), np.array(at_rest[1]).ravel()
    return {
        place: (row, float(offset))
        for place, (row, offset) in enumerate(zip(table, offsets, strict=True))
        if not ca.depends_on(slopes[place, :], inputs) and np.isfinite([*row, offset]).all()
    }
