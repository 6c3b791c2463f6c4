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
    """

    period: ca.Function
    last: ca.Function
    rows: tuple[int, ...]


@lru_cache(maxsize=8)
def filter_functions(sensors: tuple[Sensor, ...], system: System, noise: ProcessNoise) -> FilterFunctions:
    """The filter of what sensors read of a system under process noise, each of them in every period."""
    own = [len(sensor.nuisances) for sensor in sensors]
    states, width = len(system.states), len(system.parameters) + len(system.states) + sum(own)
    slopes, covariance = ca.SX.sym("D", states, width), ca.SX.sym("P", states, states)
    given = [
        ca.SX.sym("state", states),
        ca.SX.sym("inputs", len(system.inputs)),
        ca.SX.sym("p", len(system.parameters)),
        ca.SX.sym("period"),
    ]
    reads = ca.SX.sym("reads", len(sensors))
    arguments = [slopes, covariance, *given, reads]
    nominal = ca.SX(ca.DM(system.nominal))
    effect, errors = spread(noise, system)(given[0], given[1], nominal, given[3])
    begun = _Belief(
        ca.vertcat(slopes, ca.SX(noise.size, width)), ca.diagcat(_symmetric(covariance), errors), states
    )
    rows = [_reading(sensor, system, noise, given) for sensor in sensors]
    counts = tuple(row.slopes.shape[0] for row in rows)
    placed = [row.among(width, sum(own[:place])) for place, row in enumerate(rows)]
    found = [row.scaled(reads[place]) for place, row in enumerate(placed)]
    after, innovations = begun.read(found)
    step = carrier(system)(ca.horzcat(ca.SX(states, len(system.parameters)), ca.SX.eye(states)), *given)
    following = after.moved(ca.sparsify(step), effect, len(system.parameters))
    ends = [
        row.without_errors(noise.size).scaled(1.0 if sensor.when == "at samples" else 0.0)
        for sensor, row in zip(sensors, placed, strict=True)
    ]
    _, last = _Belief(slopes, _symmetric(covariance), states).read(ends)
    period = [ca.densify(one) for one in (*following, innovations)]
    return FilterFunctions(
        ca.Function("filter", arguments, ca.cse(period)),
        ca.Function("last", arguments[:-1], ca.cse([ca.densify(last)])),
        counts,
    )


@dataclass(frozen=True)
class _Row:
    # Readings in units of their noise: slopes by (parameters, state, the sensor's own nuisances), (q, ...),
    # and by the period's errors, (q, m).
    slopes: Expression
    by_errors: Expression
    parameters: int
    states: int

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

    def moved(self, step: Expression, effect: Expression, parameters: int) -> tuple[Expression, Expression]:
        # After the period, whose step has slopes by (parameters, state).
        direct, onward = step[:, :parameters], ca.horzcat(step[:, parameters:], effect)
        rest = self.slopes.shape[1] - parameters
        added = ca.horzcat(direct, ca.SX(self.states, rest))
        return onward @ self.slopes + added, onward @ self.covariance @ onward.T


def _reading(sensor: Sensor, system: System, noise: ProcessNoise, given: Sequence[Expression]) -> _Row:
    # What a sensor reads in a period that begins so; the other moment of what it reads between is its end.
    state, inputs, parameters, period = given
    states, size = len(system.states), len(system.parameters)
    own = ca.DM([nuisance.nominal for nuisance in sensor.nuisances])
    here, function = ca.horzcat(ca.SX(states, size), ca.SX.eye(states)), moment_reading(sensor, system)
    rest = (parameters, own)
    if sensor.when == "between samples":
        effect, _ = spread(noise, system)(state, inputs, ca.SX(ca.DM(system.nominal)), period)
        both = ca.vertcat(stepper(system)(*given), state), ca.vertcat(inputs, inputs)
        carried = carrier(system)(here, *given)
        found = function(both[0], ca.vertcat(carried, here), both[1], *rest, period)
        later = function(both[0], ca.vertcat(here, ca.SX(states, size + states)), both[1], *rest, period)
        return _Row(found[4].T, later[4].T[:, size : size + states] @ effect, size, states)
    lasting = period if sensor.when == "in periods" else ca.SX(0)
    found = function(state, here, inputs, *rest, lasting)
    seen = ca.SX(found[0].shape[0], noise.size)
    if sensor.when == "in periods" and noise.signal:
        by_signal = reading_by_signal(sensor, system, noise.signal)(state, inputs, *rest, period)
        seen = found[2] @ by_signal.T / period
    return _Row(found[4].T, ca.sparsify(seen), size, states)


def _symmetric(matrix: Expression) -> Expression:
    # By its upper half, so that rounding cannot make it another.
    return ca.triu2symm(ca.triu(matrix))


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
        columns = np.array(_places(sensor, samples))
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


def _places(sensor: Sensor, samples: int) -> list[int]:
    # In which periods its readings are taken in, the last instant after all of them.
    instants = sensor.instants(samples)
    return instants[-1]


def _reads(sensors: Sequence[Sensor], samples: int) -> ca.DM:
    # Which sensors read in every period, (sensors, samples).
    found = np.zeros((len(sensors), samples + 1))
    for place, sensor in enumerate(sensors):
        found[place, _places(sensor, samples)] = 1.0
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
