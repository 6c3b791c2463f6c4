"""Sensors of one number that is read with a constant bias: a gyroscope's yaw rate, a trailer's angle."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.errors import Issue
from oed.foundation.quantities import Angle, AngularSpeed, Ratio
from oed.foundation.text import count
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System, label_of
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.sensor import Moment, Sensor, Start
from oed.robots.sensors.logged import Noise
from oed.robots.sensors.prior import InitialPose, known_to, start_of

STATE = 3
"""Place of the trailer's angle among the states."""


class BiasedSensor(Sensor):
    """A quantity plus a bias.

    Attributes:
        name: of the quantity.
        noise: standard deviation of one reading, in `unit`.
        bias: "unknown" (eliminated), "known" (none), or the standard deviation of its prior, in `unit`.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    noise: float
    bias: str | float

    @abstractmethod
    def quantity(self, moment: Moment) -> Expression:
        """What is read, without noise and bias."""

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The bias, where it is not known."""
        known = known_to(self.bias)
        return () if known is None else (Nuisance("bias", 0.0, self.unit, known.get("")),)

    def reading(self, moment: Moment) -> Expression:
        """The quantity and the bias."""
        return self.quantity(moment) + moment.nuisances.get("bias", 0.0)

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma."""
        return ca.SX(1 / self.noise)

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of a reading."""
        return (self.unit,)

    def brief(self, samples: int) -> str:
        """How many are read."""
        return count(len(self.columns(samples)), self.name)

    @property
    def remark(self) -> str:
        """That there is no bias, where that is known."""
        return " and no bias" if self.bias == "known" else ""


class YawRate(BiasedSensor):
    """The yaw rate [rad/s] of every n-th period, times a scale, plus a constant bias.

    Attributes:
        noise: standard deviation of one reading [rad/s].
        bias: "unknown" (eliminated), "known", "resting" (unknown, at rest), or
            the standard deviation of its prior [rad/s].
        scale: what the yaw rate is multiplied by: "known" (1), "unknown", or the standard deviation of its
            prior.
    """

    kind: Literal["yaw_rate"] = "yaw_rate"
    name, unit = "yaw rate", "rad/s"
    when: ClassVar[Literal["at samples", "in periods"]] = "in periods"
    noise: Annotated[AngularSpeed, Field(gt=0)]
    bias: Literal["unknown", "known"] | Annotated[AngularSpeed, Field(gt=0)] = "unknown"
    scale: Literal["unknown", "known"] | Annotated[Ratio, Field(gt=0)] = "known"

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The bias and the scale, where they are not known."""
        known = known_to(self.scale)
        scale = () if known is None else (Nuisance("scale", 1.0, "", known.get("")),)
        return (*super().nuisances, *scale)

    def quantity(self, moment: Moment) -> Expression:
        """The yaw rate, as the scale has it."""
        return moment.nuisances.get("scale", 1.0) * moment.signals["twist"][2]

    @property
    def remark(self) -> str:
        """That there is no bias, where that is known; and a scale, where that is not."""
        return super().remark + ("" if self.scale == "known" else ", times a scale that is not known")


class TrailerAngle(BiasedSensor):
    """The trailer's heading relative to the tractor's [rad], at every n-th sample, plus a constant bias.

    Attributes:
        noise: standard deviation of one reading [rad].
        bias: the encoder's zero: "known", "unknown" (eliminated), or the standard deviation of its
            prior [rad].
        initial_pose: "unknown" (eliminated), "known", "resting" (unknown, at rest), or
            a prior's standard deviations.
    """

    kind: Literal["trailer_angle"] = "trailer_angle"
    name, unit = "trailer angle", "rad"
    noise: Annotated[Angle, Field(gt=0)]
    bias: Literal["unknown", "known"] | Annotated[Angle, Field(gt=0)] = "known"
    initial_pose: InitialPose = "unknown"

    @property
    def start_known(self) -> Start:
        """What is known of the initial pose, the trailer's angle among it."""
        return start_of(self.initial_pose)

    @property
    def angles(self) -> tuple[int, ...]:
        """The reading itself."""
        return (0,)

    def quantity(self, moment: Moment) -> Expression:
        """The angle."""
        return moment.state[STATE]

    @property
    def subject(self) -> str:
        """The angle."""
        return "the trailer's angle"

    @property
    def noises(self) -> dict[str, Noise]:
        """The noise of the angle."""
        return {"trailer_angle": Noise(self.noise)}

    @property
    def mount(self) -> None:
        """Nowhere: an angle of the robot itself."""
        return None

    def issues(self, system: System, samples: int) -> list[Issue]:
        """A robot without a trailer."""
        if "trailer_angle" in system.states:
            return []
        return [
            Issue(("measurement", "kind"), f"{label_of(system)} has no trailer whose angle could be measured")
        ]
