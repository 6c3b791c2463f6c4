"""What is estimated besides every segment's start, and what is known of it from before: parameters, the
sensor's place, clock offsets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.blocks import Nuisance
from oed.kernel.measurement.measurement import Measurement
from oed.kernel.measurement.square_root import SquareRoot
from oed.robots.models.model import Model, robot_of
from oed.robots.models.twists import coefficient_values
from oed.robots.sensors.mounting import PLACE as UNITS
from oed.robots.sensors.mounting import LeverArm, Mount
from oed.robots.sensors.relative_poses import logged_sensors

PlaceName = Literal["sensor_x", "sensor_y", "sensor_heading"]
PLACE: tuple[PlaceName, ...] = ("sensor_x", "sensor_y", "sensor_heading")
"""Where on the robot the pose sensor sits: ahead of the origin and to its left [m], and how it is turned
[rad]."""
SIZE = 0.1
"""Size of a sensor's place [m, rad] and of a clock's offset [s], for scaling only."""


@dataclass(frozen=True)
class Unknowns:
    """The unknowns common to segments, in one vector: parameters, starts of a drive's runs, sensor's place or
    other constants of sensors, clock offsets.

    Attributes:
        system: with all its parameters.
        parameters: names of those that are estimated; the others are nominal.
        place: which of `constants` are estimated; the others are as `sits` says.
        clocks: how many clock offsets are estimated; 0 where the clocks agree.
        sits: where the sensor is thought to sit, or what the constants nominally are, all of them.
        constants: what readings depend on besides a robot's parameters and states, with their units.
        starts: coordinates of a designed drive's starts, run by run, with their nominal values; () where they
            are known, or unknowns of each segment alone.
        sizes: of all unknowns, for scaling only; () for those of the parameters and of a robot's places.
    """

    system: System
    parameters: tuple[str, ...]
    place: tuple[str, ...]
    clocks: int
    sits: tuple[float, ...] = (0.0, 0.0, 0.0)
    constants: Mapping[str, str] = field(default_factory=lambda: UNITS)
    starts: tuple[Nuisance, ...] = ()
    sizes: tuple[float, ...] = ()

    @property
    def robot(self) -> Model:
        """The system, which has to be a robot.

        Raises:
            UserMistake: it is none.
        """
        return robot_of(self.system)

    @property
    def names(self) -> tuple[str, ...]:
        """Of all, (q,)."""
        offsets = [f"clock_offset_{index + 1}" if self.clocks > 1 else "clock_offset" for index in self._each]
        return (*self.parameters, *(one.name for one in self.starts), *self.place, *offsets)

    @property
    def units(self) -> tuple[str, ...]:
        """Their SI units."""
        table = {one.name: one.unit for one in self.system.parameters} | dict(self.constants)
        starts = (one.unit for one in self.starts)
        known = (table[name] for name in self.parameters), (table[name] for name in self.place)
        return (*known[0], *starts, *known[1], *("s" for _ in self._each))

    @property
    def size(self) -> int:
        """How many there are, q."""
        return len(self.parameters) + len(self.starts) + len(self.place) + self.clocks

    @property
    def scale(self) -> Array:
        """What makes them comparable: the parameters' sizes, those of a place and a clock, (q,).

        A nominal value that is but a first guess, far smaller than the size a parameter may have, is none.
        """
        if self.sizes:
            return np.array(self.sizes)
        sizes = ((one.name, max(one.scale, one.size)) for one in self.system.parameters)
        table = {name: size or 1.0 for name, size in sizes}
        rest = [SIZE] * (self.size - len(self.parameters))
        return np.array([*(table[name] for name in self.parameters), *rest])

    @property
    def nominal(self) -> Array:
        """Nominal values of the parameters, the starts and the place, clock offsets 0."""
        table = {parameter.name: parameter.nominal for parameter in self.system.parameters}
        places = dict(zip(self.constants, self.sits, strict=True))
        own = [*(table[name] for name in self.parameters), *(one.nominal for one in self.starts)]
        return np.array([*own, *(places[name] for name in self.place), *[0.0] * self.clocks])

    def slopes(self, slopes: Array) -> Array:
        """Derivatives (..., S, K, k, q) of S segments by the unknowns but the clocks, from those by all
        parameters, the segment's own start and all constants, (..., S, K, k, columns).
        """
        count, states = len(self._nominals), len(self.system.states)
        first = count + states
        own = slopes[..., self._own]
        place = slopes[..., [first + one for one in self._places]]
        if not self.starts:
            return np.concatenate([own, place], axis=-1)
        # Of every run's start, for the run's own readings.
        starts = np.zeros((*slopes.shape[:-1], len(self.starts)))
        for run in range(slopes.shape[-4]):
            starts[..., run, :, :, run * states : (run + 1) * states] = slopes[..., run, :, :, count:first]
        return np.concatenate([own, starts, place], axis=-1)

    def parts(self, values: Array) -> tuple[Array, Array, Array]:
        """All the system's parameters (..., p), the place or other constants, the clock offsets given, at
        values (..., q).
        """
        parameters, place = (np.tile(one, (*values.shape[:-1], 1)) for one in (self._nominals, self.sits))
        last = self.size - self.clocks
        first = last - len(self.place)
        parameters[..., self._own] = values[..., : len(self.parameters)]
        place[..., self._places] = values[..., first:last]
        return parameters, place, values[..., last:]

    def coefficients(self, parameters: Array) -> tuple[tuple[str, ...], Array, Array]:
        """Names of a robot's coefficients, values, and derivatives by the parameters estimated, at
        all its parameters (p,).
        """
        names, values, slopes = coefficient_values(self.robot, parameters)
        return names, values, slopes[:, self._own]

    def begins(self, values: Array) -> Array:
        """The starts of a drive's runs, (..., runs, states), at values (..., q); (..., 0, states) where they
        are no unknowns here.
        """
        first, states = len(self.parameters), len(self.system.states)
        own = values[..., first : first + len(self.starts)]
        return np.asarray(own.reshape(*own.shape[:-1], own.shape[-1] // max(states, 1), states))

    @property
    def _each(self) -> range:
        return range(self.clocks)

    @cached_property
    def _own(self) -> list[int]:
        # Which of the system's parameters are estimated.
        names = [parameter.name for parameter in self.system.parameters]
        return [names.index(name) for name in self.parameters]

    @cached_property
    def _places(self) -> list[int]:
        # Which of the constants are estimated.
        constants = list(self.constants)
        return [constants.index(name) for name in self.place]

    @cached_property
    def _nominals(self) -> Array:
        return np.array(self.system.nominal, dtype=float)


def specified_mount(measurement: Measurement, *, relative: bool = False) -> Mount:
    """Where the first sensor sits that says so; at the robot's origin if none does. Of those that read their
    own motion if `relative`, else of the others.
    """
    logged = logged_sensors(measurement, relative)
    return next((sensor.mount for sensor in logged if sensor.mount is not None), LeverArm())


@dataclass(frozen=True)
class Knowledge:
    """A prior of the unknowns: information (q, q) about `centre` (q,), SI."""

    information: Array
    centre: Array

    @classmethod
    def nothing(cls, size: int) -> Knowledge:
        """Of as many unknowns."""
        return cls(np.zeros((size, size)), np.zeros(size))

    def on(self, columns: Places) -> Knowledge:
        """That of some of the unknowns, the others held where they are known to be."""
        return Knowledge(self.information[np.ix_(columns, columns)], self.centre[columns])

    def score(self, values: Array) -> Array:
        """Half the slope of what it adds to the misfit, downhill, (q,)."""
        return np.asarray(self.information @ (self.centre - values))

    def misfit(self, values: Array) -> float:
        """What it adds to the sum of squares."""
        off = self.centre - values
        return float(off @ self.information @ off)


def inverse_of_identifiable(matrix: Array) -> Array:
    """The inverse of information (..., q, q) on what is identifiable; 0 in other directions."""
    factor = SquareRoot.of_matrix(matrix).factor
    return np.asarray(factor @ np.swapaxes(factor, -1, -2))


def inverse_of_sum(information: Array, known: Array) -> Array:
    """(F + K)^-1 of information F and knowledge from before K, both (q, q).

    In units of K nothing is too small to be inverted, however much larger F is on the rest.
    """
    try:
        root = np.linalg.inv(np.linalg.cholesky(known))
    except np.linalg.LinAlgError:
        return inverse_of_identifiable(information + known)
    eigenvalues, vectors = np.linalg.eigh(root @ information @ root.T)
    back = root.T @ vectors
    return np.asarray(back / (1 + np.clip(eigenvalues, 0.0, None)) @ back.T)
