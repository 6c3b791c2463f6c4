"""Several sensors on one drive: their information adds up, the initial pose is theirs together."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from oed.foundation.component import OneOf
from oed.foundation.errors import Flaw
from oed.foundation.text import listing
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.measurement import Block, Cuts, Measurement
from oed.kernel.measurement.sensor import Sensor, joins, joint_block, joint_cuts
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


@joins
class Several(Measurement):
    """Sensors used together; in a study, a list of them."""

    kind: Literal["several"] = "several"
    sensors: Annotated[tuple[Annotated[Sensor, OneOf((*SENSORS, PythonSensor))], ...], Field(min_length=1)]

    def blocks(self, drive: Drive) -> tuple[Block, ...]:
        """One block of all sensors."""
        return (joint_block(self.sensors, drive),)

    def flaws(self, system: System, samples: int) -> list[Flaw]:
        """The sensors' own flaws, and sensors that disagree on what is known of the initial pose."""
        flaws = [
            Flaw(("measurement", index, *flaw.key[1:]), flaw.message)
            for index, sensor in enumerate(self.sensors)
            for flaw in sensor.flaws(system, samples)
        ]
        known = [sensor.start_known for sensor in self.sensors]
        given = [entry for entry in known if entry is not None]
        for index, entry in enumerate(known):
            if entry is not None and entry != given[0]:
                text = "differs from that of the sensors before; there is one initial pose"
                flaws.append(Flaw(("measurement", index, "initial_pose"), text))
        return flaws

    @property
    def joint_sensors(self) -> tuple[Sensor, ...]:
        """All of them."""
        return self.sensors

    def cuts(self, samples: int) -> Cuts | None:
        """Where all sensors read."""
        return joint_cuts(self.sensors)

    def coarser(self, times: float) -> Several | None:
        """The sensors' own."""
        sensors = [sensor.coarser(times) for sensor in self.sensors]
        return None if None in sensors else self.model_copy(update={"sensors": tuple(sensors)})

    def brief(self, samples: int) -> str:
        """What is read by each sensor."""
        return listing([sensor.brief(samples) for sensor in self.sensors])

    def sentence(self, samples: int) -> str:
        """What each sensor says of itself."""
        return "; ".join(sensor.sentence(samples) for sensor in self.sensors)
