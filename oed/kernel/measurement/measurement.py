"""Measurements: regressions, each blocks of y = W c + noise, or sensors whose readings make up one block."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from operator import is_
from typing import Annotated, Self

import casadi as ca
import numpy as np
from pydantic import Field

from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.text import listing, words
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.blocks import Block, Nuisance
from oed.kernel.measurement.filter import innovations, memories_of
from oed.kernel.measurement.readings import joint_readings, labelled_nuisances
from oed.kernel.measurement.sensor import Sensor, process_noise_of

Key = tuple[str | int, ...]

FRAME = 1e-3
"""Standard deviation of start states that define the frame, SI. Its size does not matter: readings that do
not depend on the frame say the same about everything else."""


@dataclass(frozen=True)
class Cuts:
    """Rule for cutting drives of a measurement into pieces whose information, or whose rows, add up.

    Attributes:
        segment: samples of every segment of a regression, whose rows add up over the pieces of a segment.
        regression: measurement of a single segment; None where readings are estimated from together.
    """

    segment: int = 1
    regression: Measurement | None = None


class Measurement(Component, ABC):
    """Quantities that are measured, with their noise: a regression, or `Sensors`."""

    kind: str

    @abstractmethod
    def blocks(self, drive: Drive) -> tuple[Block, ...]:
        """Return the estimations that `drive` allows, each with its own parameters."""

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Return why this measurement is impossible for `system` and so many samples; [] if it is not."""
        return []

    def steady(self) -> Measurement:
        """Return this measurement of a system without process noise."""
        return self

    def cuts(self, samples: int) -> Cuts | None:
        """Return how drives of so many samples per run can be cut; None where they cannot."""
        return None

    @property
    def grid_multiple(self) -> int:
        """Number of which a run's samples should be a multiple."""
        return 1

    def coarser(self, times: float) -> Measurement | None:
        """Return much the same measurement of a drive with so many times fewer samples; None without any.

        Its information need only be in proportion: searches on fewer samples correct the rest.
        """
        return None

    def brief(self, samples: int) -> str:
        """Return in words which quantities of a drive of so many samples are measured."""
        return words(self.kind)

    def sentence(self, samples: int) -> str:
        """Return in words which quantities are measured, when and how noisily."""
        return self.brief(samples)


class Sensors(Measurement):
    """Sensors whose readings are estimated from together: one block, with the start states as nuisances.

    Attributes:
        sensors: the sensors, at least one.
    """

    kind: str = "several"
    sensors: Annotated[tuple[Sensor, ...], Field(min_length=1)]

    def blocks(self, drive: Drive) -> tuple[Block, ...]:
        """Return the readings of all sensors as one estimation of the system's parameters."""
        system, sensors = drive.system, self.sensors
        size = len(system.parameters)
        responses, jacobian = joint_readings(sensors, drive)
        noise = process_noise_of(sensors)
        if noise is not None:
            # Readings share what the process did before them: their innovations do not.
            jacobian = innovations(sensors, drive, noise)
        start, constants = start_nuisances(sensors, system, drive.runs), labelled_nuisances(sensors)
        nuisances, columns = (*start, *constants), jacobian.shape[1]
        # A start that is known is no unknown.
        design = jacobian[:, [*range(size + len(start)), *range(columns - len(constants), columns)]]
        block = Block(
            name="joint",
            parameters=tuple(parameter.name for parameter in system.parameters),
            nominal=np.array(system.nominal, dtype=float),
            units=tuple(parameter.unit for parameter in system.parameters),
            response=ca.vertcat(*responses),
            jacobian=design,
            noise=1.0,
            nuisances=nuisances,
            scales=np.array([parameter.scale for parameter in system.parameters]),
        )
        return (block,)

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Return the sensors' issues, and sensors that disagree on the start or on how the process errs."""
        issues = [
            Issue(("measurement", place, *issue.key[1:]), issue.message)
            for place, sensor in enumerate(self.sensors)
            for issue in sensor.issues(system, samples)
        ]
        starts = [sensor.start_known for sensor in self.sensors]
        first = next((start for start in starts if start is not None), None)
        for place, start in enumerate(starts):
            if start not in (None, first):
                name = system.start_name
                text = f"differs from that of the sensors before; there is one {name.replace('_', ' ')}"
                issues.append(Issue(("measurement", place, name), text))
        return [*issues, *self._process_issues(system)]

    def _process_issues(self, system: System) -> Iterator[Issue]:
        # Why no filter can take in the process noise that sensors state.
        noise = process_noise_of(self.sensors)
        if noise is None:
            return
        yield from noise.issues(system)
        for place, sensor in enumerate(self.sensors):
            key: Key = ("measurement", place)
            if sensor.process_noise not in (None, noise):
                text = "differs from that of the sensors before; a system drifts in one way"
                yield Issue((*key, noise.key), text)
            if sensor.when == "in periods" and not noise.signal:
                text = f"readings of whole periods do not go with {noise.key}, which is left out within them"
                yield Issue((*key, "kind"), f"{text}: read at the samples, or leave out `{noise.key}`")
            if sensor.joint_whitening is not None:
                text = "one covariance of all readings does not go with drift, whose filter takes in one by "
                text += "one: give that of one reading"
                yield Issue((*key, "noise", "covariance"), text)

    def steady(self) -> Self:
        """Return the sensors of a system without process noise."""
        sensors = tuple(sensor.steady() for sensor in self.sensors)
        is_steady = all(map(is_, sensors, self.sensors))
        return self if is_steady else self.model_copy(update={"sensors": sensors})

    def cuts(self, samples: int) -> Cuts | None:
        """Return how drives can be cut where all sensors read; None where they cannot.

        They cannot where the noise of a sensor is correlated over time, or where a sensor reads across
        several samples that no filter goes through.
        """
        if any(sensor.joint_whitening is not None for sensor in self.sensors):
            return None
        if process_noise_of(self.sensors) is None and memories_of(self.sensors):
            return None
        return Cuts()

    def coarser(self, times: float) -> Self | None:
        """Return sensors that read a drive of fewer samples; None where a sensor cannot."""
        sensors = [sensor.coarser(times) for sensor in self.sensors]
        return None if None in sensors else self.model_copy(update={"sensors": tuple(sensors)})

    def brief(self, samples: int) -> str:
        """Return in words which quantities the sensors read."""
        return listing([sensor.brief(samples) for sensor in self.sensors])

    def sentence(self, samples: int) -> str:
        """Return in words which quantities the sensors read, when and how noisily."""
        return "; ".join(sensor.sentence(samples) for sensor in self.sensors)


def measurement_of(measured: Measurement | Sensor | Sequence[Sensor]) -> Measurement:
    """Return a measurement for what may be given as one: itself, a sensor or several of them."""
    if isinstance(measured, Measurement):
        return measured
    sensors = (measured,) if isinstance(measured, Sensor) else tuple(measured)
    return Sensors(kind=sensors[0].kind if len(sensors) == 1 else "several", sensors=sensors)


def sensors_of(measured: Measurement | Sensor | None) -> tuple[Sensor, ...]:
    """Return the sensors of a measurement, or a sensor itself; () for a regression, and for None."""
    if isinstance(measured, Sensor):
        return (measured,)
    return measured.sensors if isinstance(measured, Sensors) else ()


def start_nuisances(sensors: Sequence[Sensor], system: System, runs: int = 1) -> tuple[Nuisance, ...]:
    """Return the start states, run by run, that are nuisances; () where they are known or do not matter.

    Args:
        sensors: sensors that say what is known about the start.
        system: system whose states they are.
        runs: number of runs, each with its own start.
    """
    placed = [sensor for sensor in sensors if sensor.start_known is not None]
    if not placed or placed[0].start_known == "known":
        return ()
    deviations = placed[0].start_known if isinstance(placed[0].start_known, Mapping) else {}
    frame = set.intersection(*(set(sensor.gauge) for sensor in placed))
    return tuple(
        Nuisance(
            f"{system.start_name}{f'_{run + 1}' if runs > 1 else ''}.{state}",
            0.0,
            unit,
            FRAME if state in frame and not run else _deviation(deviations, state, unit),
        )
        for run in range(runs)
        for state, unit in zip(system.states, system.state_units, strict=True)
    )


def _deviation(deviations: Mapping[str, float], state: str, unit: str) -> float | None:
    deviation = deviations.get(state, deviations.get(unit, inf))
    return deviation if isfinite(deviation) else None
