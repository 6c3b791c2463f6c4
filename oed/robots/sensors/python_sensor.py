"""A sensor of the user's own, named in a study by where its class stands."""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict

from oed.foundation.component import Component
from oed.foundation.own.part import OwnPart
from oed.kernel.measurement.sensor import Sensor


class SensorDescription(Component):
    """What a sensor of the user's own says of itself."""

    kind: str | None = None
    when: Literal["at samples", "in periods"] | None = None
    subject: str | None = None
    units: tuple[str, ...] | None = None
    noise_text: str | None = None
    remark: str | None = None


class PythonSensor(OwnPart, Sensor):
    """The sensor that `object` ("my_module:MySensor") makes of all further keys."""

    model_config = ConfigDict(extra="allow")

    noun = "sensor"
    kind: Literal["python"] = "python"
    described: SensorDescription | None = None
