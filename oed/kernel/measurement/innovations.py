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
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System, carrier, stepper
from oed.kernel.measurement.moment import moment_reading, reading_by_signal
from oed.kernel.measurement.process_noise import ProcessNoise, spread

if TYPE_CHECKING:
    from oed.kernel.measurement.sensor import Sensor


class Filter:
    """The filter of what sensors read in every period; functions of SX or MX, made when first used.

    The unknowns, n of them, are the parameters, the start states, the sensors' nuisances.

    Attributes:
        rows: how many numbers each sensor reads in a period.
        width: n.
        begin: D (states, n) and P (states, states) of a state that is known.
    """

    def __init__(self, sensors: tuple[Sensor, ...], system: System, noise: ProcessNoise) -> None:
        """Write the readings of a period."""
        self.sensors, self.system, self.noise = sensors, system, noise
        own = [len(sensor.nuisances) for sensor in sensors]
        self.states, self.size = len(system.states), len(system.parameters)
        self.width = self.size + self.states + sum(own)
        self._given = [
            ca.SX.sym("state", self.states),
            ca.SX.sym("inputs", len(system.inputs)),
            ca.SX.sym("p", self.size),
            ca.SX.sym("period"),
        ]
        start = np.zeros((self.states, self.width))
        start[:, self.size : self.size + self.states] = np.eye(self.states)
        self.begin = ca.DM(start), ca.DM.zeros(self.states, self.states)
        self._reads, self._own = ca.SX.sym("reads", len(sensors)), ca.SX.sym("nuisances", sum(own))
        nominal = [nuisance.nominal for sensor in sensors for nuisance in sensor.nuisances]
        self._nominal = ca.SX(ca.DM(nominal)) if nominal else ca.SX(0, 1)
        each = ca.vertsplit(self._own, np.cumsum([0, *own]).tolist())
        self._readings = [
            _reading(sensor, system, noise, self._given, part)
            for sensor, part in zip(sensors, each, strict=True)
        ]
        self._placed = [row.among(self.width, sum(own[:place])) for place, row in enumerate(self._readings)]
        self.rows = tuple(row.slopes.shape[0] for row in self._readings)

    @cached_property
    def period(self) -> ca.Function:
        """(D, P, state, inputs, parameters, period, which sensors read) -> both at the next sample, and
        e / sqrt(s) (rows, n) of all sensors' readings.
        """
        slopes, covariance = self._symbols(self.width)
        found = [row.scaled(self._reads[place]) for place, row in enumerate(self._placed)]
        period, rows = self._period(slopes, covariance, found)
        return self._function("filter", [slopes, covariance, *self._given, self._reads], [*period, rows])

    @cached_property
    def last(self) -> ca.Function:
        """(D, P, state, inputs, parameters, period, which sensors read) -> e / sqrt(s) (rows, n) at the last
        instant.
        """
        slopes, covariance = self._symbols(self.width)
        _, last = _Belief(slopes, covariance, self.states).read(self._at_end(self._placed))
        return self._function("last", [slopes, covariance, *self._given, self._reads], [last])

    @cached_property
    def tracking(self) -> ca.Function:
        """`period` about any path, with a column of what is 1 behind the unknowns: (D (states, n + 1), P,
        state, inputs, parameters, period, which sensors read, nuisances, readings (rows,), state of the path
        at the next sample) -> both at the next sample, innovations (rows, n + 1), then derivatives of the
        next column and of innovations by a column, (states, states), (rows, states).
        """
        slopes, covariance = self._symbols(self.width + 1)
        measured, beside = self._compared
        following = ca.SX.sym("following", self.states)
        found = [row.scaled(self._reads[place]) for place, row in enumerate(beside)]
        (moved, spreads), rows = self._period(self._with_columns(slopes), covariance, found)
        moved[:, self.width] += stepper(self.system)(*self._given) - following
        count = self.width + 1
        results = [moved[:, :count], spreads, rows[:, :count], moved[:, count:], rows[:, count:]]
        given = [slopes, covariance, *self._given, self._reads, self._own, measured, following]
        return ca.Function("tracking", given, ca.cse([ca.densify(one) for one in results]))

    @cached_property
    def ending(self) -> ca.Function:
        """`tracking` at the last instant, without a next sample: innovations, and their derivatives."""
        slopes, covariance = self._symbols(self.width + 1)
        measured, beside = self._compared
        belief = _Belief(self._with_columns(slopes), covariance, self.states)
        _, last = belief.read(self._at_end(beside))
        results = [last[:, : self.width + 1], last[:, self.width + 1 :]]
        given = [slopes, covariance, *self._given, self._reads, self._own, measured]
        return ca.Function("ending", given, ca.cse([ca.densify(one) for one in results]))

    def reads(self, samples: int) -> Array:
        """Which sensors read in every period of a run and at its end, (sensors, samples + 1)."""
        found = np.zeros((len(self.sensors), samples + 1))
        for place, sensor in enumerate(self.sensors):
            found[place, taken_in(sensor, samples)] = 1.0
        return found

    def _symbols(self, width: int) -> tuple[Expression, Expression]:
        slopes = ca.SX.sym("D", self.states, width)
        return slopes, ca.SX.sym("P", self.states, self.states)

    def _function(self, name: str, arguments: list[Expression], results: list[Expression]) -> ca.Function:
        # At the nuisances' nominal values; a covariance is taken by its upper half, lest rounding bend it.
        covariance = arguments[1]
        whole = ca.triu2symm(ca.triu(covariance))
        fixed = [ca.substitute(one, self._own, self._nominal) for one in results]
        dense = [ca.densify(ca.substitute(one, covariance, whole)) for one in fixed]
        return ca.Function(name, arguments, ca.cse(dense))

    def _period(
        self, slopes: Expression, covariance: Expression, found: Sequence[_Placed]
    ) -> tuple[list[Expression], Expression]:
        system, given = self.system, self._given
        effect, errors = spread(self.noise, system)(
            given[0], given[1], ca.SX(ca.DM(system.nominal)), given[3]
        )
        none = ca.SX(self.noise.size, slopes.shape[1])
        begun = _Belief(ca.vertcat(slopes, none), ca.diagcat(covariance, errors), self.states)
        read, rows = begun.read(found)
        here = ca.horzcat(ca.SX(self.states, self.size), ca.SX.eye(self.states))
        step = ca.sparsify(carrier(system)(here, *given))
        return list(_moved(read, step, effect, self.size)), rows

    def _at_end(self, rows: Sequence[_Placed]) -> list[_Placed]:
        # What is read at the last instant.
        return [
            row.without_errors(self.noise.size).scaled(self._reads[place]) for place, row in enumerate(rows)
        ]

    @cached_property
    def _compared(self) -> tuple[Expression, list[_Placed]]:
        # Symbols for what was read, and all readings with what they are off as a column more.
        edges = np.cumsum([0, *self.rows]).tolist()
        measured = ca.SX.sym("measured", edges[-1])
        each = zip(self._readings, self._placed, ca.vertsplit(measured, edges), strict=True)
        return measured, [placed.beside(-row.misfit(own), self.states) for row, placed, own in each]

    def _with_columns(self, slopes: Expression) -> Expression:
        # And columns that show what becomes of any.
        return ca.horzcat(slopes, ca.SX.eye(self.states))


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


@lru_cache(maxsize=8)
def filter_of(sensors: tuple[Sensor, ...], system: System, noise: ProcessNoise) -> Filter:
    """The filter, made once for all that ask for it.

    Args:
        sensors: that read.
        system: that is driven.
        noise: of its process.
    """
    return Filter(sensors, system, noise)


def innovations(sensors: Sequence[Sensor], drive: Drive, noise: ProcessNoise) -> Expression:
    """Sensitivities (M, columns) of all innovations in units of their deviations, by (parameters, start
    states run by run, nuisances): rows as `joint_readings` has them.

    Args:
        sensors: that read.
        drive: what is driven.
        noise: of its process.
    """
    used = filter_of(tuple(sensors), drive.system, noise)
    start, samples = slice(used.size, used.size + used.states), drive.samples
    tables = [_of_run(used, drive, run) for run in range(drive.runs)]
    blocks = []
    for place, sensor in enumerate(sensors):
        first = sum(used.rows[:place])
        own = np.arange(first, first + used.rows[place])
        columns = np.array(taken_in(sensor, samples))
        chosen = (columns[:, None] * sum(used.rows) + own).ravel().tolist()
        blocks.append([table[chosen, :] for table in tables])
    rows = []
    for each in blocks:
        # Every run has a start of its own.
        starts, whole = ca.diagcat(*(one[:, start] for one in each)), ca.vertcat(*each)
        rows.append(ca.horzcat(whole[:, : start.start], starts, whole[:, start.stop :]))
    return ca.vertcat(*rows)


def taken_in(sensor: Sensor, samples: int) -> list[int]:
    """In which periods of a run its readings are taken in, the last instant after all of them."""
    return sensor.instants(samples)[-1]


def _of_run(used: Filter, drive: Drive, run: int) -> Expression:
    # All innovations of a run, every sensor in every period and at the last instant, (rows, n).
    samples, (begin, none) = drive.samples, used.begin
    path = drive.states[[run * (samples + 1) + place for place in range(samples + 1)], :].T
    inputs = drive.inputs[run * samples : (run + 1) * samples, :].T
    given = drive.parameters, drive.period
    along = used.period.mapaccum("along", samples, 2)
    reads = ca.DM(used.reads(samples))
    slopes, covariance, rows = along(begin, none, path[:, :samples], inputs, *given, reads[:, :samples])
    end = slopes[:, -used.width :], covariance[:, -used.states :]
    last = used.last(*end, path[:, -1], inputs[:, -1], *given, reads[:, samples])
    # Those of all periods stand side by side.
    return ca.vertcat(*ca.horzsplit(rows, used.width), last)
