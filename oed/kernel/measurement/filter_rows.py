"""Rows of one sensor in a filter: readings of a period, and their slopes by all that it carries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System, carrier, stepper
from oed.kernel.measurement.measurement import Sensor
from oed.kernel.measurement.process_noise import ProcessNoise, spread
from oed.kernel.measurement.readings import moment_reading, reading_by_signal


@dataclass(frozen=True)
class Placed:
    """Slopes of readings of unit noise.

    Attributes:
        direct: direct slopes by all unknowns, (q, n).
        through: slopes by the state and the errors, (q, states + m).
    """

    direct: Expression
    through: Expression

    def scaled(self, factor: Expression | float) -> Placed:
        """Return the row times a number, or times one of each row: a diagonal matrix."""
        return Placed(ca.mtimes(factor, self.direct), ca.mtimes(factor, self.through))

    def extended(self, column: Expression, empty: int) -> Placed:
        """Return the row with a column more, and columns of what the readings do not depend on directly."""
        return Placed(ca.horzcat(self.direct, column, ca.SX(column.shape[0], empty)), self.through)

    def without_errors(self, size: int) -> Placed:
        """Return the row of an instant that no errors precede."""
        return Placed(self.direct, self.through[:, : self.through.shape[1] - size])


@dataclass(frozen=True)
class Row:
    """Readings of a period, and in units of their noise their slopes.

    Attributes:
        sensor: sensor that reads.
        reading: (q,), SI.
        whitening: (q, q).
        slopes: slopes by (parameters, the system's state, the sensor's own nuisances), (q, ...).
        by_memory: slopes by the state that readings across periods begin at, (q, states); None of others.
        by_errors: slopes by the period's errors, (q, m).
    """

    sensor: Sensor
    reading: Expression
    whitening: Expression
    slopes: Expression
    by_memory: Expression | None
    by_errors: Expression

    def misfit(self, measured: Expression) -> Expression:
        """Return the measured less the predicted reading, in units of the noise; angles up to full turns."""
        residual = measured - self.reading
        for place in self.sensor.angles:
            residual[place] = ca.atan2(ca.sin(residual[place]), ca.cos(residual[place]))
        return self.whitening @ residual

    def among(self, columns: Sequence[int], memories: Sequence[int]) -> Placed:
        """Return the row with columns for all unknowns, those of other sensors' nuisances 0.

        Args:
            columns: numbers of parameters, start states, nuisances before the sensor's own and behind them.
            memories: after how many samples each state that is remembered is another.
        """
        size, states, before, rest = columns
        count, leading = self.slopes.shape[0], size + states
        by_parameters, by_nuisances = self.slopes[:, :size], self.slopes[:, leading:]
        direct = ca.horzcat(by_parameters, ca.SX(count, states + before), by_nuisances, ca.SX(count, rest))
        zeros = ca.SX(count, states)
        by_memories = [
            zeros if self.by_memory is None or every != self.sensor.every else self.by_memory
            for every in memories
        ]
        return Placed(direct, ca.horzcat(self.slopes[:, size:leading], *by_memories, self.by_errors))


def memories_of(sensors: Sequence[Sensor]) -> tuple[int, ...]:
    """After how many samples the states that readings across several of them begin at are others."""
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
    """Return the periods of a run in which readings are taken in, the last instant after all of them."""
    if sensor.when == "between samples":
        # That at whose end they end.
        return [column - 1 for column in sensor.columns(samples)]
    return sensor.columns(samples)


def row_of(
    sensor: Sensor,
    system: System,
    noise: ProcessNoise,
    moment: Sequence[Expression],
    nuisances: Expression,
    memory: Expression | None,
) -> Row:
    """Return a sensor's row in a period; the later moment of a reading between samples is the period's end.

    Args:
        sensor: sensor that reads.
        system: system that is driven.
        noise: process noise of the system.
        moment: state at the period's begin, inputs, parameters and period.
        nuisances: the sensor's nuisances.
        memory: the state that a reading across several periods began at.
    """
    if sensor.when == "between samples":
        return _between(sensor, system, noise, moment, nuisances, memory)
    state, inputs, parameters, period = moment
    slopes, function = _identity_slopes(system), moment_reading(sensor, system)
    lasting = period if sensor.when == "in periods" else ca.SX(0)
    results = function(state, slopes, inputs, parameters, nuisances, lasting)
    by_errors = ca.SX(results[0].shape[0], noise.size)
    if sensor.when == "in periods" and noise.signal:
        by_signal = reading_by_signal(sensor, system, noise.signal)(
            state, inputs, parameters, nuisances, period
        )
        by_errors = ca.sparsify(results[2] @ by_signal.T / period)
    return Row(sensor, results[0], results[2], results[4].T, None, by_errors)


def _between(
    sensor: Sensor,
    system: System,
    noise: ProcessNoise,
    moment: Sequence[Expression],
    nuisances: Expression,
    memory: Expression | None,
) -> Row:
    state, inputs, parameters, period = moment
    slopes, function = _identity_slopes(system), moment_reading(sensor, system)
    none, start = ca.SX(*slopes.shape), slice(len(system.parameters), slopes.shape[1])
    both = ca.vertcat(stepper(system)(*moment), state if memory is None else memory)

    def read(later: Expression, earlier: Expression) -> Sequence[Expression]:
        held, carried = ca.vertcat(inputs, inputs), ca.vertcat(later, earlier)
        results: Sequence[Expression] = function(
            both, carried, held, parameters, nuisances, sensor.every * period
        )
        return results

    effect, _ = spread(noise, system)(state, inputs, ca.SX(ca.DM(system.nominal)), period)
    by_errors = read(slopes, none)[4].T[:, start] @ effect
    moved = carrier(system)(slopes, *moment)
    results = read(moved, slopes if memory is None else none)
    before = None if memory is None else read(none, slopes)[4].T[:, start]
    return Row(sensor, results[0], results[2], results[4].T, before, by_errors)


def _identity_slopes(system: System) -> Expression:
    # A state's slopes by (parameters, itself).
    states = len(system.states)
    return ca.horzcat(ca.SX(states, len(system.parameters)), ca.SX.eye(states))
