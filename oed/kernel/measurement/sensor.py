"""Sensors: what is read at one moment of a drive, and how noisy that is.

Dependence of a reading on the parameters, the start state and the sensor's own nuisances follows by the chain
rule along the drive, for every system alike.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self, cast

import casadi as ca
from pydantic import Field

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.text import count, words
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Named
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.description import deviations_of, noise_text, when_text
from oed.kernel.measurement.process_noise import ProcessNoise

Start = Literal["unknown", "known"] | Mapping[str, float]
"""Knowledge of the start states: none, all, or standard deviations by their names or units, infinite where
nothing is known.
"""
When = Literal["at samples", "in periods", "between samples"]
"""Times of a sensor's readings: the N + 1 samples' instants, the N periods between them, or two of the
instants together."""


@dataclass(frozen=True)
class Moment(Named):
    """Expressions that a sensor may read at one time.

    Attributes:
        system: system that is driven.
        state: states, (states,).
        inputs: inputs held at that time, (inputs,).
        signals: the system's signals, at that instant or as means of the period; attributes by their names.
        nuisances: the sensor's nuisances, by their names.
        earlier: moment at which the reading of a sensor between samples begins.
        elapsed: time since then [s]; 0 for other sensors.
        period: duration of the reading of a period [s]; 0 for an instant.
    """

    system: System
    state: Expression
    inputs: Expression
    signals: Mapping[str, Expression]
    nuisances: Mapping[str, Expression]
    earlier: Moment | None = None
    elapsed: Expression | float = 0.0
    period: Expression | float = 0.0


class AnyMoment:
    """A moment of symbols alone, for whatever attribute is read.

    Attributes:
        SIZE: entries of every symbol, more than any system's state or signal has.
        nuisances: the sensor's nuisances.
    """

    SIZE = 32

    def __init__(self, nuisances: Mapping[str, Expression]) -> None:
        """Keep the nuisances."""
        self.nuisances = nuisances

    @property
    def earlier(self) -> AnyMoment:
        """A further moment of symbols."""
        return AnyMoment(self.nuisances)

    def __getattr__(self, name: str) -> Expression:
        """Return a symbol."""
        return ca.SX.sym(name, self.SIZE)


class Sensor(Component, ABC):
    """A sensor that reads the drive as it is driven.

    Attributes:
        every: samples from a reading to the next, from the first sample on; between samples, a reading lasts
            that long.
    """

    kind: str
    when: ClassVar[When] = "at samples"
    continuous: ClassVar[bool] = False
    """True if it reads all the time: the reading of a period is that of all its time."""

    every: Annotated[int, Field(ge=1)] = 1

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Return why this sensor is impossible for `system` and so many samples; [] if it is not."""
        return []

    @abstractmethod
    def reading(self, moment: Moment) -> Expression:
        """Return the noise-free reading (q,) at a moment."""

    @abstractmethod
    def whitening(self, moment: Moment) -> Expression:
        """Return A (q, q) with A R A' = 1, for the covariance R of one reading's noise."""

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """Constants of the sensor that are nuisance parameters."""
        return ()

    @property
    def angles(self) -> tuple[int, ...]:
        """Places of the entries of a reading that are angles, known up to full turns."""
        return ()

    @property
    def wrapping(self) -> tuple[int, ...]:
        """Places of the angles that jump by full turns as predicted: directions from the robot do."""
        return ()

    @property
    def gauge(self) -> tuple[str, ...]:
        """Start states of the first run that define the frame, because no reading fixes an absolute frame; ()
        where readings fix one.
        """
        return ()

    @property
    def start_known(self) -> Start | None:
        """Knowledge of the start states; None for a sensor they do not concern."""
        return None

    @property
    def joint_whitening(self) -> Array | None:
        """Matrix A with A R A' = 1 for the covariance R of all readings; None where none are correlated."""
        return None

    @property
    def process_noise(self) -> ProcessNoise | None:
        """Process noise of the system, which readings do not average away; None without any."""
        return None

    def steady(self) -> Sensor:
        """Return this sensor of a system without process noise."""
        return self

    def coarser(self, times: float) -> Self | None:
        """Return a sensor that reads at about the same times; None with one covariance of all readings."""
        if self.joint_whitening is not None:
            return None
        return self.model_copy(update={"every": max(1, round(self.every / times))})

    def columns(self, samples: int) -> list[int]:
        """Return indices of the samples or periods that are read; between samples, of the readings' ends."""
        last = samples if self.when == "in periods" else samples + 1
        return list(range(self.every if self.when == "between samples" else 0, last, self.every))

    def instants(self, samples: int) -> list[list[int]]:
        """Return these indices for every moment of a reading, the end of the reading first."""
        columns = self.columns(samples)
        earlier = [column - self.every for column in columns]
        return [columns, earlier] if self.when == "between samples" else [columns]

    @property
    def lasting(self) -> int:
        """Number of periods that a reading lasts, 0 at an instant."""
        return {"at samples": 0, "in periods": 1, "between samples": self.every}[self.when]

    @property
    def subject(self) -> str:
        """Quantities that are read, in words."""
        return f"the {words(self.kind)}"

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of a reading's entries; () where the sensor does not say."""
        return ()

    def units_of(self, system: System) -> tuple[str, ...]:
        """Return SI units of a reading's entries for that system; `units` by default."""
        return self.units

    @property
    def entries(self) -> tuple[str, ...]:
        """Suffixes that tell a reading's entries apart: `.quantity`, `[which]` or both; () if unknown."""
        return ("",) if len(self.units) == 1 else tuple(f".{place + 1}" for place in range(len(self.units)))

    @property
    def deviations(self) -> tuple[float, ...]:
        """Standard deviations of a reading's entries, SI, where they depend on nothing; else ()."""
        return deviations_of(self._any_whitening())

    @property
    def noise_text(self) -> str:
        """Noise of one reading, in words."""
        joint = self.joint_whitening
        if joint is not None:
            return noise_text(ca.DM(joint), self.units * (len(joint) // max(1, len(self.units))))
        return noise_text(self._any_whitening(), self.units)

    def _any_whitening(self) -> Expression:
        symbols = {nuisance.name: ca.SX.sym(nuisance.name) for nuisance in self.nuisances}
        return self.whitening(cast(Moment, AnyMoment(symbols)))

    @property
    def remark(self) -> str:
        """Further words about the readings, to follow their noise; "" without any."""
        return ""

    def brief(self, samples: int) -> str:
        """Return in words which quantities a drive of so many samples reads, and how often."""
        return f"{count(len(self.columns(samples)), 'reading')} of the {words(self.kind)}"

    def sentence(self, samples: int) -> str:
        """Return in words which quantities are read, when, how noisily and from where."""
        when = when_text("period" if self.when == "in periods" else "sample", self.every)
        times = count(len(self.columns(samples)), "time")
        return f"{self.subject} {when} ({times}) with {self.noise_text}{self.remark}"


def process_noise_of(sensors: Sequence[Sensor]) -> ProcessNoise | None:
    """Return the process noise that sensors state, common to all of them; None without any."""
    noises = (sensor.process_noise for sensor in sensors)
    return next((noise for noise in noises if noise is not None), None)
