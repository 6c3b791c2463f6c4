"""What sensors say of readings that logs hold: how noisy these are, and where on the robot they are read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from oed.foundation.arrays import Array
from oed.robots.sensors.mounting import Mount


@dataclass(frozen=True)
class Noise:
    """Standard deviation sqrt(at_rest^2 + (per_speed V)^2 + (per_yaw_rate Omega)^2) of a reading at speed V
    and yaw rate Omega.

    Attributes:
        at_rest: [m] or [rad].
        per_speed: [s] or [rad s/m].
        per_yaw_rate: [m s/rad] or [s].
    """

    at_rest: float
    per_speed: float = 0.0
    per_yaw_rate: float = 0.0

    def variance(self, speeds_squared: Any, yaw_rates_squared: Any) -> Any:
        """At V^2 [m^2/s^2] and Omega^2 [rad^2/s^2], numbers or expressions."""
        growth = self.per_speed**2 * speeds_squared + self.per_yaw_rate**2 * yaw_rates_squared
        return self.at_rest**2 + growth

    def deviation(self, speeds: Array, yaw_rates: Array) -> Array:
        """At those speeds [m/s] and yaw rates [rad/s]."""
        return np.asarray(np.sqrt(self.variance(speeds**2, yaw_rates**2)))

    def divided(self, factor: float) -> Noise:
        """All its parts smaller by a factor."""
        return Noise(self.at_rest / factor, self.per_speed / factor, self.per_yaw_rate / factor)


@runtime_checkable
class LoggedSensor(Protocol):
    """A sensor that reads a robot's states, as logs hold them."""

    @property
    def noises(self) -> Mapping[str, Noise]:
        """The noise specified of each state, {} where it is of another form."""

    @property
    def mount(self) -> Mount | None:
        """Where poses are read; None of what is the same everywhere on the robot."""
