"""Driving a simulated robot: what its wheels and its body truly did, and pictures of that."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oed.foundation.arrays import Array, Places
from oed.foundation.errors import Failure, UserMistake
from oed.simulation.physics.description import CAMERA
from oed.simulation.physics.engine import Engine
from oed.simulation.physics.robot import PhysicsRobot

Picture = npt.NDArray[np.uint8]

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


def _logged_steps(total: int, step: float, rate: float) -> Places:
    ticks = np.arange(math.floor(total * step * rate + 1e-9) + 1) / rate
    return np.union1d(np.minimum(np.rint(ticks / step), total), [total]).astype(np.int64)


def frames(
    robot: PhysicsRobot, motion: Motion, *, rate: float = 10.0, size: tuple[int, int] = (480, 640)
) -> Iterator[Picture]:
    """Pictures (height, width, 3) of a drive, `rate` of them a second, from behind and above the robot.

    Args:
        robot: that drove.
        motion: its drive.
        rate: [1/s].
        size: height and width [pixels].

    Raises:
        UserMistake: the engine is not installed.
        Failure: nothing to draw with.
    """
    engine = Engine(robot)
    try:
        renderer = engine.mujoco.Renderer(engine.model, *size)
    except Exception as error:
        # Every drawing library fails in a way of its own.
        raise Failure(
            "found no way to draw without a screen: expected a graphics library, chosen by the environment "
            f"variable MUJOCO_GL=egl or MUJOCO_GL=osmesa before the program starts ({error})"
        ) from None
    try:
        for row in _rows(motion.times, rate):
            engine.show(motion.poses[row], motion.wheel_angles[row])
            renderer.update_scene(engine.data, CAMERA)
            yield np.array(renderer.render())
    finally:
        renderer.close()


def _rows(times: Array, rate: float) -> npt.NDArray[np.intp]:
    wanted = np.arange(0, times[-1] + 1e-9, 1 / rate)
    return np.asarray(np.searchsorted(times, wanted - 1e-9).clip(max=len(times) - 1))
