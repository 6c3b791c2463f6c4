"""Relative poses, as lidar scan matching and visual odometry give them: how the sensor has moved."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca
from pydantic import model_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Flaw
from oed.foundation.quantities import Angle, Length
from oed.foundation.text import count, given_text
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.measurement import Measurement, Nuisance
from oed.kernel.measurement.sensor import Moment, Sensor, When
from oed.robots.sensors.logged import PLACE, LoggedSensor, Mount, Noise
from oed.robots.sensors.placed import PosePrior, place_text
from oed.robots.sensors.pose_noise import UNITS, AbsoluteNoise, Quantity

READ: tuple[Quantity, ...] = ("x", "y", "heading")
"""What is read of a motion."""


class Mounting(Component):
    """How a sensor is mounted on the robot.

    Attributes:
        x, y: where it sits, ahead of the robot's origin and to its left [m].
        heading: by how much it is turned to the left [rad].
        known: whether that is known; else it is estimated along with the parameters.
        deviation: standard deviations of what is known of it beforehand.
    """

    x: Length = 0.0
    y: Length = 0.0
    heading: Angle = 0.0
    known: bool = False
    deviation: PosePrior | None = None

    @model_validator(mode="after")
    def _deviation_of_what_is_unknown(self) -> Mounting:
        if self.known and self.deviation is not None:
            raise ValueError("a deviation belongs to a mounting that is estimated: omit it, or known: true")
        return self

    @property
    def place(self) -> tuple[float, float, float]:
        """Ahead, to the left [m], turned [rad]."""
        return self.x, self.y, self.heading

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of what is known of it beforehand, by the names of `PLACE`."""
        if self.deviation is None:
            return {}
        each = (self.deviation.position, self.deviation.position, self.deviation.heading)
        return dict(zip(PLACE, each, strict=True))


class RelativePoses(Sensor):
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
        if self.mounting.known:
            return ()
        known = self.mounting.deviations
        return tuple(
            Nuisance(name, value, unit, known.get(name))
            for (name, unit), value in zip(PLACE.items(), self.mounting.place, strict=True)
        )

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

    def _pose(self, moment: Moment) -> tuple[Expression, Expression, Expression]:
        # Of the sensor.
        ahead, left, turned = (
            moment.nuisances.get(name, value) for name, value in zip(PLACE, self.mounting.place, strict=True)
        )
        x, y, heading = moment.state[0], moment.state[1], moment.state[2]
        cosine, sine = ca.cos(heading), ca.sin(heading)
        return x + ahead * cosine - left * sine, y + ahead * sine + left * cosine, heading + turned

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
        x, y, heading = self.mounting.place
        place = place_text(x, y) or "at the robot's origin"
        turned = f" and is turned by {given_text(heading, 'rad')}" if heading else ""
        return f"; the sensor sits {place}{turned}{'' if self.mounting.known else ', estimated too'}"

    def brief(self, samples: int) -> str:
        """How many are read."""
        return count(len(self.columns(samples)), "relative pose")

    @property
    def noises(self) -> dict[str, Noise]:
        """The noise of each quantity; {} of a covariance."""
        return self.noise.of_each(READ)

    @property
    def mount(self) -> Mount:
        """As it is mounted."""
        known = self.mounting.known
        return Mount(self.mounting.place, known, self.mounting.deviations, heading_fixed=known)

    def flaws(self, system: System, samples: int) -> list[Flaw]:
        """No motion within the drive, quantities without noise, a covariance of another size."""
        if self.every > samples:
            text = f"expected at most the drive's {samples} samples between readings, got {self.every}"
            return [Flaw(("measurement", "every"), text)]
        return self.noise.flaws(READ, len(self.columns(samples)))


def logged_sensors(measurement: Measurement, relative: bool) -> list[LoggedSensor]:
    """The sensors of a measurement that read what logs hold: their own motion if `relative`, else states."""
    return [
        sensor
        for sensor in measurement.joint_sensors
        if isinstance(sensor, LoggedSensor) and isinstance(sensor, RelativePoses) == relative
    ]
