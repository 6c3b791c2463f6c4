"""Least squares of a drive whose process errs: unknowns and the path that was really driven, together.

About a path, readings and steps are linear: a Kalman filter gives the unknowns, and going back the path that
is most likely with them. About that it begins anew: an iterated Kalman smoother, which is Gauss-Newton on
unknowns and errors of all periods [Bell: The iterated Kalman smoother as a Gauss-Newton method, SIAM J.
Optimization 4, 1994]. Many experiments are estimated from at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from oed.estimation.setup.unknowns import Knowledge, Unknowns
from oed.foundation.arrays import Array, Bools
from oed.kernel.dynamics.direct_call import DirectCall
from oed.kernel.dynamics.system import stepper
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.filter import Filter, filter_of, reads_of, taken_in
from oed.kernel.measurement.process_noise import ProcessNoise
from oed.kernel.measurement.sensor import Sensor

CLOSE = 1e-9
"""Change of the unknowns, in units of their size, at which the search has arrived."""
MOST = 30
"""Paths at most that a search goes by."""


class Smoothed(NamedTuple):
    """What a search ends with, of R experiments.

    Attributes:
        values: of the unknowns, (R, q).
        innovations: in units of their deviations, run by run and time by time, (R, M).
        arrived: whether the values had stopped changing, (R,).
    """

    values: Array
    innovations: Array
    arrived: Bools


class Passed(NamedTuple):
    """A filter's way along one run of R experiments, N periods; states are all those of the filter.

    Attributes:
        slopes: D of what is off the path, by (unknowns, 1), before the readings, (R, N + 1, states, n + 1).
        spreads: P alike, (R, N + 1, states, states).
        rows: innovations in units of their deviations, (R, N + 1, rows, n + 1).
        onward: derivatives of the next column by a column, (R, N, states, states).
        seen: of innovations by a column, (R, N + 1, rows, states).
    """

    slopes: Array
    spreads: Array
    rows: Array
    onward: Array
    seen: Array


@dataclass(frozen=True)
class Smoother:
    """The search for a drive.

    Attributes:
        sensors: that read.
        trajectory: the drive.
        noise: of its process.
        unknowns: what to estimate.
    """

    sensors: tuple[Sensor, ...]
    trajectory: Trajectory
    noise: ProcessNoise
    unknowns: Unknowns

    def solved(self, measured: Array, known: Knowledge, before: Array) -> Smoothed:
        """The most likely values.

        Args:
            measured: readings (R, M), sensor by sensor, run by run and time by time, SI.
            known: of the unknowns from before.
            before: what these are known to be, (R, q).
        """
        values, tables = before.copy(), self._tables(measured)
        paths = [np.array(self._path(run, values)) for run in range(self.trajectory.runs)]
        arrived = np.zeros(len(values), dtype=bool)
        for _ in range(MOST):
            passed = [
                self._passed(run, values, path, table)
                for run, (path, table) in enumerate(zip(paths, tables, strict=True))
            ]
            step = self._step(passed, values, known, before)
            values = values + step
            paths = [
                path + smoothed(one, self._of_run(run, step))[:, :, : path.shape[2]]
                for run, (path, one) in enumerate(zip(paths, passed, strict=True))
            ]
            arrived = np.all(np.abs(step) <= CLOSE * self.unknowns.scale, axis=1)
            if arrived.all() or not np.isfinite(values).all():
                break
        each = [
            np.einsum("rkin,rn->rki", one.rows, self._of_run(run, step)) for run, one in enumerate(passed)
        ]
        return Smoothed(values, np.concatenate([self._taken(one) for one in each], axis=1), arrived)

    def _step(self, passed: Sequence[Passed], values: Array, known: Knowledge, before: Array) -> Array:
        # Gauss-Newton by all innovations, and what is known.
        total = np.zeros((len(values), values.shape[1] + 1, values.shape[1] + 1))
        for run, one in enumerate(passed):
            square = np.einsum("rkia,rkib->rab", one.rows, one.rows)
            places = [*self._places(run), values.shape[1]]
            own = [*self._columns, one.rows.shape[-1] - 1]
            total[:, np.array(places)[:, None], places] += square[:, np.array(own)[:, None], own]
        matrix = total[:, :-1, :-1] + known.information
        right = -total[:, :-1, -1] + (before - values) @ known.information
        return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])

    @cached_property
    def _filter(self) -> Filter:
        return filter_of(self.sensors, self.unknowns.system, self.noise)

    @property
    def _samples(self) -> int:
        return self.trajectory.samples // self.trajectory.runs

    @cached_property
    def _columns(self) -> list[int]:
        # Of a filter's columns those of unknowns: parameters, a run's start, nuisances.
        system = self.unknowns.system
        names, states = [one.name for one in system.parameters], len(system.states)
        size = len(names)
        own = [names.index(name) for name in self.unknowns.parameters]
        starts = list(range(size, size + states)) if self.unknowns.starts else []
        return [*own, *starts, *range(size + states, self._filter.width)]

    def _places(self, run: int) -> list[int]:
        # Where these stand among all unknowns.
        labels, runs = list(self.unknowns.names), self.trajectory.runs
        starts = [one.name for one in self.unknowns.starts]
        each = len(starts) // runs
        own = starts[run * each : (run + 1) * each]
        constants = list(self.unknowns.constants)
        return [labels.index(name) for name in (*self.unknowns.parameters, *own, *constants)]

    def _of_run(self, run: int, step: Array) -> Array:
        # A step of all unknowns in a filter's columns, with a 1 behind them.
        found = np.zeros((len(step), self._filter.width + 1))
        found[:, self._columns] = step[:, self._places(run)]
        found[:, -1] = 1.0
        return found

    def _given(self, run: int, values: Array) -> tuple[Array, Array, Array]:
        # Parameters, the run's start, nuisances, (R, ...) each.
        system, places = self.unknowns.system, self._places(run)
        parameters = np.tile(np.array(system.nominal, dtype=float), (len(values), 1))
        names = [one.name for one in system.parameters]
        count = len(self.unknowns.parameters)
        parameters[:, [names.index(name) for name in self.unknowns.parameters]] = values[:, places[:count]]
        start = np.tile(self.trajectory.starts[run], (len(values), 1))
        each = len(self.unknowns.starts) // self.trajectory.runs
        if each:
            start = values[:, places[count : count + each]]
        return parameters, start, values[:, places[count + each :]]

    def _path(self, run: int, values: Array) -> Array:
        # As the inputs say, (R, N + 1, states).
        parameters, start, _ = self._given(run, values)
        system, drive = self.unknowns.system, self.trajectory.each[run]
        found = np.empty((len(values), self._samples + 1, len(system.states)))
        found[:, 0] = start
        step = stepper(system).map(len(values))
        for place, inputs in enumerate(drive.inputs):
            held = np.tile(inputs[:, None], len(values))
            found[:, place + 1] = np.array(step(found[:, place].T, held, parameters.T, drive.period)).T
        return found

    def _tables(self, measured: Array) -> list[Array]:
        # Readings by run, period and row, (R, N + 1, rows); 0 where nothing is read.
        rows, runs, first, before = sum(self._filter.rows), self.trajectory.runs, 0, 0
        found = [np.zeros((len(measured), self._samples + 1, rows)) for _ in range(runs)]
        for sensor, count in zip(self.sensors, self._filter.rows, strict=True):
            places = taken_in(sensor, self._samples)
            each = measured[:, first : first + runs * len(places) * count]
            each = each.reshape(len(measured), runs, len(places), count)
            for run in range(runs):
                found[run][:, places, before : before + count] = each[:, run]
            first, before = first + runs * len(places) * count, before + count
        return found

    def _taken(self, table: Array) -> Array:
        # The rows (R, N + 1, rows) of one run that are readings, sensor by sensor, (R, M of the run).
        found, before = [], 0
        for sensor, count in zip(self.sensors, self._filter.rows, strict=True):
            own = table[:, taken_in(sensor, self._samples), before : before + count]
            found.append(own.reshape(len(table), -1))
            before += count
        return np.concatenate(found, axis=1)

    def _passed(self, run: int, values: Array, path: Array, table: Array) -> Passed:
        parameters, _, own = self._given(run, values)
        count = len(values)
        states, width = self._filter.states, self._filter.width + 1
        inputs = np.tile(self.trajectory.each[run].inputs, (count, 1))
        found = self._together(count)(path, inputs, parameters, own, table)
        rows = table.shape[2]
        shapes = (states, width), (states, states), (rows, width), (states, states), (rows, states)
        slopes, spreads, innovations, onward, seen = (
            np.ascontiguousarray(one.reshape(-1, high).T).reshape(high, count, -1, wide).transpose(1, 2, 0, 3)
            for one, (high, wide) in zip(found, shapes, strict=True)
        )
        return Passed(slopes, spreads, innovations, onward, seen)

    def _together(self, count: int) -> DirectCall:
        # Of so many drives side by side.
        if count not in self._calls:
            self._calls[count] = DirectCall(self._along.map(count))
        return self._calls[count]

    @cached_property
    def _calls(self) -> dict[int, DirectCall]:
        # Those that were asked for.
        return {}

    @cached_property
    def _along(self) -> ca.Function:
        # A whole run, along a path.
        system, samples, used = self.unknowns.system, self._samples, self._filter
        states, width = len(system.states), used.width + 1
        path, inputs = ca.MX.sym("path", states, samples + 1), ca.MX.sym("u", len(system.inputs), samples)
        parameters = ca.MX.sym("p", len(system.parameters))
        own = ca.MX.sym("nuisances", used.width - used.size - states)
        table = ca.MX.sym("readings", sum(used.rows), samples + 1)
        # The path is off itself by nothing where it begins.
        begin, none = ca.horzcat(used.begin[0], ca.DM.zeros(used.states)), used.begin[1]
        # Behind the last instant nothing follows.
        along = used.tracking.mapaccum("along", samples + 1, 2)
        held, following = ca.horzcat(inputs, inputs[:, -1]), ca.horzcat(path[:, 1:], path[:, -1])
        moments = used.remembering(path), held, parameters, self.trajectory.period
        reads = ca.DM(reads_of(used.sensors, samples))
        slopes, spreads, rows, onward, seen = along(begin, none, *moments, reads, own, table, following)
        results = [
            ca.horzcat(begin, slopes[:, :-width]),
            ca.horzcat(none, spreads[:, : -used.states]),
            rows,
            onward[:, : -used.states],
            seen,
        ]
        return ca.Function("run", [path, inputs, parameters, own, table], list(map(ca.densify, results)))


def smoothed(passed: Passed, step: Array) -> Array:
    """How far the path is off the one that it was linearised about, (R, N + 1, states): predictions of the
    filter, and what readings from then on say, going back through them.

    Args:
        passed: the filter's way.
        step: of the unknowns, with a 1 behind them, (R, n + 1).
    """
    ahead = np.einsum("rkin,rn->rki", passed.slopes, step)
    left = np.einsum("rkin,rn->rki", passed.rows, step)
    pull = -np.einsum("rkis,rki->rks", passed.seen, left)
    later, found = pull[:, -1], np.empty_like(ahead)
    found[:, -1] = ahead[:, -1] + np.einsum("rst,rt->rs", passed.spreads[:, -1], later)
    for place in range(passed.onward.shape[1] - 1, -1, -1):
        later = pull[:, place] + np.einsum("rst,rs->rt", passed.onward[:, place], later)
        found[:, place] = ahead[:, place] + np.einsum("rst,rt->rs", passed.spreads[:, place], later)
    return np.asarray(found)
