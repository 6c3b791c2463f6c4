"""What all sensors read of a designed drive, whose runs are segments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from oed.estimation.prediction.layout import Layout
from oed.estimation.prediction.segments import SegmentReadings
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.sensor import Sensor, whole_whitening
from oed.robots.models.model import Model

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class DriveReadings:
    """Readings of a drive: given sensor by sensor, run by run and time by time; computed run by run.

    Attributes:
        each: what every sensor reads of the runs.
        trajectory: the drive.
    """

    each: tuple[SegmentReadings, ...]
    trajectory: Trajectory

    @classmethod
    def of(cls, robot: Model, sensors: Sequence[Sensor], trajectory: Trajectory) -> DriveReadings:
        """What `sensors` read of a robot's drive."""
        runs, periods = trajectory.runs, trajectory.samples // trajectory.runs
        each = tuple(SegmentReadings(robot, one, runs, periods) for one in sensors)
        return cls(each, trajectory)

    def derivatives(
        self, starts: Array, inputs: Array, times: Array, parameters: Array, nuisances: Array
    ) -> tuple[Array, Array]:
        """The readings (runs, M, 1), SI, and their derivatives (runs, M, 1, p + states + k).

        Args:
            starts: states at the runs' beginnings, (runs, states).
            inputs: held in each period, (runs, n, inputs).
            times: lengths of the periods [s], (runs, n).
            parameters: (p,), SI.
            nuisances: all sensors' own, (k,), SI.
        """
        readings, slopes, leading = list[Array](), list[Array](), len(parameters) + starts.shape[1]
        # The nuisances before and after a sensor's own do not concern it.
        before, after = 0, len(nuisances)
        for one in self.each:
            after -= len(one.sensor.nuisances)
            own = nuisances[before : len(nuisances) - after]
            found, by_own = one.derivatives(starts, inputs, times, parameters, own)
            rows = by_own.reshape(len(starts), found[0].size, 1, -1)
            wide = np.insert(rows, [leading] * before, 0.0, axis=-1)
            readings.append(found.reshape(rows.shape[:3]))
            slopes.append(np.pad(wide, ((0, 0), (0, 0), (0, 0), (0, after))))
            before += len(one.sensor.nuisances)
        return np.concatenate(readings, axis=1), np.concatenate(slopes, axis=1)

    @cached_property
    def nominal(self) -> tuple[Array, ...]:
        """The readings of each sensor, (runs, times, q), where nothing is off its nominal value, SI."""
        return tuple(one(*given) for one, given in self._at_nominal)

    @property
    def _at_nominal(self) -> Iterator[tuple[SegmentReadings, tuple[Array, ...]]]:
        drive = Layout.of_drive(self.trajectory, np.zeros((self.trajectory.runs, 0)))
        for one in self.each:
            nuisances = np.array([entry.nominal for entry in one.sensor.nuisances])
            given = self.trajectory.starts, drive.inputs(np.zeros(0)), drive.steps
            yield one, (*given, np.array(one.model.nominal), nuisances)

    @cached_property
    def order(self) -> Indices:
        """Where each reading run by run stands among those sensor by sensor, (M of all runs,)."""
        places, first = list[Indices](), 0
        for found in self.nominal:
            places.append(first + np.arange(found.size).reshape(len(found), -1))
            first += found.size
        return np.concatenate(places, axis=1).ravel()

    def by_run(self, readings: Array) -> Array:
        """Readings sensor by sensor (M of all runs,) run by run, (runs, M)."""
        return readings[self.order].reshape(self.trajectory.runs, -1)

    def by_sensor(self, readings: Array) -> Array:
        """Readings run by run, however shaped, sensor by sensor (M of all runs,)."""
        found = np.empty(readings.size)
        found[self.order] = readings.ravel()
        return found

    def unwrapped(self, readings: Array) -> Array:
        """Readings (M of all runs,) whose angles are unwrapped, and begin near the nominal."""
        found, first = readings.copy(), 0
        for one, nominal in zip(self.each, self.nominal, strict=True):
            own = found[first : first + nominal.size].reshape(nominal.shape)
            for run, place in product(range(len(own)), one.sensor.angles):
                angles = np.unwrap(own[run, :, place])
                turns = np.rint((nominal[run, 0, place] - angles[0]) / (2 * np.pi))
                own[run, :, place] = angles + 2 * np.pi * turns
            first += nominal.size
        return found

    @cached_property
    def _whitener(self) -> Any:
        # Block diagonal A with A R A' = 1, sensor by sensor, at the nominal values.
        blocks = list[Any]()
        for one, given in self._at_nominal:
            each = one.whitening(*given)
            whole = whole_whitening(one.sensor, each[0, ..., 0].size)
            if whole is None:
                blocks += [*each.reshape(-1, *each.shape[2:])]
            else:
                blocks += [scipy.sparse.csr_array(whole)] * one.count
        return scipy.sparse.csr_array(scipy.sparse.block_diag(blocks))

    @cached_property
    def whitener(self) -> Any:
        """A with A R A' = 1 for the specified covariance R of the readings, run by run."""
        return self._whitener[self.order][:, self.order]

    @cached_property
    def colour(self) -> Any:
        """From standard normal numbers to noise, sensor by sensor."""
        return scipy.sparse.csr_array(scipy.sparse.linalg.inv(scipy.sparse.csc_array(self._whitener)))
