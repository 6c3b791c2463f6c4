"""Several sensors of one experiment: their information adds up, the start is theirs together."""

from __future__ import annotations

from abc import ABC
from typing import Self

from oed.foundation.errors import Issue
from oed.foundation.text import listing
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.measurement import Block, Cuts, Measurement
from oed.kernel.measurement.sensor import Sensor, joint_block, joint_cuts


class Together(Measurement, ABC):
    """Sensors used together; in a study, a list of them. A domain says which there are.

    Attributes:
        sensors: at least one.
    """

    sensors: tuple[Sensor, ...]

    def blocks(self, drive: Drive) -> tuple[Block, ...]:
        """One block of all sensors."""
        return (joint_block(self.sensors, drive),)

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

    def cuts(self, samples: int) -> Cuts | None:
        """Where all sensors read."""
        return joint_cuts(self.sensors)

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
