"""What is measured: regressions on displacements, or sensors that read the drive as it truly was.

A sensor says what it reads at one moment, and how noisy that is. Its dependence on the parameters, the
start state and its own nuisances follows by the chain rule along the drive, for every system alike.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
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
"""What is known of the start states: nothing, all, or standard deviations by their names or units, infinite
where nothing is known.
"""
When = Literal["at samples", "in periods", "between samples"]
"""Whether a sensor reads at the N + 1 samples' instants, something of each of the N periods between, or of
two of the instants together."""


@dataclass(frozen=True)
class Cuts:
    """How drives of a measurement can be cut into pieces whose information, or whose rows, add up.

    Attributes:
        multiple: of which number of samples every piece has a multiple.
        segment: of a regression, samples of each segment: its rows add up over the pieces of a segment.
        regression: the measurement of a single segment; None where readings are estimated from together.
    """

    multiple: int = 1
    segment: int = 1
    regression: Measurement | None = None


class Measurement(Component, ABC):
    """What is measured, when, and with what noise."""

    kind: str

    def blocks(self, drive: Drive) -> tuple[Block, ...]:
        """Return the estimations that a regression of `drive` allows, each with its own parameters.

        Sensors have none of their own: they are estimated from together.
        """
        raise NotImplementedError(f"{type(self).__name__} says no blocks")

    def issues(self, system: System, samples: int) -> list[Issue]:
        """What makes this measurement impossible for `system` and that many samples; [] if nothing."""
        return []

    @property
    def joint_sensors(self) -> tuple[Sensor, ...]:
        """The sensors that are estimated from together; () of a regression."""
        return ()

    def steady(self) -> Measurement:
        """This measurement of a system without noise of its own."""
        return self

    def cuts(self, samples: int) -> Cuts | None:
        """How drives of so many samples per run can be cut; None where they cannot."""
        return None

    @property
    def grid_multiple(self) -> int:
        """Of which number a run's samples should be a multiple."""
        return 1

    def coarser(self, times: float) -> Measurement | None:
        """Much the same measurement of a drive with so many times fewer samples; None where there is none.

        Its information need only be in proportion: searches on fewer samples correct the rest.
        """
        return None

    def brief(self, samples: int) -> str:
        """What is measured of a drive of so many samples, in words."""
        return words(self.kind)

    def sentence(self, samples: int) -> str:
        """What is measured, when and how noisily, where the measurement says so."""
        return self.brief(samples)


class Sensor(Measurement):
    """One sensor of the drive as it is driven.

    Attributes:
        every: one reading every so many samples, from the first on; between samples, from each of these to
            the next.
    """

    when: ClassVar[When] = "at samples"
    continuous: ClassVar[bool] = False
    """Whether it reads all the time, and the reading of a period is that of all its time."""

    every: Annotated[int, Field(ge=1)] = 1

    @abstractmethod
    def reading(self, moment: Moment) -> Expression:
        """The noise-free reading (q,) at a moment."""

    @abstractmethod
    def whitening(self, moment: Moment) -> Expression:
        """A (q, q) with A R A' = 1, for the covariance R of one reading's noise."""

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """Constants of the sensor's own that are nuisance parameters."""
        return ()

    @property
    def angles(self) -> tuple[int, ...]:
        """Which entries of a reading are angles, known up to full turns."""
        return ()

    @property
    def wrapping(self) -> tuple[int, ...]:
        """Which of the angles jump by full turns as they are predicted: directions from the robot do."""
        return ()

    @property
    def gauge(self) -> tuple[str, ...]:
        """Start states of the first run that define the frame, for nothing that is seen has a place known
        beforehand; () where something has.
        """
        return ()

    @property
    def start_known(self) -> Start | None:
        """What its owner knows of the start states; None for a sensor they do not concern."""
        return None

    @property
    def joint_whitening(self) -> Array | None:
        """A with A R A' = 1 for the covariance R of all readings together; None where none are correlated."""
        return None

    @property
    def process_noise(self) -> ProcessNoise | None:
        """What its owner says of the system's own noise, which readings do not average away; or None."""
        return None

    def steady(self) -> Sensor:
        """This sensor of a system without noise of its own."""
        return self

    @property
    def joint_sensors(self) -> tuple[Sensor, ...]:
        """This one."""
        return (self,)

    def coarser(self, times: float) -> Self | None:
        """One that reads at about the same times, or less often; None with one covariance of all readings."""
        if self.joint_whitening is not None:
            return None
        return self.model_copy(update={"every": max(1, round(self.every / times))})

    def columns(self, samples: int) -> list[int]:
        """Indices of the samples or periods that are read; between samples, of those that readings end at."""
        last = samples if self.when == "in periods" else samples + 1
        return list(range(self.every if self.when == "between samples" else 0, last, self.every))

    def instants(self, samples: int) -> list[list[int]]:
        """For each moment of a reading these indices; that at which it ends comes first."""
        columns = self.columns(samples)
        earlier = [column - self.every for column in columns]
        return [columns, earlier] if self.when == "between samples" else [columns]

    @property
    def subject(self) -> str:
        """What is read, in words."""
        return f"the {words(self.kind)}"

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of a reading's entries; () where the sensor does not say."""
        return ()

    def units_of(self, system: System) -> tuple[str, ...]:
        """SI units of a reading's entries where it is of that system; `units` by default."""
        return self.units

    @property
    def entries(self) -> tuple[str, ...]:
        """What tells the entries of a reading apart: `.quantity`, `[which]` or both; () where nobody says."""
        return ("",) if len(self.units) == 1 else tuple(f".{place + 1}" for place in range(len(self.units)))

    @property
    def deviations(self) -> tuple[float, ...]:
        """Standard deviations of a reading's entries, SI, where they depend on nothing; else ()."""
        own = {nuisance.name: ca.SX.sym(nuisance.name) for nuisance in self.nuisances}
        return deviations_of(self.whitening(cast(Moment, AnyMoment(own))))

    @property
    def noise_text(self) -> str:
        """The noise of one reading, in words."""
        whole = self.joint_whitening
        if whole is not None:
            return noise_text(ca.DM(whole), self.units * (len(whole) // max(1, len(self.units))))
        own = {nuisance.name: ca.SX.sym(nuisance.name) for nuisance in self.nuisances}
        return noise_text(self.whitening(cast(Moment, AnyMoment(own))), self.units)

    @property
    def remark(self) -> str:
        """What else there is to say of the readings, to follow their noise; "" for nothing."""
        return ""

    def brief(self, samples: int) -> str:
        """What is read on a drive of so many samples, and how often."""
        return f"{count(len(self.columns(samples)), 'reading')} of the {words(self.kind)}"

    def sentence(self, samples: int) -> str:
        """What is read on a drive of so many samples, when, how noisily and from where."""
        when = when_text("period" if self.when == "in periods" else "sample", self.every)
        times = count(len(self.columns(samples)), "time")
        return f"{self.subject} {when} ({times}) with {self.noise_text}{self.remark}"


class Together(Measurement, ABC):
    """Sensors used together; in a study, a list of them. A domain says which there are.

    Attributes:
        sensors: at least one.
    """

    sensors: tuple[Sensor, ...]

    def issues(self, system: System, samples: int) -> list[Issue]:
        """The sensors' own issues, and sensors that disagree on what is known of the start."""
        issues = [
            Issue(("measurement", index, *issue.key[1:]), issue.message)
            for index, sensor in enumerate(self.sensors)
            for issue in sensor.issues(system, samples)
        ]
        known = [sensor.start_known for sensor in self.sensors]
        given = [entry for entry in known if entry is not None]
        for index, entry in enumerate(known):
            if entry is not None and entry != given[0]:
                name = system.start_name
                text = f"differs from that of the sensors before; there is one {name.replace('_', ' ')}"
                issues.append(Issue(("measurement", index, name), text))
        return issues

    @property
    def joint_sensors(self) -> tuple[Sensor, ...]:
        """All of them."""
        return self.sensors

    def steady(self) -> Self:
        """The sensors' own."""
        sensors = tuple(one.steady() for one in self.sensors)
        alike = all(one is own for one, own in zip(sensors, self.sensors, strict=True))
        return self if alike else self.model_copy(update={"sensors": sensors})

    def coarser(self, times: float) -> Self | None:
        """The sensors' own."""
        sensors = [sensor.coarser(times) for sensor in self.sensors]
        return None if None in sensors else self.model_copy(update={"sensors": tuple(sensors)})

    def brief(self, samples: int) -> str:
        """What is read by each sensor."""
        return listing([sensor.brief(samples) for sensor in self.sensors])

    def sentence(self, samples: int) -> str:
        """What each sensor says of itself."""
        return "; ".join(sensor.sentence(samples) for sensor in self.sensors)


def process_noise_of(sensors: Sequence[Sensor]) -> ProcessNoise | None:
    """What sensors say of the process, which is one for all of them; None where none does."""
    return next((one.process_noise for one in sensors if one.process_noise is not None), None)


Kind = TypeVar("Kind", bound=Measurement)
_joining: dict[type[Any], Callable[..., Measurement]] = {}
# What joins sensors knows every one of its domain: it stands on a higher floor, and enters here.


def joins(sort: type[Any]) -> Callable[[type[Kind]], type[Kind]]:
    """Marks the measurement of several sensors of a sort, whose field `sensors` they are."""

    def entered(kind: type[Kind]) -> type[Kind]:
        _joining[sort] = kind
        return kind

    return entered


def joined(sensors: Sequence[Sensor]) -> Measurement:
    """The measurement of several sensors, by the narrowest sort that all are of.

    Raises:
        TypeError: no domain with such a measurement has been loaded.
    """
    fitting = [sort for sort in _joining if all(isinstance(one, sort) for one in sensors)]
    if not fitting:
        raise TypeError("no measurement of several sensors like these has been loaded")
    return _joining[max(fitting, key=lambda sort: len(sort.__mro__))](sensors=tuple(sensors))
