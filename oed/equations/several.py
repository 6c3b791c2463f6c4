"""Outputs that are read by several sensors, each in its own way."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from oed.equations.outputs import Outputs, OutputSensor, Rates, Responses
from oed.foundation.component import OneOf
from oed.kernel.measurement.measurement import Measurement
from oed.kernel.measurement.sensor import joined
from oed.kernel.measurement.several import Together

SENSORS: tuple[type[OutputSensor], ...] = (Outputs, Rates, Responses)
"""Every way of reading outputs."""


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
