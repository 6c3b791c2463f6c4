"""Limits on how the body moves: speed, turning, what the tyres have to hold."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, ClassVar, Literal

import casadi as ca
import numpy as np
import numpy.typing as npt
from pydantic import Field

from oed.foundation.errors import Flaw
from oed.foundation.quantities import Length, Unit
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System, follows_state
from oed.kernel.limit import BareLimit, LinearBound, Rows, TwoSided, magnitude, rest_flaws
from oed.robots.models.model import robot_of
from oed.robots.models.twists import moves_sideways

Array = npt.NDArray[np.float64]
Acceleration = Annotated[float, Unit("m/s^2", "0.5 m/s^2")]
CREEP = 2e-3
"""Yaw rate [rad/s] over which a turning radius, which rest has none of, is rounded."""


class MotionLimit(BareLimit):
    """A limit on how the robot moves, at each instant by itself."""

    looks_at: ClassVar[Literal["state"]] = "state"

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


class BodySpeed(MotionLimit):
    """The speed of the robot's origin within `bounds` [m/s]: forwards positive, backwards negative.

    A robot that also moves sideways keeps the whole speed below the larger bound.
    """

    name: ClassVar[str] = "body_speed"
    bounds: Annotated[tuple[float, float], TwoSided("m/s", "0.5 m/s")]

    def rows_at(self, motion: Expression, system: System) -> Rows:
        """Forward speed; and the magnitude, where there is lateral speed."""
        low, high = self.bounds
        forward, count = motion[:, 0], motion.shape[0]
        size = max(abs(low), abs(high))
        if not moves_sideways(robot_of(system)):
            return Rows(forward, np.full(count, low), np.full(count, high), size, "m/s")
        whole = magnitude(forward, motion[:, 1], size)
        lower, upper = np.full(2 * count, low), np.full(2 * count, high)
        lower[count:], upper[count:] = -np.inf, size
        return Rows(ca.vertcat(forward, whole), lower, upper, size, "m/s")

    def motion_bounds(self) -> dict[int, tuple[float, float]]:
        """The bounds of the forward speed; sideways no robot is faster than the larger bound."""
        size = max(map(abs, self.bounds))
        return {0: self.bounds, 1: (-size, size)}

    def flaws(self, system: System, space: Space) -> list[Flaw]:
        """Bounds that exclude rest."""
        return rest_flaws(self, [self.bounds], "m/s", space)


class YawRate(MotionLimit):
    """The yaw rate within `bounds` [rad/s], to the left positive."""

    name: ClassVar[str] = "yaw_rate"
    in_degrees: ClassVar[bool] = True
    bounds: Annotated[tuple[float, float], TwoSided("rad/s", "60 deg/s")]

    def rows_at(self, motion: Expression, system: System) -> Rows:
        """Yaw rate."""
        count, (low, high) = motion.shape[0], self.bounds
        size = max(abs(low), abs(high))
        return Rows(motion[:, 2], np.full(count, low), np.full(count, high), size, "rad/s")

    def motion_bounds(self) -> dict[int, tuple[float, float]]:
        """The bounds of the yaw rate."""
        return {2: self.bounds}

    def flaws(self, system: System, space: Space) -> list[Flaw]:
        """Bounds that exclude rest."""
        return rest_flaws(self, [self.bounds], "rad/s", space)


class LateralAcceleration(MotionLimit):
    """Speed times yaw rate at most `bounds` [m/s^2] to either side: what keeps tyres from slipping."""

    name: ClassVar[str] = "lateral_acceleration"
    bounds: Annotated[Acceleration, Field(gt=0)]

    def rows_at(self, motion: Expression, system: System) -> Rows:
        """Acceleration across the path; its magnitude, where there is lateral speed."""
        forward, lateral, yaw_rate = (motion[:, column] for column in range(3))
        across = forward * yaw_rate
        if moves_sideways(robot_of(system)):
            across = magnitude(across, lateral * yaw_rate, self.bounds)
        bound = np.full(motion.shape[0], self.bounds)
        return Rows(across, -bound, bound, self.bounds, "m/s^2")


class TurningRadius(MotionLimit):
    """Turns no tighter than radius `bounds` R [m]: speed at least R times the yaw rate.

    Its margin, in m, is R (v^2 - (R Omega)^2) / (v^2 + (R Omega)^2): close to the limit by how much wider
    than R the robot turns, R on a straight, -R in place. At rest it is 0, and rounded near it: in
    place -R / 3 at `CREEP`, and only below a twentieth of that (9e-5 rad/s) within what is tolerated.
    """

    name: ClassVar[str] = "turning_radius"
    bounds: Annotated[Length, Field(gt=0)]

    def rows_at(self, motion: Expression, system: System) -> Rows:
        """The margin, rounded at rest."""
        forward, lateral, yaw_rate = (motion[:, column] for column in range(3))
        radius = self.bounds
        speed, needed = forward**2 + lateral**2, (radius * yaw_rate) ** 2
        margin = radius * (speed - needed) / (speed + needed + 2 * (CREEP * radius) ** 2)
        count = motion.shape[0]
        return Rows(margin, np.zeros(count), np.full(count, np.inf), radius, "m")


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
