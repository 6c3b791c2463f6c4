"""Readings under process noise: a Kalman filter that carries sensitivities along with its covariance.

With the covariance P of the state and the sensitivities D of its prediction by all unknowns, a reading of
unit noise with slope h by the state and its errors has the innovation's variance s = 1 + h P h' and
sensitivity e = h D + h_p; the information is the sum of e'e / s, exactly that of generalised least squares
on all readings together [Kailath, Sayed, Hassibi: Linear estimation, 2000, chapter 9]. The period's errors
are among the states while its readings are taken in: what a sensor reads of the period itself sees them too.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System, step_symbols, stepper
from oed.kernel.measurement.process_noise import Period, ProcessNoise
from oed.kernel.measurement.readings import by_run, reader
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.measurement.update import Update


class Linear(NamedTuple):
    """Period of a filter, linear in the unknowns (n), the states and the period's errors (m).

    Attributes:
        direct: slopes of all readings, in units of their noise, by the unknowns directly, (q, n).
        through: slopes of the readings by (states, errors), (q, states + m).
        step_direct: slopes of the next states by the unknowns directly, (states, n).
        step_through: slopes of the next states by (states, errors), (states, states + m).
        errors: covariance of the errors, (m, m).
    """

    direct: Expression
    through: Expression
    step_direct: Expression
    step_through: Expression
    errors: Expression

    def moved(self, slopes: Expression, covariance: Expression) -> tuple[Expression, Expression]:
        """Return D and P at the next sample, from both of (states, errors) after the readings."""
        onward = self.step_through
        return onward @ slopes + self.step_direct, onward @ covariance @ onward.T


class Filter:
    """Kalman filter for the readings of every period; its functions are made when first used.

    The unknowns, n of them, are the parameters, the start states, the sensors' nuisances. A reading across
    several samples makes the state that it begins at a state as well, which lasts [Roumeliotis and Burdick,
    Stochastic cloning, ICRA 2002]: states are the system's, then those remembered.

    Attributes:
        memories: numbers of samples after which each state that is remembered is replaced.
        states: number of all states.
        rows: number of values that each sensor reads in a period.
        size: number of parameters.
        width: n.
        begin: D (states, n) and P (states, states) of a state that is known.
    """

    def __init__(self, sensors: tuple[Sensor, ...], system: System, noise: ProcessNoise) -> None:
        """Linearise the readings and the step of a period."""
        self.sensors, self.system, self.noise = sensors, system, noise
        self.memories = memories_of(sensors)
        self.size, self._own = len(system.parameters), len(system.states)
        self.states = self._own * (1 + len(self.memories))
        self._nominal = [nuisance.nominal for sensor in sensors for nuisance in sensor.nuisances]
        self.width = self.size + self._own + len(self._nominal)
        start = np.eye(self.states, self.width, self.size)
        start[self._own :] = 0.0
        self.begin = ca.DM(start), ca.DM.zeros(self.states, self.states)
        self.rows = tuple(reader(sensor, system).size1_out(0) for sensor in sensors)
        self._heights = np.repeat(np.arange(len(sensors)), self.rows).tolist()
        self._linear = self._linearised()

    def _linearised(self) -> ca.Function:
        # (states, inputs, parameters, period, nuisances) -> all of `Linear`, readings and their whitening.
        state, constants = ca.SX.sym("states", self.states), ca.SX.sym("nuisances", len(self._nominal))
        _, inputs, parameters, duration = step_symbols(self.system)
        now, *remembered = ca.vertsplit(state, self._own)
        period = Period(self.system, now, inputs, parameters, duration)
        errors = ca.SX.sym("errors", self.noise.size)
        following, begins = self.noise.step(period, errors), dict(zip(self.memories, remembered, strict=True))
        edges = np.cumsum([0, *(len(sensor.nuisances) for sensor in self.sensors)]).tolist()
        pairs = []
        for sensor, own_constants in zip(self.sensors, ca.vertsplit(constants, edges), strict=True):
            read = reader(sensor, self.system, self.noise.signal)
            states, held, error = now, inputs, ca.SX.zeros(read.size1_in(5))
            if sensor.when == "between samples":
                states, held = ca.vertcat(following, begins.get(sensor.every, now)), ca.repmat(inputs, 2)
            elif sensor.when == "in periods" and self.noise.signal:
                error = errors / duration
            pairs.append(read(states, held, parameters, own_constants, sensor.lasting * duration, error))
        readings, whitenings = zip(*pairs, strict=True)
        reading, whitening = ca.vertcat(*readings), ca.diagcat(*whitenings)
        unknowns, results = ca.vertcat(parameters, state, errors, constants), []
        edges = [0, self.size, self.size + self.states + self.noise.size, unknowns.shape[0]]
        for part, weights in ((reading, whitening), (ca.vertcat(following, *remembered), 1)):
            slopes = ca.mtimes(weights, ca.jacobian(part, unknowns))
            by_parameters, through, by_constants = ca.horzsplit(slopes, edges)
            no_start = ca.SX(part.shape[0], self._own)
            results += [ca.horzcat(by_parameters, no_start, by_constants), through]
        # How far a process errs is known beforehand, at the nominal parameters.
        nominal = period._replace(parameters=ca.SX(ca.DM(self.system.nominal)))
        results += [ca.SX(self.noise.covariance(nominal)), reading, whitening]
        still = ca.SX.zeros(self.noise.size)
        linear = [ca.sparsify(ca.substitute(result, errors, still)) for result in results]
        return ca.Function("linear", [state, inputs, parameters, duration, constants], ca.cse(linear))

    def _at(self, moment: Sequence[Expression], columns: Sequence[int] | slice = slice(None)) -> Linear:
        # A period at the nuisances' nominal values, by some of the unknowns.
        linear = Linear(*self._linear(*moment, self._nominal)[:5])
        return linear._replace(direct=linear.direct[:, columns], step_direct=linear.step_direct[:, columns])

    def _symbols(self, width: int) -> list[ca.SX]:
        # D, P, states, inputs, parameters, period and reads.
        shapes = (self.states, width), (self.states, self.states), (self.states, 1)
        belief = [ca.SX.sym("belief", *shape) for shape in shapes]
        reads = ca.SX.sym("reads", len(self.sensors) + len(self.memories))
        return [*belief, *step_symbols(self.system)[1:], reads]

    @cached_property
    def period(self) -> ca.Function:
        """The function (D, P, states, inputs, parameters, period, reads) -> D and P at the next sample, and
        e / sqrt(s) (rows, n) of all sensors' readings.

        `reads` is 1 for each sensor that reads and each memory that begins, else 0. At the end of a run only
        the readings have a meaning.
        """
        slopes, covariance, *moment, reads = arguments = self._symbols(self.width)
        results = self._stepped(slopes, covariance, self._at(moment), reads)
        return ca.Function("filter", arguments, ca.cse(list(map(ca.densify, results))))

    @cached_property
    def tracking(self) -> ca.Function:
        """The function `period` about any path, with a column of what is 1 behind the unknowns.

        (D (states, n + 1), P, states, inputs, parameters, period, reads, nuisances, readings (rows,), the
        system's state on the path at the next sample) -> D and P at the next sample, innovations (rows,
        n + 1), then derivatives of the next column and of innovations by a column, (states, states), (rows,
        states).
        """
        count = self.width + 1
        slopes, covariance, *moment, reads = arguments = self._symbols(count)
        constants = ca.SX.sym("nuisances", len(self._nominal))
        measured = ca.SX.sym("measured", sum(self.rows))
        following = ca.SX.sym("following", self._own)
        *matrices, reading, whitening = self._linear(*moment, constants)
        linear, off = Linear(*matrices), -whitening @ self._residual(measured, reading)
        gap = stepper(self.system)(moment[0][: self._own, :], *moment[1:]) - following
        gap = ca.vertcat(gap, ca.SX(self.states - self._own, 1))
        # Columns of the identity show what becomes of any.
        extended = linear._replace(
            direct=ca.horzcat(linear.direct, off, ca.SX(off.shape[0], self.states)),
            step_direct=ca.horzcat(linear.step_direct, gap, ca.SX(self.states, self.states)),
        )
        columns = ca.horzcat(slopes, ca.SX.eye(self.states))
        after, spread, rows = self._stepped(columns, covariance, extended, reads)
        results = [after[:, :count], spread, rows[:, :count], after[:, count:], rows[:, count:]]
        arguments += [constants, measured, following]
        return ca.Function("tracking", arguments, ca.cse(list(map(ca.densify, results))))

    def _residual(self, measured: Expression, reading: Expression) -> Expression:
        # Measured less predicted readings; angles up to full turns.
        residual, first = measured - reading, 0
        for sensor, count in zip(self.sensors, self.rows, strict=True):
            for place in sensor.angles:
                angle = residual[first + place]
                residual[first + place] = ca.atan2(ca.sin(angle), ca.cos(angle))
            first += count
        return residual

    def _stepped(
        self, slopes: Expression, covariance: Expression, linear: Linear, reads: Expression
    ) -> tuple[Expression, Expression, Expression]:
        # D and P at the next sample, and whitened innovations: one number after the other, however many.
        slopes, covariance, direct, through = self._begun(slopes, covariance, linear, reads)
        rows = []
        for row in range(direct.shape[0]):
            slope = ca.sparsify(through[row, :])
            gained = covariance @ slope.T
            root = ca.sqrt(1 + slope @ gained)
            rows.append((slope @ slopes + direct[row, :]) / root)
            gain = gained / root
            slopes, covariance = slopes - gain @ rows[-1], covariance - gain @ gain.T
        return *linear.moved(slopes, covariance), ca.vertcat(*rows)

    def _begun(
        self, slopes: Expression, covariance: Expression, linear: Linear, reads: Expression
    ) -> tuple[Expression, Expression, Expression, Expression]:
        # D and P of (states, errors), with the states that are remembered from now on, and slopes of what is
        # read. A covariance is taken by its upper half, lest rounding bend it.
        covariance = ca.triu2symm(ca.triu(covariance))
        if self.memories:
            turning = self._turning(reads)
            slopes = turning @ slopes
            covariance = ca.triu2symm(ca.triu(turning @ covariance @ turning.T))
        still, chosen = ca.SX(linear.errors.shape[0], slopes.shape[1]), ca.diag(reads[self._heights])
        begun = ca.vertcat(slopes, still), ca.diagcat(covariance, linear.errors)
        return *begun, chosen @ linear.direct, chosen @ linear.through

    def _turning(self, reads: Expression) -> Expression:
        # From all states to those with the memories that begin.
        begins = reads[len(self.sensors) :, :]
        turning = ca.diag(ca.vertcat(1, 1 - begins))
        turning[1:, 0] = begins
        return ca.kron(ca.sparsify(turning), ca.SX.eye(self._own))

    def begun(self, states: Expression, reads: Expression) -> Expression:
        """Return all states, or rows for them, with those remembered that begin to be (SX).

        Args:
            states: (states, ...).
            reads: 1 for each sensor that reads and each memory that begins, else 0.
        """
        return self._turning(reads) @ states

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
        return Update(*self._begun(belief[0], belief[1], self._at(moment, columns), reads))

    def moved(
        self, belief: Sequence[Expression], moment: Sequence[Expression], columns: Sequence[int]
    ) -> tuple[Expression, Expression]:
        """Return D and P at the next sample.

        Args:
            belief: both after a period's readings, of states and errors.
            moment: states, inputs, parameters and period.
            columns: places of the unknowns in D.
        """
        return self._at(moment, columns).moved(belief[0], belief[1])

    def remembering(self, path: Expression) -> Expression:
        """Return all states (states, times) of a path of the system's own, from a run's begin."""
        times = np.arange(path.shape[1])
        return ca.vertcat(path, *(path[:, (times - times % every).tolist()] for every in self.memories))


@lru_cache(maxsize=8)
def filter_of(sensors: tuple[Sensor, ...], system: System, noise: ProcessNoise) -> Filter:
    """Return the filter of sensors, made once for all that ask for it.

    Args:
        sensors: sensors that read.
        system: system that is driven.
        noise: process noise of the system.
    """
    return Filter(sensors, system, noise)


def memories_of(sensors: Sequence[Sensor]) -> tuple[int, ...]:
    """Return the numbers of samples after which states are replaced that readings across them begin at."""
    across = {sensor.every for sensor in sensors if sensor.when == "between samples" and sensor.every > 1}
    return tuple(sorted(across))


def reads_of(sensors: Sequence[Sensor], samples: int) -> Array:
    """Return where sensors read in every period of a run and at its end, and where memories begin.

    Args:
        sensors: sensors that read.
        samples: number of samples of the run.

    Returns:
        1 or 0, (sensors + memories, samples + 1).
    """
    memories = memories_of(sensors)
    table = np.zeros((len(sensors) + len(memories), samples + 1))
    for place, sensor in enumerate(sensors):
        table[place, taken_in(sensor, samples)] = 1.0
    for place, every in enumerate(memories, len(sensors)):
        table[place, ::every] = 1.0
    return table


def taken_in(sensor: Sensor, samples: int) -> list[int]:
    """Return the periods of a run in which readings are taken in, the last instant after all of them.

    A reading between samples is taken in in the period at whose end it ends.
    """
    early = 1 if sensor.when == "between samples" else 0
    return [column - early for column in sensor.columns(samples)]


def innovations(sensors: Sequence[Sensor], drive: Drive, noise: ProcessNoise) -> Expression:
    """Return sensitivities (M, columns) of all innovations in units of their deviations, by (parameters,
    start states run by run, nuisances); rows as `joint_readings` has them.

    Args:
        sensors: sensors that read.
        drive: drive of the system.
        noise: process noise of the system.
    """
    used = filter_of(tuple(sensors), drive.system, noise)
    tables = [_innovations_of_run(used, drive, run) for run in range(drive.runs)]
    first, blocks = 0, []
    for sensor, count in zip(sensors, used.rows, strict=True):
        periods = np.array(taken_in(sensor, drive.samples))
        rows = (periods[:, None] * sum(used.rows) + first + np.arange(count)).ravel().tolist()
        stacked = ca.vertcat(*(table[rows, :] for table in tables))
        blocks.append(by_run(stacked.T, drive).T)
        first += count
    return ca.vertcat(*blocks)


def _innovations_of_run(used: Filter, drive: Drive, run: int) -> Expression:
    # Every sensor in every period and at the last instant, (rows, n).
    samples = drive.samples
    path = drive.states[list(range(run * (samples + 1), (run + 1) * (samples + 1))), :].T
    inputs = drive.inputs[run * samples : (run + 1) * samples, :].T
    along = used.period.mapaccum("along", samples + 1, 2)
    *_, rows = along(
        *used.begin,
        used.remembering(path),
        ca.horzcat(inputs, inputs[:, -1]),
        drive.parameters,
        drive.period,
        ca.DM(reads_of(used.sensors, samples)),
    )
    # Those of all periods stand side by side.
    return ca.vertcat(*ca.horzsplit(rows, used.width))
