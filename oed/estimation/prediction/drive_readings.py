"""What all sensors read of a designed drive, whose runs are segments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import scipy

from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.prediction.segments import Driven, SegmentReadings
from oed.estimation.prediction.walk import Walk
from oed.estimation.setup.unknowns import Unknowns
from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.readings import whole_whitening
from oed.kernel.measurement.sensor import Sensor, process_noise_of
from oed.kernel.parts import root_weights


@dataclass(frozen=True)
class DriveReadings:
    """Readings of a drive: given sensor by sensor, run by run and time by time; computed run by run.

    A reading that counts w times in the trajectory is the mean of w of them, and none where w is 0.

    Attributes:
        each: what every sensor reads of the runs.
        trajectory: the drive.
        unknowns: with the runs' starts among them, unless these are known.
    """

    each: tuple[SegmentReadings, ...]
    trajectory: Trajectory
    unknowns: Unknowns

    @classmethod
    def of(cls, sensors: Sequence[Sensor], trajectory: Trajectory, unknowns: Unknowns) -> DriveReadings:
        """What `sensors` read of a drive."""
        runs, periods = trajectory.runs, trajectory.samples // trajectory.runs
        each = tuple(SegmentReadings(unknowns.system, one, runs, periods) for one in sensors)
        return cls(each, trajectory, unknowns)

    def first_starts(self, values: Array) -> Array:
        """No unknowns (runs, 0) of each run alone."""
        return np.zeros((self.trajectory.runs, 0))

    def rates(self, values: Array, starts: Array, readings: Array) -> tuple[Array, Array]:
        """Speeds and yaw rates (runs, M) of 0: noise that is specified depends on the plan alone."""
        still = np.zeros(readings.shape[:2])
        return still, still

    def __call__(self, values: Array, starts: Array) -> Array:
        """The readings (runs, M, 1), SI."""
        return self.derivatives(values, starts)[0]

    def derivatives(self, values: Array, starts: Array) -> tuple[Array, Array, Array]:
        """The readings (runs, M, 1), SI, their derivatives by the unknowns (runs, M, 1, q), and by none of a
        run alone.
        """
        found, slopes = self.side_by_side(values)
        return found, slopes, np.zeros((*slopes.shape[:-1], 0))

    def side_by_side(self, values: Array) -> tuple[Array, Array]:
        """The readings (..., runs, M, 1), SI, and their derivatives by the unknowns (..., runs, M, 1, q), at
        unknowns (..., q): of one drive, or of many (R, q) at once.
        """
        (parameters, nuisances, _), starts = self.unknowns.parts(values), self.unknowns.begins(values)
        if not starts.shape[-2]:
            own = self.trajectory.starts
            starts = np.broadcast_to(own, (*values.shape[:-1], *own.shape))
        readings, slopes = list[Array](), list[Array]()
        leading, last = parameters.shape[-1] + starts.shape[-1], nuisances.shape[-1]
        # The nuisances before and after a sensor's own do not concern it.
        before, after = 0, last
        for one in self.each:
            after -= len(one.sensor.nuisances)
            own = nuisances[..., before : last - after]
            found, by_own = one.derivatives(Driven(starts, *self._driven, parameters, own))
            rows = by_own.reshape(*found.shape[:-2], found.shape[-2] * found.shape[-1], 1, by_own.shape[-1])
            readings.append(found.reshape(rows.shape[:-1]))
            slopes.append(_widened(rows, leading, before, after))
            before += len(one.sensor.nuisances)
        return _together(readings, -2), self.unknowns.slopes(_together(slopes, -3))

    @cached_property
    def _driven(self) -> tuple[Array, Array]:
        # Inputs of every run (runs, n, inputs), and how long each is held [s], (runs, n).
        drive = SegmentLayout.of_drive(self.trajectory, np.zeros((self.trajectory.runs, 0)))
        return drive.inputs(np.zeros(0)), drive.steps

    @cached_property
    def nominal(self) -> tuple[Array, ...]:
        """The readings of each sensor, (runs, times, q), where nothing is off its nominal value, SI."""
        return tuple(one(driven) for one, driven in self._at_nominal)

    @property
    def _at_nominal(self) -> Iterator[tuple[SegmentReadings, Driven]]:
        for one in self.each:
            nuisances = np.array([entry.nominal for entry in one.sensor.nuisances])
            nominal = np.array(one.model.nominal)
            yield one, Driven(self.trajectory.starts, *self._driven, nominal, nuisances)

    @cached_property
    def wrapping(self) -> Bools:
        """Which of a run's readings jump by full turns as they are predicted, (M, 1)."""
        each = [
            np.tile(np.isin(np.arange(found.shape[-1]), one.sensor.wrapping), found.shape[1])
            for one, found in zip(self.each, self.nominal, strict=True)
        ]
        return np.concatenate(each)[:, None]

    @cached_property
    def order(self) -> Places:
        """Where each reading run by run stands among those sensor by sensor, (M of all runs,)."""
        places, first = list[Places](), 0
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
        """Readings (M of all runs,) whose angles are unwrapped, and begin near the nominal; turns between
        samples are all of them near the nominal ones.
        """
        found, first = readings.copy(), 0
        for one, nominal in zip(self.each, self.nominal, strict=True):
            own = found[first : first + nominal.size].reshape(nominal.shape)
            apart = one.sensor.when == "between samples"
            for run, place in product(range(len(own)), one.sensor.angles):
                angles = own[run, :, place] if apart else np.unwrap(own[run, :, place])
                ahead = (nominal[run, :, place] - angles) / (2 * np.pi)
                own[run, :, place] = angles + 2 * np.pi * np.rint(ahead if apart else ahead[0])
            first += nominal.size
        return found

    @cached_property
    def _whitener(self) -> Any:
        # Block diagonal A with A R A' = 1, sensor by sensor, at the nominal values.
        blocks = list[Any]()
        for one, driven in self._at_nominal:
            each = one.whitening(driven)
            whole = whole_whitening(one.sensor, each.shape[0] // one.count)
            blocks += [each] if whole is None else [scipy.sparse.csr_array(whole)] * one.count
        whole = scipy.sparse.csr_array(scipy.sparse.block_diag(blocks))
        return whole if self._roots is None else scipy.sparse.csr_array(self._roots[:, None] * whole)

    @cached_property
    def _roots(self) -> Array | None:
        # Of weights, sensor by sensor.
        sensors = [one.sensor for one in self.each]
        return root_weights(sensors, self.unknowns.system, self.trajectory)

    @cached_property
    def whitener(self) -> Any:
        """A with A S A' = 1 for the specified covariance S of the readings, run by run; under process noise
        R + L Q L', at the nominal values.
        """
        if self.walk is None:
            return self._whitener[self.order][:, self.order]
        spread = (self._whitener @ self.walk.effect)[self.order]
        lower = np.linalg.cholesky(np.eye(len(spread)) + spread @ spread.T)
        own = self._whitener[self.order][:, self.order].toarray()
        return scipy.linalg.solve_triangular(lower, own, lower=True)

    @cached_property
    def walk(self) -> Walk | None:
        """What process noise does to the readings; None without any."""
        sensors = tuple(one.sensor for one in self.each)
        noise = process_noise_of(sensors)
        return None if noise is None else Walk(sensors, self.unknowns.system, self.trajectory, noise)

    def simulated(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Readings at the nominal values, sensor by sensor (M of all runs,), SI, and to first order their
        noise in units of its deviation, run by run. A process that errs is driven as it errs.
        """
        exact = np.concatenate([found.ravel() for found in self.nominal])
        white = rng.standard_normal(len(exact))
        if self.walk is None:
            return exact + self.coloured(white), white[self.order]
        units = [rng.standard_normal(root.shape[:2]) for root in self.walk.roots]
        errors = [
            np.einsum("kij,kj->ik", root, own) for root, own in zip(self.walk.roots, units, strict=True)
        ]
        noise = self.coloured(white)
        near = noise + self.walk.effect @ np.concatenate([own.ravel() for own in units])
        return self.walk.readings(errors) + noise, self.whitener @ near[self.order]

    def coloured(self, white: Array) -> Array:
        """Noise of standard normal numbers (M of all runs,), sensor by sensor; 0 for what is not read."""
        return self._colouring.of(white if self._roots is None else white * (self._roots > 0))

    @cached_property
    def _colouring(self) -> _Solve:
        whitener, roots = self._whitener, self._roots
        # Rows that are 0 have no inverse.
        unread = None if roots is None else scipy.sparse.diags_array((roots == 0).astype(float))
        return _Solve(whitener if unread is None else whitener + unread)


class _Solve:
    # A sparse matrix's factors, which another process makes anew: its inverse may be full.
    def __init__(self, matrix: Any) -> None:
        self._matrix = matrix
        self._factors = scipy.sparse.linalg.splu(scipy.sparse.csc_array(matrix))

    def __reduce__(self) -> tuple[type[_Solve], tuple[Any]]:
        return _Solve, (self._matrix,)

    def of(self, right: Array) -> Array:
        return np.asarray(self._factors.solve(right))


def _widened(rows: Array, leading: int, before: int, after: int) -> Array:
    # With columns of 0 for so many nuisances of other sensors before and after those behind the leading ones.
    if not before and not after:
        return rows
    wide = np.zeros((*rows.shape[:-1], rows.shape[-1] + before + after))
    wide[..., :leading] = rows[..., :leading]
    wide[..., leading + before : wide.shape[-1] - after] = rows[..., leading:]
    return wide


def _together(parts: list[Array], axis: int) -> Array:
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=axis)
