"""Measurements: regressions on displacements, or sensors that read the drive as it truly was.

A sensor says what it reads at one moment, and how noisy that is. Its dependence on the parameters, the
start state and its own nuisances follows by the chain rule along the drive, for every system alike.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import is_
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, cast

import casadi as ca
from pydantic import Field

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.text import count, listing, words
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.blocks import Block, Nuisance
from oed.kernel.measurement.description import deviations_of, noise_text, when_text
from oed.kernel.measurement.moment import AnyMoment, Moment
from oed.kernel.measurement.process_noise import ProcessNoise

Start = Literal["unknown", "known"] | Mapping[str, float]
"""Knowledge of the start states: none, all, or standard deviations by their names or units, infinite where
nothing is known.
"""
When = Literal["at samples", "in periods", "between samples"]
"""Times of a sensor's readings: the N + 1 samples' instants, the N periods between them, or two of the
instants together."""


@dataclass(frozen=True)
class Cuts:
    """Rule for cutting drives of a measurement into pieces whose information, or whose rows, add up.

    Attributes:
        segment: samples of every segment of a regression, whose rows add up over the pieces of a segment.
        regression: measurement of a single segment; None where readings are estimated from together.
    """

    segment: int = 1
    regression: Measurement | None = None


class Measurement(Component, ABC):
    """Quantities that are measured, with their times and their noise."""

    kind: str

    def blocks(self, drive: Drive) -> tuple[Block, ...]:
        """Return the estimations that a regression of `drive` allows, each with its own parameters.

        Sensors have none: all of them are estimated from together.
        """
        raise NotImplementedError(f"{type(self).__name__}: a measurement that is no sensor needs `blocks`")

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Return why this measurement is impossible for `system` and so many samples; [] if it is not."""
        return []

    @property
    def joint_sensors(self) -> tuple[Sensor, ...]:
        """Sensors that are estimated from together; () for a regression."""
        return ()

    def steady(self) -> Measurement:
        """Return this measurement of a system without process noise."""
        return self

    def cuts(self, samples: int) -> Cuts | None:
        """Return how drives of so many samples per run can be cut; None where they cannot."""
        return None

    @property
    def grid_multiple(self) -> int:
        """Number of which a run's samples should be a multiple."""
        return 1

    def coarser(self, times: float) -> Measurement | None:
        """Return much the same measurement of a drive with so many times fewer samples; None without any.

        Its information need only be in proportion: searches on fewer samples correct the rest.
        """
        return None

    def brief(self, samples: int) -> str:
        """Return in words which quantities of a drive of so many samples are measured."""
        return words(self.kind)

    def sentence(self, samples: int) -> str:
        """Return in words which quantities are measured, when and how noisily."""
        return self.brief(samples)


class Sensor(Measurement):
    """A sensor that reads the drive as it is driven.

    Attributes:
        every: samples from a reading to the next, from the first sample on; between samples, a reading lasts
            that long.
    """

    when: ClassVar[When] = "at samples"
    continuous: ClassVar[bool] = False
    """True if it reads all the time: the reading of a period is that of all its time."""

    every: Annotated[int, Field(ge=1)] = 1

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

    @property
    def joint_sensors(self) -> tuple[Sensor, ...]:
        """Tuple of this sensor alone."""
        return (self,)

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


class Together(Measurement, ABC):
    """Sensors used together; in a study, a list of them.

    Attributes:
        sensors: the sensors, at least one.
    """

    sensors: tuple[Sensor, ...]

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Return the sensors' issues, and sensors that disagree on what is known of the start."""
        issues = [
            Issue(("measurement", index, *issue.key[1:]), issue.message)
            for index, sensor in enumerate(self.sensors)
            for issue in sensor.issues(system, samples)
        ]
        starts = [sensor.start_known for sensor in self.sensors]
        first = next((start for start in starts if start is not None), None)
        for index, start in enumerate(starts):
            if start not in (None, first):
                name = system.start_name
                text = f"differs from that of the sensors before; there is one {name.replace('_', ' ')}"
                issues.append(Issue(("measurement", index, name), text))
        return issues

    @property
    def joint_sensors(self) -> tuple[Sensor, ...]:
        """The sensors."""
        return self.sensors

    def steady(self) -> Self:
        """Return the sensors of a system without process noise."""
        sensors = tuple(sensor.steady() for sensor in self.sensors)
        is_steady = all(map(is_, sensors, self.sensors))
        return self if is_steady else self.model_copy(update={"sensors": sensors})

    def coarser(self, times: float) -> Self | None:
        """Return sensors that read a drive of fewer samples; None where a sensor cannot."""
        sensors = [sensor.coarser(times) for sensor in self.sensors]
        return None if None in sensors else self.model_copy(update={"sensors": tuple(sensors)})

    def brief(self, samples: int) -> str:
        """Return in words which quantities the sensors read."""
        return listing([sensor.brief(samples) for sensor in self.sensors])

    def sentence(self, samples: int) -> str:
        """Return in words which quantities the sensors read, when and how noisily."""
        return "; ".join(sensor.sentence(samples) for sensor in self.sensors)


def process_noise_of(sensors: Sequence[Sensor]) -> ProcessNoise | None:
    """Return the process noise that sensors state, common to all of them; None without any."""
    noises = (sensor.process_noise for sensor in sensors)
    return next((noise for noise in noises if noise is not None), None)


Kind = TypeVar("Kind", bound=Measurement)
_joining: dict[type[Any], Callable[..., Measurement]] = {}
# Measurements of several sensors know the sensors of their domain: they stand higher up, and enter here.


def joins(sort: type[Any]) -> Callable[[type[Kind]], type[Kind]]:
    """Mark the measurement of several sensors of a sort, whose field `sensors` they are."""

    def enter(kind: type[Kind]) -> type[Kind]:
        _joining[sort] = kind
        return kind

    return enter


def joined(sensors: Sequence[Sensor]) -> Measurement:
    """Return the measurement of several sensors, of the narrowest sort that fits all of them.

    Raises:
        TypeError: no domain with such a measurement has been loaded.
    """
    fitting = [sort for sort in _joining if all(isinstance(sensor, sort) for sensor in sensors)]
    if not fitting:
        raise TypeError("no measurement of several sensors like these has been loaded")
    return _joining[max(fitting, key=lambda sort: len(sort.__mro__))](sensors=tuple(sensors))
