"""Pictures of a simulated drive, where the machine can draw without a screen."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from oed.foundation.errors import Failure
from oed.simulation.physics.description import CAMERA
from oed.simulation.physics.driving import Motion
from oed.simulation.physics.engine import Engine
from oed.simulation.physics.robot import PhysicsRobot

Picture = npt.NDArray[np.uint8]


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


def _rows(times: npt.NDArray[np.float64], rate: float) -> npt.NDArray[np.intp]:
    wanted = np.arange(0, times[-1] + 1e-9, 1 / rate)
    return np.asarray(np.searchsorted(times, wanted - 1e-9).clip(max=len(times) - 1))
