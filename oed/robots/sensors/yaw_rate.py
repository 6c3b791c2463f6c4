"""The yaw rate, as a gyroscope gives it, with its bias."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from oed.foundation.quantities import AngularSpeed
from oed.foundation.text import count
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.sensor import Moment
from oed.robots.sensors.biased import BiasedSensor


class YawRate(BiasedSensor):
    """The yaw rate [rad/s] of every n-th period, plus a constant bias.

    Attributes:
        noise: standard deviation of one reading [rad/s].
        bias: "unknown" (eliminated), "known", or the standard deviation of its prior [rad/s].
    """

    kind: Literal["yaw_rate"] = "yaw_rate"
    unit = "rad/s"
    when: ClassVar[Literal["at samples", "in periods"]] = "in periods"
    noise: Annotated[AngularSpeed, Field(gt=0)]
    bias: Literal["unknown", "known"] | Annotated[AngularSpeed, Field(gt=0)] = "unknown"

    def quantity(self, moment: Moment) -> Expression:
        """The yaw rate."""
        return moment.signals["twist"][2]

    def brief(self, samples: int) -> str:
        """How many are read."""
        return count(len(self.columns(samples)), "yaw rate")
