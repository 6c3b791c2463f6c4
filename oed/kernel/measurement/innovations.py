"""Readings under process noise: a Kalman filter that carries sensitivities along with its covariance.

With the covariance P of the state and the sensitivities D of its prediction by all unknowns, a reading of
unit noise with slope h by the state and its errors has the innovation's variance s = 1 + h P h' and
sensitivity e = h D + h_p; the information is the sum of e'e / s, exactly that of generalised least squares
on all readings together [Kailath, Sayed, Hassibi: Linear estimation, 2000, chapter 9]. Readings of one period
are taken in one after the other, with the period's errors among the states: what a sensor reads of the period
itself sees them too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System, carrier, stepper
from oed.kernel.measurement.moment import moment_reading, reading_by_signal
from oed.kernel.measurement.process_noise import ProcessNoise, spread

if TYPE_CHECKING:
    from oed.kernel.measurement.sensor import Sensor


@dataclass(frozen=True)
class FilterFunctions:
    """One period of the filter, and the readings at a run's last instant; functions of SX or MX.

    The unknowns, n of them, are the parameters, the start states, the sensors' nuisances.

    Attributes:
        period: (D (states, n), P (states, states), state, inputs, parameters, period, which sensors read) ->
            both at the next sample, and e / sqrt(s) (rows, n) of all sensors' readings.
        last: the same of what is read at the last instant: (rows, n).
        rows: how many each sensor has.
        tracking: `period` about any path, beside the unknowns with a column of what is 1: (D (states,
            n + 1), P, state, inputs, parameters, period, which sensors read, nuisances, readings (rows,),
            state of the path at the next sample) -> both at the next sample, innovations (rows, n + 1), then
            derivatives of the next column and of innovations by a column, (states, states), (rows, states).
        ending: the same at the last instant, without a next sample: innovations, their derivatives.
    """

    period: ca.Function
    last: ca.Function
    rows: tuple[int, ...]
    tracking: ca.Function
    ending: ca.Function


@lru_cache(maxsize=8)
def filter_functions(sensors: tuple[Sensor, ...], system: System, noise: ProcessNoise) -> FilterFunctions:
    """The filter of what sensors read of a system under process noise, each of them in every period.

    Args:
        sensors: that read.
        system: that is driven.
        noise: of its process.
    """
    return _Filter(sensors, system, noise).functions


class _Filter:
    # The expressions of a period.
    def __init__(self, sensors: tuple[Sensor, ...], system: System, noise: ProcessNoise) -> None:
        self.sensors, self.system, self.noise = sensors, system, noise
        own = [len(sensor.nuisances) for sensor in sensors]
        self.states, self.size = len(system.states), len(system.parameters)
        self.width = self.size + self.states + sum(own)
        self.given = [
            ca.SX.sym("state", self.states),
            ca.SX.sym("inputs", len(system.inputs)),
            ca.SX.sym("p", self.size),
            ca.SX.sym("period"),
        ]
        self.reads, self.own = ca.SX.sym("reads", len(sensors)), ca.SX.sym("nuisances", sum(own))
        nominal = [nuisance.nominal for sensor in sensors for nuisance in sensor.nuisances]
        self.nominal = ca.SX(ca.DM(nominal)) if nominal else ca.SX(0, 1)
        each = ca.vertsplit(self.own, np.cumsum([0, *own]).tolist())
        self.rows = [
            _reading(sensor, system, noise, self.given, part)
            for sensor, part in zip(sensors, each, strict=True)
        ]
        self.placed = [row.among(self.width, sum(own[:place])) for place, row in enumerate(self.rows)]

    @property
    def functions(self) -> FilterFunctions:
        slopes, covariance = self._symbols(self.width)
        arguments = [slopes, covariance, *self.given, self.reads]
        found = [row.scaled(self.reads[place]) for place, row in enumerate(self.placed)]
        period, rows = self._period(slopes, covariance, found)
        _, last = _Belief(slopes, covariance, self.states).read(self._ends)
        return FilterFunctions(
            self._function("filter", arguments, [*period, rows]),
            self._function("last", arguments[:-1], [last]),
            tuple(row.slopes.shape[0] for row in self.rows),
            *self._tracking(),
        )

    def _symbols(self, width: int) -> tuple[Expression, Expression]:
        slopes = ca.SX.sym("D", self.states, width)
        return slopes, ca.SX.sym("P", self.states, self.states)

    def _function(self, name: str, arguments: list[Expression], results: list[Expression]) -> ca.Function:
        # At the nuisances' nominal values; a covariance is taken by its upper half, lest rounding bend it.
        covariance = arguments[1]
        whole = ca.triu2symm(ca.triu(covariance))
        fixed = [ca.substitute(one, self.own, self.nominal) for one in results]
        dense = [ca.densify(ca.substitute(one, covariance, whole)) for one in fixed]
        return ca.Function(name, arguments, ca.cse(dense))

    def _period(
        self, slopes: Expression, covariance: Expression, found: Sequence[_Placed]
    ) -> tuple[list[Expression], Expression]:
        system, given = self.system, self.given
        effect, errors = spread(self.noise, system)(
            given[0], given[1], ca.SX(ca.DM(system.nominal)), given[3]
        )
        none = ca.SX(self.noise.size, slopes.shape[1])
        begun = _Belief(ca.vertcat(slopes, none), ca.diagcat(covariance, errors), self.states)
        read, rows = begun.read(found)
        here = ca.horzcat(ca.SX(self.states, self.size), ca.SX.eye(self.states))
        step = ca.sparsify(carrier(system)(here, *given))
        return list(_moved(read, step, effect, self.size)), rows

    @property
    def _ends(self) -> list[_Placed]:
        # What is read at the last instant.
        return [
            row.without_errors(self.noise.size).scaled(1.0 if sensor.when == "at samples" else 0.0)
            for sensor, row in zip(self.sensors, self.placed, strict=True)
        ]

    def _tracking(self) -> tuple[ca.Function, ca.Function]:
        slopes, covariance = self._symbols(self.width + 1)
        counts = np.cumsum([0, *(row.slopes.shape[0] for row in self.rows)])
        measured = ca.SX.sym("measured", int(counts[-1]))
        following = ca.SX.sym("following", self.states)
        both = ca.horzcat(slopes, ca.SX.eye(self.states))
        each = ca.vertsplit(measured, counts.tolist())
        left = [row.misfit(part) for row, part in zip(self.rows, each, strict=True)]
        here = [row.beside(-one, self.states) for row, one in zip(self.placed, left, strict=True)]
        (moved, spreads), rows = self._period(
            both, covariance, [row.scaled(self.reads[place]) for place, row in enumerate(here)]
        )
        moved[:, self.width] += stepper(self.system)(*self.given) - following
        ends = [row.beside(-one, self.states) for row, one in zip(self._ends, left, strict=True)]
        now = [1.0 if sensor.when == "at samples" else 0.0 for sensor in self.sensors]
        scaled = [row.scaled(read) for row, read in zip(ends, now, strict=True)]
        _, last = _Belief(both, covariance, self.states).read(scaled)
        count = self.width + 1
        given = [slopes, covariance, *self.given]
        results = [moved[:, :count], spreads, rows[:, :count], moved[:, count:], rows[:, count:]]
        tracking, ending = (
            ca.Function(name, arguments, ca.cse([ca.densify(one) for one in found]))
            for name, arguments, found in (
                ("tracking", [*given, self.reads, self.own, measured, following], results),
                ("ending", [*given, self.own, measured], [last[:, :count], last[:, count:]]),
            )
        )
        return tracking, ending


@dataclass(frozen=True)
class _Row:
    # Readings, and in units of their noise slopes by (parameters, state, the sensor's own nuisances),
    # (q, ...), and by the period's errors, (q, m).
    sensor: Sensor
    reading: Expression
    whitening: Expression
    slopes: Expression
    by_errors: Expression
    parameters: int
    states: int

    def misfit(self, measured: Expression) -> Expression:
        # In units of the noise; angles are known up to full turns.
        left = measured - self.reading
        for place in self.sensor.angles:
            left[place] = ca.atan2(ca.sin(left[place]), ca.cos(left[place]))
        return self.whitening @ left

    def among(self, width: int, before: int) -> _Placed:
        # With columns for all unknowns, those of other sensors' nuisances 0.
        leading = self.parameters + self.states
        known, own = self.slopes[:, : self.parameters], self.slopes[:, leading:]
        rest = width - leading - before - own.shape[1]
        count = self.slopes.shape[0]
        direct = ca.horzcat(known, ca.SX(count, self.states + before), own, ca.SX(count, rest))
        return _Placed(direct, ca.horzcat(self.slopes[:, self.parameters : leading], self.by_errors))


@dataclass(frozen=True)
class _Placed:
    # Slopes by all unknowns directly, (q, n), and by the state and the errors, (q, states + m).
    direct: Expression
    through: Expression

    def scaled(self, factor: Expression | float) -> _Placed:
        return _Placed(factor * self.direct, factor * self.through)

    def beside(self, one: Expression, others: int) -> _Placed:
        # With a column more, and columns of what the readings do not depend on directly.
        return _Placed(ca.horzcat(self.direct, one, ca.SX(one.shape[0], others)), self.through)

    def without_errors(self, size: int) -> _Placed:
        return _Placed(self.direct, self.through[:, : self.through.shape[1] - size])


@dataclass(frozen=True)
class _Belief:
    # Sensitivities of the prediction of (state, errors) by all unknowns, and its covariance.
    slopes: Expression
    covariance: Expression
    states: int

    def read(self, readings: Sequence[_Placed]) -> tuple[_Belief, Expression]:
        # After readings of unit noise, one number at a time; and their whitened innovations' sensitivities.
        slopes, covariance, found = self.slopes, self.covariance, []
        for one in readings:
            for row in range(one.direct.shape[0]):
                through = ca.sparsify(one.through[row, :])
                gained = covariance @ through.T
                root = ca.sqrt(1 + through @ gained)
                white = (through @ slopes + one.direct[row, :]) / root
                gain = gained / root
                slopes, covariance = slopes - gain @ white, covariance - gain @ gain.T
                found.append(white)
        return _Belief(slopes, covariance, self.states), ca.vertcat(*found)


def _moved(
    belief: _Belief, step: Expression, effect: Expression, parameters: int
) -> tuple[Expression, Expression]:
    # After the period, whose step has slopes by (parameters, state).
    direct, onward = step[:, :parameters], ca.horzcat(step[:, parameters:], effect)
    added = ca.horzcat(direct, ca.SX(belief.states, belief.slopes.shape[1] - parameters))
    return onward @ belief.slopes + added, onward @ belief.covariance @ onward.T


def _reading(
    sensor: Sensor, system: System, noise: ProcessNoise, given: Sequence[Expression], own: Expression
) -> _Row:
    # What a sensor reads in a period that begins so; the other moment of what it reads between is its end.
    state, inputs, parameters, period = given
    states, size = len(system.states), len(system.parameters)
    here, function = ca.horzcat(ca.SX(states, size), ca.SX.eye(states)), moment_reading(sensor, system)
    rest = (parameters, own)
    if sensor.when == "between samples":
        effect, _ = spread(noise, system)(state, inputs, ca.SX(ca.DM(system.nominal)), period)
        both = ca.vertcat(stepper(system)(*given), state), ca.vertcat(inputs, inputs)
        carried = carrier(system)(here, *given)
        found = function(both[0], ca.vertcat(carried, here), both[1], *rest, period)
        later = function(both[0], ca.vertcat(here, ca.SX(states, size + states)), both[1], *rest, period)
        seen = later[4].T[:, size : size + states] @ effect
        return _Row(sensor, found[0], found[2], found[4].T, seen, size, states)
    lasting = period if sensor.when == "in periods" else ca.SX(0)
    found = function(state, here, inputs, *rest, lasting)
    seen = ca.SX(found[0].shape[0], noise.size)
    if sensor.when == "in periods" and noise.signal:
        by_signal = reading_by_signal(sensor, system, noise.signal)(state, inputs, *rest, period)
        seen = ca.sparsify(found[2] @ by_signal.T / period)
    return _Row(sensor, found[0], found[2], found[4].T, seen, size, states)


def innovations(sensors: Sequence[Sensor], drive: Drive, noise: ProcessNoise) -> Expression:
    """Sensitivities (M, columns) of all innovations in units of their deviations, by (parameters, start
    states run by run, nuisances): rows as `joint_readings` has them.

    Args:
        sensors: that read.
        drive: what is driven.
        noise: of its process.
    """
    functions = filter_functions(tuple(sensors), drive.system, noise)
    size, states, samples = len(drive.system.parameters), len(drive.system.states), drive.samples
    reads = _reads(sensors, samples)
    tables = [_of_run(functions, sensors, drive, run, reads) for run in range(drive.runs)]
    blocks = []
    for place, sensor in enumerate(sensors):
        first = sum(functions.rows[:place])
        own = np.arange(first, first + functions.rows[place])
        columns = np.array(taken_in(sensor, samples))
        chosen = (columns[:, None] * sum(functions.rows) + own).ravel().tolist()
        blocks.append([table[chosen, :] for table in tables])
    rows = []
    for each in blocks:
        starts = ca.diagcat(*(one[:, size : size + states] for one in each))
        known, rest = (ca.vertcat(*(one[:, part] for one in each)) for part in _outer(size, states))
        rows.append(ca.horzcat(known, starts, rest))
    return ca.vertcat(*rows)


def _outer(size: int, states: int) -> tuple[slice, slice]:
    return slice(0, size), slice(size + states, None)


def taken_in(sensor: Sensor, samples: int) -> list[int]:
    """In which periods of a run its readings are taken in, the last instant after all of them."""
    instants = sensor.instants(samples)
    return instants[-1]


def _reads(sensors: Sequence[Sensor], samples: int) -> ca.DM:
    # Which sensors read in every period, (sensors, samples).
    found = np.zeros((len(sensors), samples + 1))
    for place, sensor in enumerate(sensors):
        found[place, taken_in(sensor, samples)] = 1.0
    return ca.DM(found[:, :samples])


def _of_run(
    functions: FilterFunctions, sensors: Sequence[Sensor], drive: Drive, run: int, reads: ca.DM
) -> Expression:
    # All innovations of a run, every sensor in every period and at the last instant, (rows, n).
    samples, system = drive.samples, drive.system
    states, size = len(system.states), len(system.parameters)
    width = functions.period.size2_in(0)
    own = [run * (samples + 1) + place for place in range(samples + 1)]
    path = drive.states[own, :].T
    inputs = drive.inputs[run * samples : (run + 1) * samples, :].T
    begin = ca.horzcat(ca.DM(states, size), ca.DM.eye(states), ca.DM(states, width - size - states))
    along = _along(functions.period, samples)
    slopes, covariance, rows = along(
        begin, ca.DM.zeros(states, states), path[:, :samples], inputs, drive.parameters, drive.period, reads
    )
    last = functions.last(
        slopes[:, -width:],
        covariance[:, -states:],
        path[:, -1],
        inputs[:, -1],
        drive.parameters,
        drive.period,
    )
    return ca.vertcat(_stacked(rows, samples), last)


def _along(period: ca.Function, samples: int) -> ca.Function:
    # Through all periods, D and P handed on, the parameters and the period's length common to all.
    return period.mapaccum("along", samples, 2)


def _stacked(rows: Expression, count: int) -> Expression:
    # Matrices side by side, below each other.
    return ca.vertcat(*ca.horzsplit(rows, rows.shape[1] // count))
