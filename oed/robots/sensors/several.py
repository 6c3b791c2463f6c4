"""Several sensors on one drive: their information adds up, the initial pose is theirs together."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from oed.foundation.component import OneOf
from oed.kernel.measurement.measurement import Sensors
from oed.kernel.measurement.sensor import Sensor
from oed.robots.own_parts import PythonSensor
from oed.robots.sensors.biased import TrailerAngle, YawRate
from oed.robots.sensors.landmarks import Landmarks, Tags
from oed.robots.sensors.mapped import Ranges
from oed.robots.sensors.poses import Poses
from oed.robots.sensors.relative_poses import RelativePoses

SENSORS: tuple[type[Sensor], ...] = (
    Poses,
    RelativePoses,
    Ranges,
    Landmarks,
    Tags,
    YawRate,
    TrailerAngle,
)
"""Every sensor of this package."""


class Several(Sensors):
    """Sensors used together; in a study, a list of them."""

    kind: Literal["several"] = "several"
    sensors: Annotated[tuple[Annotated[Sensor, OneOf((*SENSORS, PythonSensor))], ...], Field(min_length=1)]
