"""The yaw rate, as a gyroscope gives it, with its bias."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from oed.foundation.quantities import AngularSpeed
from oed.foundation.text import count
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.measurement import Nuisance
from oed.kernel.measurement.sensor import Moment, Sensor


class YawRate(Sensor):
    """The yaw rate [rad/s] of every n-th period, plus a constant bias.

    Attributes:
        noise: standard deviation of one reading [rad/s].
        bias: "unknown" (eliminated), "known", or its standard deviation known beforehand [rad/s].
    """

    kind: Literal["yaw_rate"] = "yaw_rate"
    when: ClassVar[Literal["at samples", "in periods"]] = "in periods"
    noise: Annotated[AngularSpeed, Field(gt=0)]
    bias: Literal["unknown", "known"] | Annotated[AngularSpeed, Field(gt=0)] = "unknown"

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The bias, where it is not known."""
        if self.bias == "known":
            return ()
        deviation = self.bias if isinstance(self.bias, float) else None
        return (Nuisance("bias", 0.0, "rad/s", deviation),)

    def reading(self, moment: Moment) -> Expression:
        """Yaw rate and bias."""
        return moment.signals["twist"][2] + moment.nuisances.get("bias", 0.0)

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma."""
        return ca.SX(1 / self.noise)

    @property
    def units(self) -> tuple[str, ...]:
        """Of the reading."""
        return ("rad/s",)

    @property
    def remark(self) -> str:
        """That there is no bias, where that is known."""
        return " and no bias" if self.bias == "known" else ""

    def brief(self, samples: int) -> str:
        """How many are read."""
        return count(len(self.columns(samples)), "yaw rate")
