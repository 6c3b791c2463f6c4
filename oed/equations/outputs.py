"""What is read of a system that is given by equations: its outputs, with noise of their own."""

from __future__ import annotations

from abc import ABC
from typing import Annotated, ClassVar, Literal, Self

import casadi as ca
from pydantic import BeforeValidator, Field

from oed.equations.diffusion import Diffusion, diffusion_issues, diffusion_of
from oed.equations.dimensions import SIZES, quantity
from oed.equations.given import AS_DATA, Readable, pairs
from oed.foundation.component import OneOf
from oed.foundation.errors import Issue
from oed.foundation.quantities import is_share
from oed.foundation.text import count, did_you_mean, listing, unit_text, words
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.description import deviations_text
from oed.kernel.measurement.measurement import Measurement, Sensor, Start, Together, When, joined, joins
from oed.kernel.measurement.moment import Moment

Deviations = Annotated[
    tuple[tuple[str, str | float], ...], BeforeValidator(pairs), Field(min_length=1), AS_DATA
]
"""Standard deviations with their units, by the outputs' names."""


Wandering = Annotated[tuple[tuple[str, str | float], ...], BeforeValidator(pairs), AS_DATA]
"""Deviations after 1 s with their units, by the states' names."""
Begun = Annotated[
    Literal["known", "unknown"] | Annotated[tuple[tuple[str, float], ...], BeforeValidator(pairs)], AS_DATA
]
"""What is known of the start states: all, nothing, or standard deviations by their names, SI; infinite where
nothing is known.
"""


class OutputSensor(Sensor, ABC):
    """Outputs of a system, with independent noise.

    Attributes:
        noise: standard deviations by the names of the outputs that are read.
    """

    noise: Deviations

    @property
    def names(self) -> tuple[str, ...]:
        """Of the outputs that are read."""
        return tuple(name for name, _ in self.noise)

    @property
    def sizes(self) -> tuple[float, ...]:
        """Their standard deviations, SI."""
        return tuple(quantity(value)[0] for _, value in self.noise)

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Outputs that the system has not, and noise that is in another unit, or none."""
        if not isinstance(system, Readable):
            return [Issue(("measurement", "kind"), f"{self.kind} are those of a system with outputs")]
        return [
            Issue(("measurement", "noise", name), reason)
            for name, value in self.noise
            if (reason := _noise_issue(system, name, value))
        ]

    def reading(self, moment: Moment) -> Expression:
        """The outputs, in the order of `noise`."""
        return ca.vertcat(*(moment.signals[name] for name in self.names))

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma of each."""
        return ca.diag(ca.SX(ca.DM([1 / size for size in self.sizes])))

    @property
    def subject(self) -> str:
        """The outputs by their names."""
        return listing([words(name) for name in self.names])

    @property
    def noise_text(self) -> str:
        """Standard deviations as they are given."""
        sizes = dict.fromkeys(f"{value:g}" if isinstance(value, float) else value for _, value in self.noise)
        return deviations_text(*map(unit_text, sizes))

    def brief(self, samples: int) -> str:
        """What is read of a trial of so many samples, and how often."""
        return f"{count(len(self.columns(samples)), 'reading')} of {self.subject}"

    def units_of(self, system: System) -> tuple[str, ...]:
        """Those of the outputs."""
        known = system.output_dimensions if isinstance(system, Readable) else {}
        return tuple(known[name].text for name in self.names if name in known)

    @property
    def entries(self) -> tuple[str, ...]:
        """By their names."""
        return tuple(f".{name}" for name in self.names)


class Outputs(OutputSensor):
    """Outputs read at the samples, the first at the start, of a system with states.

    Attributes:
        start: what is known of the start states.
        diffusion: process noise, which makes states wander: their standard deviations after 1 s, in units of
            the state over s^(1/2), by their names.
    """

    kind: Literal["outputs"] = "outputs"
    start: Begun = "known"
    diffusion: Wandering = ()

    @property
    def process_noise(self) -> Diffusion | None:
        """The diffusion, where there is any."""
        return diffusion_of(self.diffusion)

    def steady(self) -> Self:
        """Of a system whose states do as their equations say."""
        return self.model_copy(update={"diffusion": ()}) if self.diffusion else self

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Those of outputs, and diffusion of no states or in other units."""
        wandering = diffusion_issues(self.diffusion, system) if isinstance(system, Readable) else ()
        return [*super().issues(system, samples), *wandering]

    @property
    def remark(self) -> str:
        """How the states wander."""
        noise = self.process_noise
        return "" if noise is None else f"; the system drifts by {noise.text}"

    @property
    def start_known(self) -> Start:
        """What `start` says."""
        return self.start if isinstance(self.start, str) else dict(self.start)


class Rates(OutputSensor):
    """Outputs read all the time, of a system with states: in a second as much as one reading with the noise.

    That is of white noise, whose mean over a second deviates by so much. The outputs of a period count as
    they are in its middle.

    Attributes:
        start: what is known of the start states.
    """

    kind: Literal["rates"] = "rates"
    when: ClassVar[When] = "in periods"
    continuous: ClassVar[bool] = True
    start: Begun = "known"

    @property
    def start_known(self) -> Start:
        """What `start` says."""
        return self.start if isinstance(self.start, str) else dict(self.start)

    def brief(self, samples: int) -> str:
        """What is read."""
        return f"readings of {self.subject} all the time"

    def sentence(self, samples: int) -> str:
        """What is read, and how noisily."""
        return f"{self.subject} all the time, the mean of a second with {self.noise_text}"

    def whitening(self, moment: Moment) -> Expression:
        """sqrt(T) / sigma of each."""
        return super().whitening(moment) * ca.sqrt(moment.period)


class Responses(OutputSensor):
    """Outputs of a system without states, read once for each setting of its inputs."""

    kind: Literal["responses"] = "responses"
    when: ClassVar[When] = "in periods"

    def sentence(self, samples: int) -> str:
        """What is read of so many settings, and how noisily."""
        return f"{self.subject} at each setting ({count(samples, 'time')}) with {self.noise_text}"


SENSORS: tuple[type[OutputSensor], ...] = (Outputs, Rates, Responses)
"""Every way of reading outputs."""


@joins(OutputSensor)
class SeveralOutputs(Together):
    """Outputs read together; in a study, a list of sensors."""

    kind: Literal["several"] = "several"
    sensors: Annotated[tuple[Annotated[OutputSensor, OneOf(SENSORS)], ...], Field(min_length=1)]


def replaced_starts(measurement: Measurement, known: tuple[tuple[str, float], ...]) -> Measurement:
    """A measurement whose sensors know start states so well; those that say it themselves are left alone.

    Args:
        measurement: of outputs.
        known: standard deviations by the states' names, SI.
    """
    sensors = [
        one.model_copy(update={"start": known}) if getattr(one, "start", None) == "known" else one
        for one in measurement.joint_sensors
    ]
    return sensors[0] if len(sensors) == 1 else joined(sensors)


def _noise_issue(system: Readable, name: str, value: str | float) -> str:
    known = system.output_dimensions
    if name not in known:
        return f"there is no such output; there is {listing(list(known))}{did_you_mean(name, known)}"
    if is_share(value):
        text = f"{value} of what? A standard deviation is of one size: give it in the unit of {name}"
        return f"{text}, a plain number where that has none"
    try:
        size, dimension = quantity(value)
    except ValueError as error:
        return str(error)
    if not size > 0:
        return f"expected a standard deviation above 0, got {value}"
    if size < 1 / SIZES[1]:
        return f"expected a standard deviation of at least {1 / SIZES[1]:g} in SI units, got {value}"
    return (
        "" if dimension.fits(known[name]) else f"{name} is {known[name].words}, its noise {dimension.words}"
    )
