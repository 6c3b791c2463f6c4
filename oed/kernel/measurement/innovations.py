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

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System, carrier, stepper
from oed.kernel.measurement.filter_rows import Placed, memories_of, reads_of, row_of
from oed.kernel.measurement.filter_rows import taken_in as taken_in
from oed.kernel.measurement.measurement import Sensor
from oed.kernel.measurement.process_noise import ProcessNoise, spread
from oed.kernel.measurement.update import Update


class Filter:
    """The filter of what sensors read in every period; functions of SX or MX, made when first used.

    The unknowns, n of them, are the parameters, the start states, the sensors' nuisances. Of a reading across
    several samples the state that it begins at is a state as well, which lasts [Roumeliotis and Burdick,
    Stochastic cloning, ICRA 2002]: states are the system's, then those remembered.

    Attributes:
        memories: after how many samples each state that is remembered is another.
        states: all states.
        rows: number of values that each sensor reads in a period.
        width: n.
        begin: D (states, n) and P (states, states) of a state that is known.
    """

    def __init__(self, sensors: tuple[Sensor, ...], system: System, noise: ProcessNoise) -> None:
        """Write the readings of a period."""
        self.sensors, self.system, self.noise = sensors, system, noise
        counts = [len(sensor.nuisances) for sensor in sensors]
        self.memories = memories_of(sensors)
        self.size, self._each = len(system.parameters), len(system.states)
        self.states = self._each * (1 + len(self.memories))
        self.width = self.size + self._each + sum(counts)
        self._state = ca.SX.sym("state", self.states)
        self._held = [
            ca.SX.sym("inputs", len(system.inputs)),
            ca.SX.sym("p", self.size),
            ca.SX.sym("period"),
        ]
        start = np.zeros((self.states, self.width))
        start[: self._each, self.size : self.size + self._each] = np.eye(self._each)
        self.begin = ca.DM(start), ca.DM.zeros(self.states, self.states)
        self._nuisances = ca.SX.sym("nuisances", sum(counts))
        self._reads = ca.SX.sym("reads", len(sensors) + len(self.memories))
        nominal = [nuisance.nominal for sensor in sensors for nuisance in sensor.nuisances]
        self._nominal = ca.SX(ca.DM(nominal)) if nominal else ca.SX(0, 1)
        self._readings = [
            row_of(sensor, system, noise, self._now, part, self._memory(sensor))
            for sensor, part in zip(sensors, self._each_own(counts), strict=True)
        ]
        self._placed = []
        for place, row in enumerate(self._readings):
            columns = self.size, self._each, sum(counts[:place]), sum(counts[place + 1 :])
            self._placed.append(row.among(columns, self.memories))
        self.rows = tuple(row.slopes.shape[0] for row in self._readings)

    def _each_own(self, counts: Sequence[int]) -> list[Expression]:
        # Every sensor's nuisances.
        return list(ca.vertsplit(self._nuisances, np.cumsum([0, *counts]).tolist()))

    @property
    def _arguments(self) -> list[Expression]:
        # States, inputs, parameters and period.
        return [self._state, *self._held]

    @property
    def _now(self) -> list[Expression]:
        # The same of the system's own state.
        return [self._state[: self._each], *self._held]

    def _memory(self, sensor: Sensor) -> Expression | None:
        # The state that its reading began at, where that is not the period's.
        if sensor.when != "between samples" or sensor.every == 1:
            return None
        first = self._each * (1 + self.memories.index(sensor.every))
        return self._state[first : first + self._each]

    def remembering(self, path: Expression) -> Expression:
        """All states (states, times) of a path of the system's own, from a run's begin."""
        times = np.arange(path.shape[1])
        return ca.vertcat(path, *(path[:, (times - times % every).tolist()] for every in self.memories))

    @cached_property
    def period(self) -> ca.Function:
        """(D, P, state, inputs, parameters, period, which sensors read and memories begin) -> both at
        the next sample, and e / sqrt(s) (rows, n) of all sensors' readings.
        """
        slopes, covariance = self._symbols(self.width)
        rows_read = [row.scaled(self._reads[place]) for place, row in enumerate(self._placed)]
        period, rows = self._period(slopes, covariance, rows_read)
        return self._function("filter", [slopes, covariance, *self._arguments, self._reads], [*period, rows])

    @cached_property
    def last(self) -> ca.Function:
        """(D, P, state, inputs, parameters, period, which sensors read) -> e / sqrt(s) (rows, n) at the last
        instant.
        """
        slopes, covariance = self._symbols(self.width)
        _, last = _Belief(slopes, covariance, self.states).whitened(self._at_end(self._placed))
        return self._function("last", [slopes, covariance, *self._arguments, self._reads], [last])

    @cached_property
    def tracking(self) -> ca.Function:
        """`period` about any path, with a column of what is 1 behind the unknowns: (D (states, n + 1), P,
        state, inputs, parameters, period, which sensors read and memories begin, nuisances, readings (rows,),
        the system's state on the path at the next sample) -> both at the next sample, innovations (rows,
        n + 1), then derivatives of the next column and of innovations by a column, (states, states), (rows,
        states).
        """
        slopes, covariance = self._symbols(self.width + 1)
        measured, compared = self._compared
        following = ca.SX.sym("following", self._each)
        rows_read = [row.scaled(self._reads[place]) for place, row in enumerate(compared)]
        (moved, spreads), rows = self._period(self._with_columns(slopes), covariance, rows_read)
        moved[: self._each, self.width] += stepper(self.system)(*self._now) - following
        count = self.width + 1
        results = [moved[:, :count], spreads, rows[:, :count], moved[:, count:], rows[:, count:]]
        arguments = [slopes, covariance, *self._arguments, self._reads, self._nuisances, measured, following]
        return ca.Function("tracking", arguments, ca.cse([ca.densify(result) for result in results]))

    @cached_property
    def ending(self) -> ca.Function:
        """`tracking` at the last instant, without a next sample: innovations, and their derivatives."""
        slopes, covariance = self._symbols(self.width + 1)
        measured, compared = self._compared
        belief = _Belief(self._with_columns(slopes), covariance, self.states)
        _, last = belief.whitened(self._at_end(compared))
        results = [last[:, : self.width + 1], last[:, self.width + 1 :]]
        arguments = [slopes, covariance, *self._arguments, self._reads, self._nuisances, measured]
        return ca.Function("ending", arguments, ca.cse([ca.densify(result) for result in results]))

    @cached_property
    def _linear(self) -> ca.Function:
        # (state, inputs, parameters, period) -> slopes of all readings of a period by the unknowns directly,
        # and by the state and the errors; of the step by (parameters, state); of the errors' effect, and Q.
        direct, through = (
            ca.vertcat(*(getattr(row, name) for row in self._placed)) for name in ("direct", "through")
        )
        arguments = self._arguments
        results = [direct, through, self._step(), *self._spread()]
        fixed = [ca.sparsify(ca.substitute(result, self._nuisances, self._nominal)) for result in results]
        return ca.Function("linear", arguments, ca.cse(fixed))

    def update(
        self,
        belief: Sequence[Expression],
        moment: Sequence[Expression],
        reads: Expression,
        columns: Sequence[int],
    ) -> Update:
        """Return D and P of some of the unknowns, and the errors, after a period's readings.

        Args:
            belief: D (states, columns) and P.
            moment: states, inputs, parameters and period.
            reads: 1 for each sensor that reads and each memory that begins, else 0.
            columns: places of those unknowns.
        """
        direct, through, _, _, errors = self._linear(*moment)
        heights = np.repeat(np.arange(len(self.rows)), self.rows).tolist()
        rows = Placed(direct[:, list(columns)], through).scaled(ca.diag(reads[heights]))
        slopes, covariance = self._begun(belief[0], belief[1], reads)
        begun = _Belief.of(slopes, covariance, errors)
        return Update(begun.slopes, begun.covariance, rows.direct, rows.through)

    def moved(
        self, belief: Sequence[Expression], moment: Sequence[Expression], columns: Sequence[int]
    ) -> tuple[Expression, Expression]:
        """D and P at the next sample.

        Args:
            belief: both after a period's readings, of state and errors.
            moment: states, inputs, parameters and period.
            columns: places of the unknowns in D.
        """
        _, _, step, effect, _ = self._linear(*moment)
        direct = ca.horzcat(step[:, : self.size], ca.SX(self.states, self.width - self.size))
        return _moved(belief, step[:, self.size :], effect, direct[:, list(columns)])

    def reads(self, samples: int) -> Array:
        """Return where sensors read in every period of a run and at its end, and where memories begin,
        (sensors + memories, samples + 1).
        """
        return reads_of(self.sensors, samples)

    def begun(self, states: Expression, reads: Expression) -> Expression:
        """All states, or rows for them, with those remembered that begin to be (SX).

        Args:
            states: (states, ...).
            reads: 1 for each sensor that reads and each memory that begins, else 0.
        """
        return self._turning(reads) @ states

    def _begun(
        self, slopes: Expression, covariance: Expression, reads: Expression
    ) -> tuple[Expression, Expression]:
        if not self.memories:
            return slopes, covariance
        turning = self._turning(reads)
        return turning @ slopes, ca.triu2symm(ca.triu(turning @ covariance @ turning.T))

    def _turning(self, reads: Expression) -> Expression:
        # From states to those with what is remembered from now on.
        none, same = ca.SX(self._each, self._each), ca.SX.eye(self._each)
        parts, count = [[same, *[none] * len(self.memories)]], len(self.sensors)
        for place in range(len(self.memories)):
            begins = reads[count + place]
            unchanged = [
                (1 - begins) * same if column == place else none for column in range(len(self.memories))
            ]
            parts.append([begins * same, *unchanged])
        return ca.sparsify(ca.blockcat(parts))

    def _symbols(self, width: int) -> tuple[Expression, Expression]:
        slopes = ca.SX.sym("D", self.states, width)
        return slopes, ca.SX.sym("P", self.states, self.states)

    def _function(self, name: str, arguments: list[Expression], results: list[Expression]) -> ca.Function:
        # At the nuisances' nominal values; a covariance is taken by its upper half, lest rounding bend it.
        covariance = arguments[1]
        symmetric = ca.triu2symm(ca.triu(covariance))
        fixed = [ca.substitute(result, self._nuisances, self._nominal) for result in results]
        dense = [ca.densify(ca.substitute(result, covariance, symmetric)) for result in fixed]
        return ca.Function(name, arguments, ca.cse(dense))

    def _period(
        self, slopes: Expression, covariance: Expression, readings: Sequence[Placed]
    ) -> tuple[list[Expression], Expression]:
        effect, errors = self._spread()
        begun = self._begun(slopes, covariance, self._reads)
        read, rows = _Belief.of(*begun, errors).whitened(readings)
        belief = read.slopes, read.covariance
        step = self._step()
        direct = ca.horzcat(step[:, : self.size], ca.SX(self.states, slopes.shape[1] - self.size))
        return list(_moved(belief, step[:, self.size :], effect, direct)), rows

    def _spread(self) -> tuple[Expression, Expression]:
        # What errors of a period do to the states, and their covariance.
        state, inputs, _, period = self._now
        effect, covariance = spread(self.noise, self.system)(
            state, inputs, ca.SX(ca.DM(self.system.nominal)), period
        )
        return ca.vertcat(effect, ca.SX(self.states - self._each, self.noise.size)), covariance

    def _step(self) -> Expression:
        # Slopes of a period's step by (parameters, states); what is remembered lasts.
        identity = ca.horzcat(ca.SX(self._each, self.size), ca.SX.eye(self._each))
        moved, rest = carrier(self.system)(identity, *self._now), self.states - self._each
        lasting = ca.horzcat(ca.SX(rest, self.size + self._each), ca.SX.eye(rest))
        return ca.sparsify(ca.vertcat(ca.horzcat(moved, ca.SX(self._each, rest)), lasting))

    def _at_end(self, rows: Sequence[Placed]) -> list[Placed]:
        # What is read at the last instant.
        return [
            row.without_errors(self.noise.size).scaled(self._reads[place]) for place, row in enumerate(rows)
        ]

    @cached_property
    def _compared(self) -> tuple[Expression, list[Placed]]:
        # Symbols for what was read, and all readings with what they are off as a column more.
        edges = np.cumsum([0, *self.rows]).tolist()
        measured = ca.SX.sym("measured", edges[-1])
        triples = zip(self._readings, self._placed, ca.vertsplit(measured, edges), strict=True)
        return measured, [
            placed.extended(-row.misfit(values), self.states) for row, placed, values in triples
        ]

    def _with_columns(self, slopes: Expression) -> Expression:
        # And columns that show what becomes of any.
        return ca.horzcat(slopes, ca.SX.eye(self.states))


@dataclass(frozen=True)
class _Belief:
    # Sensitivities of the prediction of (state, errors) by all unknowns, and its covariance.
    slopes: Expression
    covariance: Expression
    states: int

    @classmethod
    def of(cls, slopes: Expression, covariance: Expression, errors: Expression) -> _Belief:
        # Of a period that begins with that prediction, and errs so.
        none = ca.SX(errors.shape[0], slopes.shape[1])
        return cls(ca.vertcat(slopes, none), ca.diagcat(covariance, errors), covariance.shape[0])

    def whitened(self, readings: Sequence[Placed]) -> tuple[_Belief, Expression]:
        # After readings of unit noise, one number at a time; and their whitened innovations' sensitivities.
        slopes, covariance, whitened = self.slopes, self.covariance, []
        for reading in readings:
            for row in range(reading.direct.shape[0]):
                through = ca.sparsify(reading.through[row, :])
                gained = covariance @ through.T
                root = ca.sqrt(1 + through @ gained)
                white = (through @ slopes + reading.direct[row, :]) / root
                gain = gained / root
                slopes, covariance = slopes - gain @ white, covariance - gain @ gain.T
                whitened.append(white)
        return _Belief(slopes, covariance, self.states), ca.vertcat(*whitened)


def _moved(
    belief: Sequence[Expression], by_state: Expression, effect: Expression, direct: Expression
) -> tuple[Expression, Expression]:
    # After the period, whose step has slopes by the state, by errors, and by the unknowns directly.
    onward = ca.horzcat(by_state, effect)
    return onward @ belief[0] + direct, onward @ belief[1] @ onward.T


@lru_cache(maxsize=8)
def filter_of(sensors: tuple[Sensor, ...], system: System, noise: ProcessNoise) -> Filter:
    """The filter, made once for all that ask for it.

    Args:
        sensors: sensors that read.
        system: system that is driven.
        noise: process noise of the system.
    """
    return Filter(sensors, system, noise)


def innovations(sensors: Sequence[Sensor], drive: Drive, noise: ProcessNoise) -> Expression:
    """Sensitivities (M, columns) of all innovations in units of their deviations, by (parameters, start
    states run by run, nuisances): rows as `joint_readings` has them.

    Args:
        sensors: sensors that read.
        drive: drive of the system.
        noise: process noise of the system.
    """
    used = filter_of(tuple(sensors), drive.system, noise)
    start, samples = slice(used.size, used.size + len(drive.system.states)), drive.samples
    tables = [_of_run(used, drive, run) for run in range(drive.runs)]
    blocks = []
    for place, sensor in enumerate(sensors):
        first = sum(used.rows[:place])
        places = np.arange(first, first + used.rows[place])
        columns = np.array(taken_in(sensor, samples))
        chosen = (columns[:, None] * sum(used.rows) + places).ravel().tolist()
        blocks.append([table[chosen, :] for table in tables])
    rows = []
    for runs in blocks:
        # Every run has a start of its own.
        starts, stacked = ca.diagcat(*(table[:, start] for table in runs)), ca.vertcat(*runs)
        rows.append(ca.horzcat(stacked[:, : start.start], starts, stacked[:, start.stop :]))
    return ca.vertcat(*rows)


def _of_run(used: Filter, drive: Drive, run: int) -> Expression:
    # All innovations of a run, every sensor in every period and at the last instant, (rows, n).
    samples, (begin, none) = drive.samples, used.begin
    path = drive.states[[run * (samples + 1) + place for place in range(samples + 1)], :].T
    path = used.remembering(path)
    inputs = drive.inputs[run * samples : (run + 1) * samples, :].T
    arguments = drive.parameters, drive.period
    along = used.period.mapaccum("along", samples, 2)
    reads = ca.DM(used.reads(samples))
    slopes, covariance, rows = along(begin, none, path[:, :samples], inputs, *arguments, reads[:, :samples])
    end = slopes[:, -used.width :], covariance[:, -used.states :]
    last = used.last(*end, path[:, -1], inputs[:, -1], *arguments, reads[:, samples])
    # Those of all periods stand side by side.
    return ca.vertcat(*ca.horzsplit(rows, used.width), last)
