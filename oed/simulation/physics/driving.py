"""Driving a simulated robot: from commanded wheel speeds to what its wheels and its body truly did."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oed.foundation.errors import UserMistake
from oed.simulation.physics.engine import Engine
from oed.simulation.physics.robot import PhysicsRobot

Array = npt.NDArray[np.float64]

RATE = 50.0
"""At which a motion is logged [1/s]."""


@dataclass(frozen=True)
class Motion:
    """A drive as it truly was; all SI.

    Attributes:
        times: (n,) [s], from 0.
        wheel_angles: turned since then by the right and the left wheels, as encoders on the motors see them,
            (n, 2) [rad]; of two wheels on a side the mean.
        poses: x, y, heading of the robot's origin, (n, 3); headings unwrapped.
        wheel_speeds: commanded, right and left, each held for `period`, (N, 2) [rad/s].
        period: [s].
    """

    times: Array
    wheel_angles: Array
    poses: Array
    wheel_speeds: Array
    period: float

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for array in (self.times, self.wheel_angles, self.poses, self.wheel_speeds):
            array.setflags(write=False)


def drive(
    robot: PhysicsRobot,
    wheel_speeds: npt.ArrayLike,
    period: float,
    *,
    start: npt.ArrayLike = (0.0, 0.0, 0.0),
    rate: float = RATE,
) -> Motion:
    """Simulate a drive from rest.

    Args:
        robot: that drives.
        wheel_speeds: commanded, right and left, (N, 2) [rad/s].
        period: for which each is held [s].
        start: x, y, heading, (3,).
        rate: at which the motion is logged [1/s], besides its end.

    Raises:
        UserMistake: inputs of another shape or not finite, or the engine is not installed.
        Failure: the simulation broke down or the robot tipped over.
    """
    speeds, place = _checked(wheel_speeds, period, start, rate)
    # Commands change between steps: the step divides their period.
    each = math.ceil(period / robot.step - 1e-9)
    step, total = period / each, each * len(speeds)
    engine = Engine(robot, step)
    engine.settle(place.tolist())
    logged = _logged_steps(total, step, rate)
    times, angles, poses, done = [], [], [], 0
    for edge in np.union1d(logged, each * np.arange(1, len(speeds) + 1)):
        if edge > done:
            engine.advance(speeds[done // each], int(edge) - done)
            done = int(edge)
        if edge in logged:
            times.append(done * step)
            angles.append(engine.wheel_angles)
            poses.append(engine.pose)
    track = np.array(poses)
    track[:, 2] = place[2] + np.unwrap(track[:, 2]) - track[0, 2]
    return Motion(np.array(times), np.array(angles), track, speeds, period)


def _checked(
    wheel_speeds: npt.ArrayLike, period: float, start: npt.ArrayLike, rate: float
) -> tuple[Array, Array]:
    speeds, place = np.array(wheel_speeds, dtype=float), np.array(start, dtype=float)
    if speeds.ndim != 2 or speeds.shape[1] != 2 or not len(speeds):
        raise UserMistake(f"expected wheel speeds, right and left, of shape (N, 2), got {speeds.shape}")
    if place.shape != (3,):
        raise UserMistake(f"expected a start pose x, y, heading, got shape {place.shape}")
    if not (np.all(np.isfinite(speeds)) and np.all(np.isfinite(place))):
        raise UserMistake("expected wheel speeds and a start pose that are finite")
    for name, value in (("period", period), ("rate", rate)):
        if not (math.isfinite(value) and value > 0):
            raise UserMistake(f"expected a positive {name}, got {value:g}")
    return speeds, place


def _logged_steps(total: int, step: float, rate: float) -> npt.NDArray[np.int64]:
    ticks = np.arange(math.floor(total * step * rate + 1e-9) + 1) / rate
    return np.union1d(np.minimum(np.rint(ticks / step), total), [total]).astype(np.int64)
