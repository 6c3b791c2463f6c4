"""The physics engine, MuJoCo, at work on one robot: the only place that imports it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import cos, radians
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.foundation.arrays import Array
from oed.foundation.errors import Failure
from oed.foundation.extras import extra
from oed.simulation.physics.description import describe
from oed.simulation.physics.robot import PhysicsRobot

PURPOSE = "simulating a robot's physics"
GRIPPING = 250.0
"""Rate at which a wheel that does not roll true stops sliding, below the limit of friction [1/s]."""
FASTEST_SLIDING = 3.0
"""Speed at which a wheel may slide before its contact loosens [m/s]."""
AT_REST = 1e-6
"""Speeds below which the robot stands still on its springs [m/s, rad/s]."""
LONGEST_SETTLING = 10.0
"""[s]."""
TIPPED = cos(radians(45))
"""Cosine of the tilt from which a robot is said to have fallen over: none drives on from there."""


def engine_library() -> Any:
    """MuJoCo.

    Raises:
        UserMistake: it is not installed.
        Failure: it cannot be loaded with the graphics library that the environment asks for.
    """
    try:
        return extra("mujoco", "physics", PURPOSE)
    except (AttributeError, ImportError, OSError, RuntimeError) as error:
        # It loads what MUJOCO_GL names at once, even if nothing is to be drawn.
        raise Failure(
            f"MuJoCo cannot be loaded: expected a graphics library that is there, or none, in the "
            f"environment variable MUJOCO_GL ({error})"
        ) from None


class Engine:
    """One robot on a plane floor, stepped through time."""

    def __init__(self, robot: PhysicsRobot, step: float | None = None) -> None:
        """Build it at the origin.

        Args:
            robot: to simulate.
            step: of time [s], instead of the robot's own.

        Raises:
            UserMistake: the engine is not installed.
        """
        self.mujoco = engine_library()
        self.robot = robot
        self.model = self.mujoco.MjModel.from_xml_string(describe(robot))
        if step is not None:
            self.model.opt.timestep = step
        self._set_contacts()
        self.data = self.mujoco.MjData(self.model)
        self._wheels = [int(self.model.joint(wheel.name).qposadr[0]) for wheel in robot.wheels]
        right = np.array([wheel.left < 0 for wheel in robot.wheels], dtype=float)
        self._sides = np.array([right / right.sum(), (1 - right) / (1 - right).sum()])

    def _set_contacts(self) -> None:
        # A contact of softness R aims at the acceleration -rate v - k depth [MuJoCo, Computation: Constraint
        # model]: beside a large R it is a spring k / R and a damper rate / R. A wheel that slides at v is
        # pushed up by the damper as if it moved into the floor at friction * v: one that is too strong
        # for the load makes sliding wheels hop, and the robot turn much less than it would.
        for place, (support, load) in enumerate(zip(self.robot.supports, self.robot.loads, strict=True)):
            damping = load / max(support.friction, 1) / FASTEST_SLIDING
            softness = GRIPPING / damping
            mobility = self.model.body_invweight0[self.model.body(support.name).id, 0]
            impedance = mobility / (mobility + softness)
            stiffness = self.robot.contact_stiffness * softness
            self.model.pair_solimp[place, :2] = impedance
            self.model.pair_solref[place] = -stiffness * impedance, -GRIPPING * impedance

    @property
    def pose(self) -> Array:
        """x, y [m] and heading [rad] of the robot's origin, (3,)."""
        x, y, _, *turned = self.data.qpos[:7]
        return np.array([x, y, _heading(turned)])

    @property
    def wheel_angles(self) -> Array:
        """That the right and the left wheels have turned, (2,) [rad]: the mean of each side's."""
        return np.asarray(self._sides @ self.data.qpos[self._wheels])

    def advance(self, wheel_speeds: npt.ArrayLike, steps: int) -> None:
        """Let time pass with the sides' wheel speeds commanded, (2,) right and left [rad/s].

        Raises:
            Failure: the simulation broke down or the robot tipped over.
        """
        # Both halves of every wheel's controller.
        self.data.ctrl[:] = np.tile(np.asarray(wheel_speeds) @ (self._sides > 0), 2)
        with self._unlogged():
            self.mujoco.mj_step(self.model, self.data, nstep=steps)
        self._check()

    def settle(self, start: Sequence[float]) -> None:
        """Let the robot come to rest on its springs, and put it at a start pose (3,) at time 0.

        Raises:
            Failure: it does not come to rest.
        """
        while not self._rests:
            if self.data.time > LONGEST_SETTLING:
                raise Failure(
                    f"the robot does not come to rest on its springs within {LONGEST_SETTLING:g} s: "
                    "expected stiffer or better damped ones"
                )
            self.advance((0, 0), round(0.1 / self.model.opt.timestep))
        data, turn = self.data, (start[2] - self.pose[2]) / 2
        turned = np.zeros(4)
        self.mujoco.mju_mulQuat(turned, np.array([np.cos(turn), 0, 0, np.sin(turn)]), data.qpos[3:7])
        data.qpos[:2], data.qpos[3:7], data.qpos[self._wheels] = start[:2], turned, 0.0
        data.qvel[:], data.qacc_warmstart[:], data.act[:], data.time = 0, 0, 0, 0

    def show(self, pose: npt.ArrayLike, wheel_angles: npt.ArrayLike) -> None:
        """Set a pose (3,) and wheel angles (2,) without simulating, for a picture."""
        x, y, heading = np.asarray(pose, dtype=float)
        height = self.robot.height
        self.data.qpos[:7] = x, y, height, np.cos(heading / 2), 0, 0, np.sin(heading / 2)
        self.data.qpos[self._wheels] = np.asarray(wheel_angles) @ (self._sides > 0)
        self.mujoco.mj_forward(self.model, self.data)

    @contextmanager
    def _unlogged(self) -> Iterator[None]:
        # The engine would write its warnings to a file in the working directory; `_check` sees what they say.
        before = self.mujoco.get_mju_user_warning()
        self.mujoco.set_mju_user_warning(lambda text: None)
        try:
            yield
        finally:
            self.mujoco.set_mju_user_warning(before)

    @property
    def _rests(self) -> bool:
        return bool(self.data.time > 0 and np.max(np.abs(self.data.qvel)) < AT_REST)

    def _check(self) -> None:
        if not np.all(np.isfinite(self.data.qpos)) or not np.all(np.isfinite(self.data.qvel)):
            raise Failure(
                f"the simulation broke down at {self.data.time:.3g} s: expected a step of less than "
                f"{self.model.opt.timestep:g} s"
            )
        _, across, along, _ = self.data.qpos[3:7]
        if 1 - 2 * (across**2 + along**2) < TIPPED:
            raise Failure(
                f"the robot tipped over at {self.data.time:.3g} s: expected gentler speeds or a lower "
                "centre of mass"
            )


def _heading(quaternion: Sequence[float]) -> float:
    w, x, y, z = quaternion
    return float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
