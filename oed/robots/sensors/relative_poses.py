"""Relative poses, as lidar scan matching and visual odometry give them: how the sensor has moved."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue
from oed.foundation.text import count, given_text
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.measurement import Measurement, sensors_of
from oed.kernel.measurement.sensor import Moment, When
from oed.robots.sensors.drift import DriftingSensor
from oed.robots.sensors.logged import LoggedSensor, Noise
from oed.robots.sensors.mounting import Mounting, Pose, place_text
from oed.robots.sensors.pose_noise import UNITS, AbsoluteNoise, Quantity

READ: tuple[Quantity, ...] = ("x", "y", "heading")
"""What is read of a motion."""


class RelativePoses(DriftingSensor):
    """The sensor's own motion x, y [m] and heading [rad] from every n-th sample to the next n-th.

    It is read in the sensor's frame at the earlier of the two, so that neither a map nor a start pose matters
    [Censi, Franchi, Marchionni, Oriolo, Simultaneous calibration of odometry and sensor parameters for mobile
    robots, 2013]. Errors of different motions are independent. Further states than the pose, as a trailer's
    angle, are taken to be known at the start.

    Attributes:
        mounting: of the sensor on the robot.
        noise: of one motion; what grows with speed does so with the mean speed of the sensor's motion.
    """

    kind: Literal["relative_poses"] = "relative_poses"
    when: ClassVar[When] = "between samples"
    mounting: Mounting = Mounting()
    noise: AbsoluteNoise = AbsoluteNoise()

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The mounting, where it is not known."""
        return self.mounting.nuisances

    @property
    def angles(self) -> tuple[int, ...]:
        """The turn."""
        return (READ.index("heading"),)

    def reading(self, moment: Moment) -> Expression:
        """The sensor's pose seen from where it was."""
        assert moment.earlier is not None
        x, y, heading = self._pose(moment)
        x_before, y_before, heading_before = self._pose(moment.earlier)
        ahead, left = x - x_before, y - y_before
        cosine, sine = ca.cos(heading_before), ca.sin(heading_before)
        return ca.vertcat(
            cosine * ahead + sine * left, cosine * left - sine * ahead, heading - heading_before
        )

    def _pose(self, moment: Moment) -> Pose:
        # Of the sensor.
        return self.mounting.pose((moment.state[0], moment.state[1], moment.state[2]), moment)

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma of each quantity at the motion's mean speed; a covariance's inverse Cholesky factor."""
        motion = ca.vertsplit(self.reading(moment) ** 2 / moment.elapsed**2)
        return self.noise.whitening(READ, motion[0] + motion[1], motion[2])

    @property
    def joint_whitening(self) -> Array | None:
        """The inverse Cholesky factor of a covariance of all readings."""
        return self.noise.joint_whitening(READ)

    @property
    def units(self) -> tuple[str, ...]:
        """Of x, y and heading."""
        return tuple(UNITS[name] for name in READ)

    @property
    def subject(self) -> str:
        """The motion."""
        return "the sensor's motion (x, y and heading) since the reading before"

    @property
    def noise_text(self) -> str:
        """Quantity by quantity, and how it grows."""
        return self.noise.text(READ)

    @property
    def remark(self) -> str:
        """How the sensor is mounted."""
        x, y, heading = self.mounting.sits
        place = place_text(x, y) or "at the robot's origin"
        turned = f" and is turned by {given_text(heading, 'rad')}" if heading else ""
        known = "" if self.mounting.known else ", estimated too"
        return f"; the sensor sits {place}{turned}{known}{self.drift_remark}"

    def brief(self, samples: int) -> str:
        """How many are read."""
        return count(len(self.columns(samples)), "relative pose")

    @property
    def noises(self) -> dict[str, Noise]:
        """The noise of each quantity; {} of a covariance."""
        return self.noise.of_each(READ)

    @property
    def mount(self) -> Mounting:
        """As it is mounted."""
        return self.mounting

    def issues(self, system: System, samples: int) -> list[Issue]:
        """No motion within the drive, quantities without noise, a covariance of another size."""
        if self.every > samples:
            text = f"expected at most the drive's {samples} samples between readings, got {self.every}"
            return [Issue(("measurement", "every"), text)]
        return self.noise.issues(READ, len(self.columns(samples)))


def logged_sensors(measurement: Measurement, relative: bool) -> list[LoggedSensor]:
    """The sensors of a measurement that read what logs hold: their own motion if `relative`, else states."""
    return [
        sensor
        for sensor in sensors_of(measurement)
        if isinstance(sensor, LoggedSensor) and isinstance(sensor, RelativePoses) == relative
    ]
