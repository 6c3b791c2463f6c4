"""Measurements of systems given by equations: their outputs, with independent noise."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, Self

import casadi as ca
from pydantic import BeforeValidator, Field

from oed.equations.diffusion import Diffusion, diffusion_issues, diffusion_of
from oed.equations.dimensions import SIZES, Dimension, Quantity, expect_quantity, quantity
from oed.equations.initial_values import AS_DATA, Quantities, pairs
from oed.equations.issues import Issues, no_such
from oed.equations.output_system import OutputSystem
from oed.foundation.component import OneOf
from oed.foundation.errors import Issue
from oed.foundation.quantities import is_share
from oed.foundation.text import count, listing, unit_text, words
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.description import deviations_text
from oed.kernel.measurement.measurement import Measurement, Sensors, measurement_of, sensors_of
from oed.kernel.measurement.sensor import Moment, Sensor, Start, When

StartKnowledge = Annotated[
    Literal["known", "unknown"] | Annotated[tuple[tuple[str, float], ...], BeforeValidator(pairs)], AS_DATA
]
"""Knowledge of the start states: all, nothing, or standard deviations by their names, SI; infinite where
nothing is known.
"""


class OutputSensor(Sensor, ABC):
    """Outputs of a system, with independent noise.

    Attributes:
        noise: standard deviations with their units, by the names of the outputs that are read.
    """

    noise: Annotated[Quantities, Field(min_length=1)]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the outputs that are read."""
        return tuple(name for name, _ in self.noise)

    @property
    def sizes(self) -> tuple[float, ...]:
        """Standard deviations of the outputs, SI."""
        return tuple(quantity(value)[0] for _, value in self.noise)

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Refuse outputs that the system does not have, and noise of 0 or in another unit."""
        if not isinstance(system, OutputSystem):
            return [Issue(("measurement", "kind"), f"{self.kind} are those of a system with outputs")]
        issues = Issues("measurement", "noise")
        for name, value in self.noise:
            with issues.at(name):
                _check_noise(system.output_dimensions, name, value)
        return issues

    def reading(self, moment: Moment) -> Expression:
        """Return the outputs, in the order of `noise`."""
        return ca.vertcat(*(moment.signals[name] for name in self.names))

    def whitening(self, moment: Moment) -> Expression:
        """Return 1 / sigma of all outputs, as a diagonal matrix."""
        return ca.diag(ca.SX(ca.DM([1 / size for size in self.sizes])))

    @property
    def subject(self) -> str:
        """Names of the outputs in a sentence."""
        return listing([words(name) for name in self.names])

    @property
    def noise_text(self) -> str:
        """Standard deviations as the study has them."""
        sizes = dict.fromkeys(f"{value:g}" if isinstance(value, float) else value for _, value in self.noise)
        return deviations_text(*map(unit_text, sizes))

    def brief(self, samples: int) -> str:
        """Describe the readings of a trial, and their number."""
        return f"{count(len(self.columns(samples)), 'reading')} of {self.subject}"

    def units_of(self, system: System) -> tuple[str, ...]:
        """Return the units of the outputs."""
        dimensions = system.output_dimensions if isinstance(system, OutputSystem) else {}
        return tuple(dimensions[name].text for name in self.names if name in dimensions)

    @property
    def entries(self) -> tuple[str, ...]:
        """Names of the outputs as suffixes."""
        return tuple(f".{name}" for name in self.names)


class StateSensor(OutputSensor, ABC):
    """Outputs of a system with states.

    Attributes:
        start: knowledge of the start states.
    """

    start: StartKnowledge = "known"

    @property
    def start_known(self) -> Start:
        """Knowledge of the start states."""
        return self.start if isinstance(self.start, str) else dict(self.start)


class Outputs(StateSensor):
    """Outputs read at the samples, the first at the start, of a system with states.

    Attributes:
        diffusion: process noise, by the states' names: standard deviations after 1 s, in units of the state
            over s^(1/2).
    """

    kind: Literal["outputs"] = "outputs"
    diffusion: Quantities = ()

    @property
    def process_noise(self) -> Diffusion | None:
        """Diffusion of the states; None without any."""
        return diffusion_of(self.diffusion)

    def steady(self) -> Self:
        """Return the sensor of a system without process noise."""
        return self.model_copy(update={"diffusion": ()}) if self.diffusion else self

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Refuse also diffusion of what is no state, or in other units."""
        diffusion = diffusion_issues(self.diffusion, system) if isinstance(system, OutputSystem) else ()
        return [*super().issues(system, samples), *diffusion]

    @property
    def remark(self) -> str:
        """Process noise in words."""
        noise = self.process_noise
        return "" if noise is None else f"; the system drifts by {noise.text}"


class Rates(StateSensor):
    """Outputs read all the time, of a system with states: in a second as much as one reading with the noise.

    The noise is white, and its mean over a second has the standard deviation. Outputs in the middle of a
    period stand for those of the period.
    """

    kind: Literal["rates"] = "rates"
    when: ClassVar[When] = "in periods"
    continuous: ClassVar[bool] = True

    def brief(self, samples: int) -> str:
        """Describe the readings of a trial."""
        return f"readings of {self.subject} all the time"

    def sentence(self, samples: int) -> str:
        """Describe the readings and their noise."""
        return f"{self.subject} all the time, the mean of a second with {self.noise_text}"

    def whitening(self, moment: Moment) -> Expression:
        """Return sqrt(T) / sigma of all outputs, as a diagonal matrix."""
        return super().whitening(moment) * ca.sqrt(moment.period)


class Responses(OutputSensor):
    """Outputs of a system without states, read once for each setting of its inputs."""

    kind: Literal["responses"] = "responses"
    when: ClassVar[When] = "in periods"

    def sentence(self, samples: int) -> str:
        """Describe the readings of so many settings, and their noise."""
        return f"{self.subject} at each setting ({count(samples, 'time')}) with {self.noise_text}"


SENSORS: tuple[type[OutputSensor], ...] = (Outputs, Rates, Responses)
"""All sensors of outputs."""


class SeveralOutputs(Sensors):
    """Outputs read together; in a study, a list of sensors."""

    kind: Literal["several"] = "several"
    sensors: Annotated[tuple[Annotated[OutputSensor, OneOf(SENSORS)], ...], Field(min_length=1)]


def replaced_starts(
    measurement: Measurement | Sensor, deviations: tuple[tuple[str, float], ...]
) -> Measurement:
    """Return a measurement that knows start states less well; sensors that say so themselves are left alone.

    Args:
        measurement: outputs.
        deviations: standard deviations by the states' names, SI.
    """
    sensors = [
        sensor.model_copy(update={"start": deviations})
        if getattr(sensor, "start", None) == "known"
        else sensor
        for sensor in sensors_of(measurement)
    ]
    return measurement_of(sensors)


def _check_noise(dimensions: Mapping[str, Dimension], name: str, value: Quantity) -> None:
    if name not in dimensions:
        raise ValueError(no_such("output", dimensions, name))
    if is_share(value):
        text = f"{value} of what? A standard deviation is of one size: give it in the unit of {name}"
        raise ValueError(f"{text}, a plain number where that has none")
    size, _ = quantity(value)
    least = 1 / SIZES[1]
    if size < least:
        expected = f"of at least {least:g} in SI units" if size > 0 else "above 0"
        raise ValueError(f"expected a standard deviation {expected}, got {value}")
    expect_quantity(value, dimensions[name], f"{name} is {{expected}}, its noise {{got}}")
