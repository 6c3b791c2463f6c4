"""What is estimated besides every segment's start: parameters, the sensor's place, clock offsets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from oed.kernel.measurement.measurement import Measurement
from oed.robots.models.model import Model
from oed.robots.sensors.logged import LoggedSensor, Mount

Array = npt.NDArray[np.float64]

PlaceName = Literal["sensor_x", "sensor_y", "sensor_heading"]
PLACE: tuple[PlaceName, ...] = ("sensor_x", "sensor_y", "sensor_heading")
"""Where on the robot the pose sensor sits: ahead of the origin and to its left [m], and how it is turned
[rad]."""
PLACE_SIZE = 0.1
"""Size of a sensor's place [m, rad] and of a clock's offset [s], for scaling only."""


@dataclass(frozen=True)
class Unknowns:
    """The unknowns common to segments, in one vector: parameters, sensor's place, clock offsets.

    Attributes:
        robot: with all its parameters.
        parameters: names of those that are estimated; the others are nominal.
        place: which of `PLACE` are estimated; the others are as `sits` says.
        clocks: how many clock offsets are estimated; 0 where the clocks agree.
        sits: where the sensor is thought to sit, all of `PLACE`.
    """

    robot: Model
    parameters: tuple[str, ...]
    place: tuple[str, ...]
    clocks: int
    sits: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def names(self) -> tuple[str, ...]:
        """Of all, (q,)."""
        offsets = [f"clock_offset_{index + 1}" if self.clocks > 1 else "clock_offset" for index in self._each]
        return (*self.parameters, *self.place, *offsets)

    @property
    def units(self) -> tuple[str, ...]:
        """Their SI units."""
        table = {parameter.name: parameter.unit for parameter in self.robot.parameters}
        angles = {"sensor_heading": "rad"}
        own = (table[name] for name in self.parameters)
        return (*own, *(angles.get(name, "m") for name in self.place), *("s" for _ in self._each))

    @property
    def size(self) -> int:
        """How many there are, q."""
        return len(self.parameters) + len(self.place) + self.clocks

    @property
    def scale(self) -> Array:
        """What makes them comparable: the parameters' sizes, those of a place and a clock, (q,).

        A nominal value that is but a first guess, far smaller than the size a parameter may have, is none.
        """
        sizes = ((one.name, max(one.scale, one.size)) for one in self.robot.parameters)
        table = {name: size or 1.0 for name, size in sizes}
        rest = [PLACE_SIZE] * (len(self.place) + self.clocks)
        return np.array([*(table[name] for name in self.parameters), *rest])

    @property
    def nominal(self) -> Array:
        """Nominal values of the parameters and the place, clock offsets 0."""
        table = {parameter.name: parameter.nominal for parameter in self.robot.parameters}
        places: dict[str, float] = dict(zip(PLACE, self.sits, strict=True))
        own = [*(table[name] for name in self.parameters), *(places[name] for name in self.place)]
        return np.array([*own, *[0.0] * self.clocks])

    @property
    def columns(self) -> list[int]:
        """Of the derivatives by (parameters, start, place), those by the parameters and the place here."""
        names = [parameter.name for parameter in self.robot.parameters]
        skip = len(names) + len(self.robot.states)
        return [*map(names.index, self.parameters), *(skip + PLACE.index(name) for name in self.place)]

    def parts(self, values: Array) -> tuple[Array, Array, Array]:
        """All the robot's parameters (p,), the sensor's place (3,), the clock offsets given."""
        parameters, place = np.array(self.robot.nominal, dtype=float), np.array(self.sits)
        names, first = [parameter.name for parameter in self.robot.parameters], len(self.parameters)
        last = first + len(self.place)
        parameters[[names.index(name) for name in self.parameters]] = values[:first]
        place[[PLACE.index(name) for name in self.place]] = values[first:last]
        return parameters, place, values[last:]

    @property
    def _each(self) -> range:
        return range(self.clocks)


def specified_mount(measurement: Measurement) -> Mount:
    """Where the first sensor sits that says so; at the robot's origin if none does."""
    logged = (sensor for sensor in measurement.joint_sensors if isinstance(sensor, LoggedSensor))
    return next((sensor.mount for sensor in logged if sensor.mount is not None), Mount())
