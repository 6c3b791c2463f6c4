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
        nuisances = [nuisance.nominal for sensor in sensors for nuisance in sensor.nuisances]
        self._nominal = ca.DM(nuisances).reshape((len(nuisances), 1))
        self.width = self.size + self._own + len(nuisances)
        self._moment = [ca.SX.sym("states", self.states), *step_symbols(system)[1:]]
        self._constants = ca.SX.sym("nuisances", len(nuisances))
        self._reads = ca.SX.sym("reads", len(sensors) + len(self.memories))
        start = np.eye(self.states, self.width, self.size)
        start[self._own :] = 0.0
        self.begin = ca.DM(start), ca.DM.zeros(self.states, self.states)
        self._linear = self._linearised()
        self.rows = tuple(reader(sensor, system).size1_out(0) for sensor in sensors)

    def _linearised(self) -> ca.Function:
        # (states, inputs, parameters, period, nuisances) -> all of `Linear`, readings and their whitening.
        state, inputs, parameters, duration = self._moment
        errors, own_state = ca.SX.sym("errors", self.noise.size), state[: self._own, :]
        period = Period(self.system, own_state, inputs, parameters, duration)
        following = self.noise.step(period, errors)
        readings, whitenings, first = [], [], 0
        for sensor in self.sensors:
            read = reader(sensor, self.system, self.noise.signal)
            constants = self._constants[first : first + len(sensor.nuisances), :]
            first += len(sensor.nuisances)
            states, held, lasting, error = own_state, inputs, ca.SX(0), ca.SX.zeros(read.size1_in(5))
            if sensor.when == "between samples":
                begin = self._own * (self.memories.index(sensor.every) + 1 if sensor.every > 1 else 0)
                states, held = (
                    ca.vertcat(following, state[begin : begin + self._own, :]),
                    ca.repmat(inputs, 2),
                )
                lasting = sensor.every * duration
            elif sensor.when == "in periods":
                lasting, error = duration, errors[: error.shape[0], :] / duration
            reading, whitening = read(states, held, parameters, constants, lasting, error)
            readings.append(reading)
            whitenings.append(whitening)
        reading, whitening = ca.vertcat(*readings), ca.diagcat(*whitenings)
        after = ca.vertcat(following, state[self._own :, :])
        results = []
        for slopes in (whitening @ self._slopes(reading, errors), self._slopes(after, errors)):
            by_parameters, through, by_constants = ca.horzsplit(
                slopes, [0, self.size, self.size + self.states + self.noise.size, slopes.shape[1]]
            )
            no_start = ca.SX(slopes.shape[0], self._own)
            results += [ca.horzcat(by_parameters, no_start, by_constants), through]
        # How far a process errs is known beforehand, at the nominal parameters.
        nominal = period._replace(parameters=ca.SX(ca.DM(self.system.nominal)))
        results += [ca.SX(self.noise.covariance(nominal)), reading, whitening]
        still = ca.SX.zeros(self.noise.size)
        linear = [ca.sparsify(ca.substitute(result, errors, still)) for result in results]
        return ca.Function("linear", [*self._moment, self._constants], ca.cse(linear))

    def _slopes(self, values: Expression, errors: Expression) -> Expression:
        state, _, parameters, _ = self._moment
        return ca.jacobian(values, ca.vertcat(parameters, state, errors, self._constants))

    @cached_property
    def period(self) -> ca.Function:
        """The function (D, P, states, inputs, parameters, period, reads) -> D and P at the next sample, and
        e / sqrt(s) (rows, n) of all sensors' readings.

        `reads` is 1 for each sensor that reads and each memory that begins, else 0. At the end of a run only
        the readings have a meaning.
        """
        slopes, covariance = ca.SX.sym("D", self.states, self.width), self._covariance
        linear = Linear(*self._linear(*self._moment, self._nominal)[:5])
        results = self._stepped(slopes, covariance, linear)
        arguments = [slopes, covariance, *self._moment, self._reads]
        return ca.Function("filter", arguments, ca.cse([ca.densify(result) for result in results]))

    @cached_property
    def tracking(self) -> ca.Function:
        """The function `period` about any path, with a column of what is 1 behind the unknowns.

        (D (states, n + 1), P, states, inputs, parameters, period, reads, nuisances, readings (rows,), the
        system's state on the path at the next sample) -> D and P at the next sample, innovations (rows,
        n + 1), then derivatives of the next column and of innovations by a column, (states, states), (rows,
        states).
        """
        slopes, covariance = ca.SX.sym("D", self.states, self.width + 1), self._covariance
        measured, following = ca.SX.sym("measured", sum(self.rows)), ca.SX.sym("following", self._own)
        *matrices, reading, whitening = self._linear(*self._moment, self._constants)
        linear = Linear(*matrices)
        state, *held = self._moment
        gap = stepper(self.system)(state[: self._own, :], *held) - following
        gap = ca.vertcat(gap, ca.SX(self.states - self._own, 1))
        # Columns of the identity show what becomes of any.
        misfit, none = -whitening @ self._residual(measured, reading), ca.SX(self.states, self.states)
        extended = linear._replace(
            direct=ca.horzcat(linear.direct, misfit, ca.SX(misfit.shape[0], self.states)),
            step_direct=ca.horzcat(linear.step_direct, gap, none),
        )
        after, *spread, rows = self._stepped(ca.horzcat(slopes, ca.SX.eye(self.states)), covariance, extended)
        edges = [0, self.width + 1, after.shape[1]]
        (after, onward), (rows, seen) = ca.horzsplit(after, edges), ca.horzsplit(rows, edges)
        arguments = [slopes, covariance, *self._moment, self._reads, self._constants, measured, following]
        results = [ca.densify(result) for result in (after, *spread, rows, onward, seen)]
        return ca.Function("tracking", arguments, ca.cse(results))

    @property
    def _covariance(self) -> Expression:
        return ca.SX.sym("P", self.states, self.states)

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
        self, slopes: Expression, covariance: Expression, linear: Linear
    ) -> tuple[Expression, Expression, Expression]:
        # D and P at the next sample, and whitened innovations: one number after the other, however many.
        slopes, covariance = self._begun(slopes, covariance, self._reads, linear.errors)
        direct, through = self._read(linear, self._reads)
        rows = []
        for row in range(direct.shape[0]):
            slope = ca.sparsify(through[row, :])
            gained = covariance @ slope.T
            root = ca.sqrt(1 + slope @ gained)
            rows.append((slope @ slopes + direct[row, :]) / root)
            gain = gained / root
            slopes, covariance = slopes - gain @ rows[-1], covariance - gain @ gain.T
        return *_moved(slopes, covariance, linear), ca.vertcat(*rows)

    def _read(self, linear: Linear, reads: Expression) -> tuple[Expression, Expression]:
        # Slopes of the readings that there are.
        heights = np.repeat(np.arange(len(self.rows)), self.rows).tolist()
        chosen = ca.diag(reads[heights])
        return chosen @ linear.direct, chosen @ linear.through

    def _begun(
        self, slopes: Expression, covariance: Expression, reads: Expression, errors: Expression
    ) -> tuple[Expression, Expression]:
        # D and P of (states, errors), with the states that are remembered from now on. A covariance is taken
        # by its upper half, lest rounding bend it.
        covariance = ca.triu2symm(ca.triu(covariance))
        if self.memories:
            turning = self._turning(reads)
            slopes = turning @ slopes
            covariance = ca.triu2symm(ca.triu(turning @ covariance @ turning.T))
        still = ca.SX(errors.shape[0], slopes.shape[1])
        return ca.vertcat(slopes, still), ca.diagcat(covariance, errors)

    def _turning(self, reads: Expression) -> Expression:
        # From all states to those with the memories that begin.
        begins = reads[len(self.sensors) :, :]
        replaced = ca.vertcat(ca.SX.eye(1), begins)
        lasting = ca.diag(ca.vertcat(0, 1 - begins))
        first = ca.horzcat(replaced, ca.SX(replaced.shape[0], begins.shape[0]))
        return ca.kron(ca.sparsify(first + lasting), ca.SX.eye(self._own))

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
        linear = Linear(*self._linear(*moment, self._nominal)[:5])
        direct, through = self._read(linear, reads)
        slopes, covariance = self._begun(belief[0], belief[1], reads, linear.errors)
        return Update(slopes, covariance, direct[:, list(columns)], through)

    def moved(
        self, belief: Sequence[Expression], moment: Sequence[Expression], columns: Sequence[int]
    ) -> tuple[Expression, Expression]:
        """Return D and P at the next sample.

        Args:
            belief: both after a period's readings, of states and errors.
            moment: states, inputs, parameters and period.
            columns: places of the unknowns in D.
        """
        linear = Linear(*self._linear(*moment, self._nominal)[:5])
        chosen = linear._replace(step_direct=linear.step_direct[:, list(columns)])
        return _moved(belief[0], belief[1], chosen)

    def remembering(self, path: Expression) -> Expression:
        """Return all states (states, times) of a path of the system's own, from a run's begin."""
        times = np.arange(path.shape[1])
        return ca.vertcat(path, *(path[:, (times - times % every).tolist()] for every in self.memories))


def _moved(slopes: Expression, covariance: Expression, linear: Linear) -> tuple[Expression, Expression]:
    onward = linear.step_through
    return onward @ slopes + linear.step_direct, onward @ covariance @ onward.T


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
