"""What encoders and a pose sensor would have logged of a simulated drive."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import UserMistake
from oed.foundation.quantities import Unit
from oed.logs.log import Log
from oed.robots.sensors.pose_noise import AbsoluteNoise, Quantity
from oed.simulation.physics.driving import Motion

Frequency = Annotated[float, Unit("Hz", "10 Hz")]

QUANTITIES: tuple[Quantity, ...] = ("x", "y", "heading")


class Sensing(Component):
    """Wheel encoders, and a sensor that reads absolute poses of the robot's origin.

    Attributes:
        pose_rate: of the pose sensor [Hz]; encoders are read as often as the motion was logged.
        noise: of one pose; without any where it says nothing.
        ticks_per_turn: steps of an encoder in a turn of its wheel; exact if None.
    """

    pose_rate: Annotated[Frequency, Field(gt=0)] = 10.0
    noise: AbsoluteNoise = AbsoluteNoise(position=0.001, heading=0.002)
    ticks_per_turn: Annotated[int, Field(gt=0)] | None = None

    @field_validator("noise")
    @classmethod
    def _is_of_one_pose(cls, noise: AbsoluteNoise) -> AbsoluteNoise:
        if noise.covariance is not None and len(noise.covariance) != len(QUANTITIES):
            raise ValueError(f"expected the covariance (3, 3) of one pose, got {len(noise.covariance)} rows")
        return noise

    def read(self, motion: Motion, rng: np.random.Generator, name: str = "simulated drive") -> Log:
        """The log of a motion.

        Args:
            motion: as it truly was.
            rng: of the poses' noise and of where between two ticks encoders begin.
            name: of the drive.

        Raises:
            UserMistake: poses are read more often than the motion was logged.
        """
        rows = self._pose_rows(motion)
        speeds, yaw_rates = (rates[rows] for rates in _rates(motion))
        encoded = self._encoded(motion.wheel_angles, rng)
        return Log(
            name=name,
            file=name,
            input_times=motion.times,
            integrals=encoded,
            pose_times=motion.times[rows],
            poses=motion.poses[rows] + self.noise.drawn(QUANTITIES, speeds, yaw_rates, rng),
            quantities=QUANTITIES,
        )

    def _pose_rows(self, motion: Motion) -> npt.NDArray[np.intp]:
        times = motion.times
        usual = float(np.median(np.diff(times)))
        if 1 / self.pose_rate < usual * (1 - 1e-6):
            raise UserMistake(
                f"expected a motion logged at {self.pose_rate:g} Hz or more, as its poses are read, "
                f"got one at {1 / usual:g} Hz"
            )
        count = math.floor(times[-1] * self.pose_rate + 1e-6) + 1
        wanted = np.arange(count) / self.pose_rate
        return np.unique(np.searchsorted(times, wanted - usual / 2).clip(max=len(times) - 1))

    def _encoded(self, angles: Array, rng: np.random.Generator) -> Array:
        if self.ticks_per_turn is None:
            return angles
        tick = 2 * math.pi / self.ticks_per_turn
        ticks = np.floor(angles / tick + rng.random(angles.shape[1]))
        return np.asarray(tick * (ticks - ticks[0]))


def _rates(motion: Motion) -> tuple[Array, Array]:
    # Speeds of the robot's origin [m/s] and yaw rates [rad/s], (n,) each.
    x, y, yaw_rates = np.gradient(motion.poses, motion.times, axis=0).T
    return np.asarray(np.hypot(x, y)), np.asarray(yaw_rates)
