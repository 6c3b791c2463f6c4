"""One number that is read with a constant bias: what such sensors have in common."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import casadi as ca

from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.measurement import Nuisance
from oed.kernel.measurement.sensor import Moment, Sensor


class BiasedSensor(Sensor):
    """A quantity plus a bias.

    Attributes:
        noise: standard deviation of one reading, in `unit`.
        bias: "unknown" (eliminated), "known" (none), or the standard deviation of its prior, in `unit`.
    """

    unit: ClassVar[str]
    noise: float
    bias: str | float

    @abstractmethod
    def quantity(self, moment: Moment) -> Expression:
        """What is read, without noise and bias."""

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The bias, where it is not known."""
        if self.bias == "known":
            return ()
        return (Nuisance("bias", 0.0, self.unit, self.bias if isinstance(self.bias, float) else None),)

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

    @property
    def remark(self) -> str:
        """That there is no bias, where that is known."""
        return " and no bias" if self.bias == "known" else ""
