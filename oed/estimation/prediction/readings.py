"""A drive's readings as functions of what is unknown: what joint estimation computes them from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from oed.estimation.prediction.segments import SegmentReadings
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.measurement import Nuisance
from oed.kernel.measurement.sensor import Sensor, labelled_nuisances, start_nuisances, whole_whitening
from oed.robots.models.model import Model

Array = npt.NDArray[np.float64]


class PredictedReadings:
    """What sensors read of one drive, as functions of the unknowns: parameters, initial pose, nuisances.

    Every run of the drive is a segment; readings are sensor by sensor, run by run and time by time.

    Args:
        robot: whose parameters are unknown.
        sensors: in the order of the readings.
        trajectory: the drive.
        parameters: names of those that are unknown; the others are nominal.
    """

    def __init__(
        self,
        robot: Model,
        sensors: Sequence[Sensor],
        trajectory: Trajectory,
        parameters: Sequence[str],
    ) -> None:
        """Arrange the runs as segments, and the unknowns one after the other."""
        runs = trajectory.runs
        periods = trajectory.samples // runs
        self._each = tuple(SegmentReadings(robot, one, runs, periods) for one in sensors)
        self._inputs = trajectory.inputs.reshape(runs, periods, -1)
        self._times = np.full((runs, periods), trajectory.period)
        start = start_nuisances(sensors, robot, runs)
        names = [parameter.name for parameter in robot.parameters]
        self._places = [names.index(name) for name in parameters]
        self._places += range(len(names), len(names) + len(start))
        self._nominal = np.concatenate([robot.nominal, trajectory.starts.ravel()])
        self.nuisances: tuple[Nuisance, ...] = (*start, *labelled_nuisances(sensors))

    @cached_property
    def initial(self) -> Array:
        """The unknowns' nominal values, SI."""
        own = [nuisance.nominal for one in self._each for nuisance in one.sensor.nuisances]
        return np.concatenate([self._nominal[self._places], own])

    def response(self, unknowns: Array) -> Array:
        """The noise-free readings (M,), SI."""
        return np.concatenate([one(*given).ravel() for one, given in self._at(unknowns)])

    def slope(self, unknowns: Array) -> Array:
        """Their derivatives by the unknowns, (M, unknowns)."""
        parts, first = list[Array](), len(self._nominal)
        for one, given in self._at(unknowns):
            parts.append(self._by_all(one, one.derivatives(*given)[1], first))
            first += len(one.sensor.nuisances)
        return np.concatenate(parts)[:, [*self._places, *range(len(self._nominal), first)]]

    def _by_all(self, one: SegmentReadings, slopes: Array, first: int) -> Array:
        # By all parameters, starts of runs and sensors' nuisances; its own of these begin at `first`.
        size, states = len(one.model.parameters), len(one.model.states)
        parameters, starts, nuisances = np.split(slopes, [size, size + states], axis=-1)
        found = np.zeros((*slopes.shape[:-1], len(self._nominal) + self._own_count))
        found[..., :size], found[..., first : first + nuisances.shape[-1]] = parameters, nuisances
        for run in range(one.count):
            begin = size + run * states
            found[run, ..., begin : begin + states] = starts[run]
        return found.reshape(-1, found.shape[-1])

    def unwrapped(self, readings: Array) -> Array:
        """Readings (M,) whose angles run on where they jumped by full turns, and begin near the nominal."""
        found, first = readings.copy(), 0
        for one, given in self._at(self.initial):
            nominal = one(*given)
            own = found[first : first + nominal.size].reshape(nominal.shape)
            for run, place in product(range(len(own)), one.sensor.angles):
                angles = np.unwrap(own[run, :, place])
                turns = np.rint((nominal[run, 0, place] - angles[0]) / (2 * np.pi))
                own[run, :, place] = angles + 2 * np.pi * turns
            first += nominal.size
        return found

    @cached_property
    def whitener(self) -> Any:
        """Block diagonal A (M, M) with A R A' = 1, at the nominal values: the noise is taken for known."""
        blocks = list[Any]()
        for one, given in self._at(self.initial):
            each = one.whitening(*given)
            whole = whole_whitening(one.sensor, each[0, ..., 0].size)
            if whole is None:
                blocks += [*each.reshape(-1, *each.shape[2:])]
            else:
                blocks += [scipy.sparse.csr_array(whole)] * one.count
        return scipy.sparse.csr_array(scipy.sparse.block_diag(blocks))

    @cached_property
    def colour(self) -> Any:
        """The whitener's inverse: from standard normal numbers to noise."""
        return scipy.sparse.csr_array(scipy.sparse.linalg.inv(scipy.sparse.csc_array(self.whitener)))

    @property
    def _own_count(self) -> int:
        return sum(len(one.sensor.nuisances) for one in self._each)

    def _at(self, unknowns: Array) -> Iterator[tuple[SegmentReadings, tuple[Array, ...]]]:
        # Each sensor's readings, with their arguments.
        values = self._nominal.copy()
        values[self._places], own = np.split(unknowns, [len(self._places)])
        for one in self._each:
            parameters, starts = np.split(values, [len(one.model.parameters)])
            nuisances, own = np.split(own, [len(one.sensor.nuisances)])
            yield one, (starts.reshape(one.count, -1), self._inputs, self._times, parameters, nuisances)
