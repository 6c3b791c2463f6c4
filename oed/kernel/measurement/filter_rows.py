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
        direct: by all unknowns directly, (q, n).
        through: by the state and the errors, (q, states + m).
    """

    direct: Expression
    through: Expression

    def scaled(self, factor: Expression | float) -> Placed:
        """Return the row times a number, or times one of each row: a diagonal matrix."""
        return Placed(ca.mtimes(factor, self.direct), ca.mtimes(factor, self.through))

    def beside(self, one: Expression, others: int) -> Placed:
        """Return the row with a column more, and columns of what the readings do not depend on directly."""
        return Placed(ca.horzcat(self.direct, one, ca.SX(one.shape[0], others)), self.through)

    def without_errors(self, size: int) -> Placed:
        """Return the row of an instant that no errors precede."""
        return Placed(self.direct, self.through[:, : self.through.shape[1] - size])


@dataclass(frozen=True)
class Row:
    """Readings of a period, and in units of their noise their slopes.

    Attributes:
        sensor: whose they are.
        reading: (q,), SI.
        whitening: (q, q).
        slopes: by (parameters, the system's state, the sensor's own nuisances), (q, ...).
        by_memory: by the state that readings across periods begin at, (q, states); None of others.
        by_errors: by the period's errors, (q, m).
    """

    sensor: Sensor
    reading: Expression
    whitening: Expression
    slopes: Expression
    by_memory: Expression | None
    by_errors: Expression

    def misfit(self, measured: Expression) -> Expression:
        """Return the measured less the predicted reading, in units of the noise; angles up to full turns."""
        left = measured - self.reading
        for place in self.sensor.angles:
            left[place] = ca.atan2(ca.sin(left[place]), ca.cos(left[place]))
        return self.whitening @ left

    def among(self, columns: Sequence[int], memories: Sequence[int]) -> Placed:
        """Return the row with columns for all unknowns, those of other sensors' nuisances 0.

        Args:
            columns: how many there are of parameters, start states, nuisances before the own and behind them.
            memories: after how many samples each state that is remembered is another.
        """
        size, states, before, rest = columns
        count, leading = self.slopes.shape[0], size + states
        known, own = self.slopes[:, :size], self.slopes[:, leading:]
        direct = ca.horzcat(known, ca.SX(count, states + before), own, ca.SX(count, rest))
        others = ca.SX(count, states)
        beside = [
            others if self.by_memory is None or every != self.sensor.every else self.by_memory
            for every in memories
        ]
        return Placed(direct, ca.horzcat(self.slopes[:, size:leading], *beside, self.by_errors))


def memories_of(sensors: Sequence[Sensor]) -> tuple[int, ...]:
    """After how many samples the states that readings across several of them begin at are others."""
    across = {one.every for one in sensors if one.when == "between samples" and one.every > 1}
    return tuple(sorted(across))


def reads_of(sensors: Sequence[Sensor], samples: int) -> Array:
    """Return where sensors read in every period of a run and at its end, and where memories begin.

    Args:
        sensors: that read.
        samples: of the run.

    Returns:
        1 or 0, (sensors + memories, samples + 1).
    """
    memories = memories_of(sensors)
    found = np.zeros((len(sensors) + len(memories), samples + 1))
    for place, sensor in enumerate(sensors):
        found[place, taken_in(sensor, samples)] = 1.0
    for place, every in enumerate(memories, len(sensors)):
        found[place, ::every] = 1.0
    return found


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
    given: Sequence[Expression],
    own: Expression,
    memory: Expression | None,
) -> Row:
    """Return a sensor's row in a period; the later moment of a reading between samples is the period's end.

    Args:
        sensor: that reads.
        system: that is driven.
        noise: of its process.
        given: state at the period's begin, inputs, parameters and period.
        own: the sensor's nuisances.
        memory: the state that a reading across several periods began at.
    """
    if sensor.when == "between samples":
        return _between(sensor, system, noise, given, own, memory)
    state, inputs, parameters, period = given
    here, function = _here(system), moment_reading(sensor, system)
    lasting = period if sensor.when == "in periods" else ca.SX(0)
    found = function(state, here, inputs, parameters, own, lasting)
    seen = ca.SX(found[0].shape[0], noise.size)
    if sensor.when == "in periods" and noise.signal:
        by_signal = reading_by_signal(sensor, system, noise.signal)(state, inputs, parameters, own, period)
        seen = ca.sparsify(found[2] @ by_signal.T / period)
    return Row(sensor, found[0], found[2], found[4].T, None, seen)


def _between(
    sensor: Sensor,
    system: System,
    noise: ProcessNoise,
    given: Sequence[Expression],
    own: Expression,
    memory: Expression | None,
) -> Row:
    state, inputs, parameters, period = given
    here, function = _here(system), moment_reading(sensor, system)
    none, start = ca.SX(*here.shape), slice(len(system.parameters), here.shape[1])
    both = ca.vertcat(stepper(system)(*given), state if memory is None else memory)

    def read(later: Expression, earlier: Expression) -> Sequence[Expression]:
        held, carried = ca.vertcat(inputs, inputs), ca.vertcat(later, earlier)
        found: Sequence[Expression] = function(both, carried, held, parameters, own, sensor.every * period)
        return found

    effect, _ = spread(noise, system)(state, inputs, ca.SX(ca.DM(system.nominal)), period)
    seen = read(here, none)[4].T[:, start] @ effect
    moved = carrier(system)(here, *given)
    found = read(moved, here if memory is None else none)
    before = None if memory is None else read(none, here)[4].T[:, start]
    return Row(sensor, found[0], found[2], found[4].T, before, seen)


def _here(system: System) -> Expression:
    # A state's slopes by (parameters, itself).
    states = len(system.states)
    return ca.horzcat(ca.SX(states, len(system.parameters)), ca.SX.eye(states))
