"""What a designed drive's process noise does to its readings: exactly, and to first order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
import scipy

from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System, stepper
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.process_noise import ProcessNoise, erring, spread
from oed.kernel.measurement.readings import moment_reading, reading_by_signal
from oed.kernel.measurement.sensor import Sensor


@dataclass(frozen=True)
class _Formulas:
    # Those of every run of so many periods.
    sensors: tuple[Sensor, ...]
    system: System
    noise: ProcessNoise
    samples: int
    period: float

    @cached_property
    def readings(self) -> ca.Function:
        """(start, inputs, errors (m, N)) -> what each sensor reads of a run, one number below the other."""
        system, samples, period = self.system, self.samples, self.period
        start, nominal = ca.MX.sym("start", len(system.states)), ca.DM(system.nominal)
        inputs = ca.MX.sym("inputs", len(system.inputs), samples)
        errors = ca.MX.sym("errors", self.noise.size, samples)
        along = erring(self.noise, system).mapaccum(samples)
        states = ca.horzcat(start, along(start, inputs, nominal, period, errors))
        found = [self._read(sensor, states, inputs, errors) for sensor in self.sensors]
        return ca.Function("walk", [start, inputs, errors], [ca.vec(one) for one in found])

    def _read(self, sensor: Sensor, states: Expression, inputs: Expression, errors: Expression) -> Expression:
        # Readings (q, times) of one sensor.
        system, period, samples = self.system, self.period, self.samples
        size, count = len(system.parameters), len(system.states)
        own = ca.DM([nuisance.nominal for nuisance in sensor.nuisances])
        instants = sensor.instants(samples)
        each = [states[:, columns] for columns in instants]
        held = [inputs[:, [min(column, samples - 1) for column in columns]] for columns in instants]
        lasting = sensor.lasting * period
        none = ca.DM.zeros(count * len(instants), size + count)
        rest = (ca.DM(system.nominal), own)
        reading = moment_reading(sensor, system).map(len(instants[0]))
        found = reading(
            ca.vertcat(*each), ca.repmat(none, 1, len(instants[0])), ca.vertcat(*held), *rest, lasting
        )[0]
        if sensor.when == "in periods" and self.noise.signal:
            by_signal = reading_by_signal(sensor, system, self.noise.signal)
            parts = []
            for place, column in enumerate(instants[0]):
                slopes = by_signal(each[0][:, place], held[0][:, place], *rest, period)
                parts.append(slopes.T @ errors[:, column] / period)
            found = found + ca.horzcat(*parts)
        return found

    @cached_property
    def effect(self) -> ca.Function:
        """Of the same, derivatives of what each sensor reads by all errors."""
        errors = ca.MX.sym("errors", self.noise.size, self.samples)
        start, inputs = (ca.MX.sym("given", *self.readings.size_in(place)) for place in range(2))
        found = self.readings(start, inputs, errors)
        outputs = found if isinstance(found, tuple | list) else [found]
        slopes = [ca.densify(ca.jacobian(one, errors)) for one in outputs]
        return ca.Function("effect", [start, inputs, errors], slopes)


_formulas = lru_cache(maxsize=8)(_Formulas)
"""Drives of one study have them in common, and they take longer to make than a drive's readings."""


@dataclass(frozen=True)
class Walk:
    """A drive whose process errs, at the nominal parameters; readings are sensor by sensor, run by run.

    Attributes:
        sensors: that read.
        system: that is driven.
        trajectory: the drive.
        noise: of its process.
    """

    sensors: tuple[Sensor, ...]
    system: System
    trajectory: Trajectory
    noise: ProcessNoise

    @property
    def _samples(self) -> int:
        return self.trajectory.samples // self.trajectory.runs

    @cached_property
    def _runs(self) -> list[tuple[Array, Array]]:
        # Start state (states,) and inputs (inputs, N) of every run.
        return [(one.start, one.inputs.T) for one in self.trajectory.each]

    @property
    def _formulas(self) -> _Formulas:
        return _formulas(self.sensors, self.system, self.noise, self._samples, self.trajectory.period)

    def readings(self, errors: Sequence[Array]) -> Array:
        """Of every run's errors (m, N), (M of all runs,), SI."""
        found = [
            self._formulas.readings.call([start, inputs, own])
            for (start, inputs), own in zip(self._runs, errors, strict=True)
        ]
        each = [[np.array(one).ravel() for one in run] for run in found]
        return np.concatenate([run[place] for place in range(len(self.sensors)) for run in each])

    @cached_property
    def roots(self) -> list[Array]:
        """Of each run the lower factors (N, m, m) of its errors' covariances."""
        system, (samples, size) = self.system, (self._samples, self.noise.size)
        states = stepper(system).mapaccum(samples)
        every, found = spread(self.noise, system).map(samples), []
        for start, inputs in self._runs:
            given = ca.DM(system.nominal), ca.DM(self.trajectory.period)
            path = ca.horzcat(ca.DM(start), states(start, inputs, *given))[:, :-1]
            table = np.array(ca.densify(every(path, inputs, *given)[1]))
            covariances = table.reshape(size, samples, size).transpose(1, 0, 2)
            values, vectors = np.linalg.eigh(covariances)
            found.append(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])
        return found

    @cached_property
    def effect(self) -> Array:
        """L: derivatives of all readings by all errors in units of their deviations, (M, N m of all runs)."""
        function = self._formulas.effect
        blocks: list[list[Array]] = [[] for _ in self.sensors]
        for (begin, held), root in zip(self._runs, self.roots, strict=True):
            whole = scipy.linalg.block_diag(*root)
            still = np.zeros((self.noise.size, self._samples))
            for place, one in enumerate(function.call([begin, held, still])):
                blocks[place].append(np.array(one) @ whole)
        return np.vstack([scipy.linalg.block_diag(*each) for each in blocks])
