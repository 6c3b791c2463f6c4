"""Outputs that are read by several sensors, each in its own way."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from oed.equations.outputs import Outputs, OutputSensor, Rates, Responses
from oed.foundation.component import OneOf
from oed.kernel.measurement.several import Together

SENSORS: tuple[type[OutputSensor], ...] = (Outputs, Rates, Responses)
"""Every way of reading outputs."""


class SeveralOutputs(Together):
    """Outputs read together; in a study, a list of sensors."""

    kind: Literal["several"] = "several"
    sensors: Annotated[tuple[Annotated[OutputSensor, OneOf(SENSORS)], ...], Field(min_length=1)]
