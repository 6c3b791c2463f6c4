"""States and readings of a design over time, and their derivatives by what is estimated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.presenting import Brief
from oed.kernel.dynamics.simulate import simulate
from oed.kernel.dynamics.system import System
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.readings import moment_reading, sensor_labels
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.problem import Problem


@dataclass(frozen=True, repr=False)
class Course(Brief):
    """One quantity of a run of a design, from its start to its end, or over settings of an input.

    Attributes:
        name: name of the quantity.
        unit: SI.
        places: times [s], or values of the input, (n,).
        values: (n,), SI.
        slopes: derivatives by the estimated parameters, (n, p), SI.
        deviation: standard deviation of the noise of a reading; None of a state, or where it depends.
        read: places among these at which it is read; () of a state.
        sensor: label of the sensor that reads it; "" of a state.
    """

    name: str
    unit: str
    places: Array
    values: Array
    slopes: Array
    deviation: float | None = None
    read: tuple[int, ...] = ()
    sensor: str = ""

    def spread(self, covariance: Array) -> Array:
        """Standard deviations (n,) that the estimates' covariance (p, p) gives it."""
        variances = np.einsum("na,ab,nb->n", self.slopes, covariance, self.slopes)
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


def state_courses(problem: Problem, trajectory: Trajectory, finer: int = 1) -> list[list[Course]]:
    """The states over time, run by run; the starts taken as known.

    Args:
        problem: problem with the system.
        trajectory: design to follow.
        finer: places of every period.
    """
    system, columns = problem.system, _estimated(problem)
    courses = []
    for run, (states, slopes) in enumerate(_simulated(system, trajectory, finer)):
        times = np.linspace(0.0, trajectory.each[run].duration, len(states))
        quantities = zip(system.states, system.state_units, states.T, slopes.transpose(1, 0, 2), strict=True)
        courses.append(
            [Course(name, unit, times, value, slope[:, columns]) for name, unit, value, slope in quantities]
        )
    return courses


def reading_courses(problem: Problem, trajectory: Trajectory, finer: int = 1) -> list[list[Course]]:
    """Return the readings of all sensors at all places, run by run, except of those that read two moments
    together.

    Of a system without states there is one of each setting of the inputs.

    Args:
        problem: problem with the sensors and the system.
        trajectory: design to follow.
        finer: places of every period of a system with states.
    """
    system = problem.system
    courses = []
    finer = finer if system.states else 1
    for drive, (states, slopes) in zip(trajectory.each, _simulated(system, trajectory, finer), strict=True):
        count = len(states) if system.states else len(states) - 1
        held = np.vstack([np.repeat(drive.inputs, finer, axis=0), drive.inputs[-1:]])
        times = np.linspace(0.0, drive.duration, len(states))
        moments = states[:count], slopes[:count], held[:count]
        courses.append(list(_courses(problem, moments, times[:count], finer)))
    return courses


def response_courses(problem: Problem, place: int, values: Array) -> list[Course]:
    """Return the readings of a system without states over values of one of its inputs, the only one.

    Args:
        problem: problem with a system without states.
        place: place of the input.
        values: values of the input, SI, (n,).
    """
    states, slopes = np.zeros((len(values), 0)), np.zeros((len(values), 0, len(problem.system.parameters)))
    held = np.zeros((len(values), len(problem.system.inputs)))
    held[:, place] = values
    return list(_courses(problem, (states, slopes, held), values))


def _estimated(problem: Problem) -> list[int]:
    # Places of the parameters that are estimated, among the system's.
    names = [parameter.name for parameter in problem.system.parameters]
    (estimation,) = problem.any_estimations
    return [names.index(name) for name in estimation.parameters if name in names]


def _simulated(system: System, trajectory: Trajectory, finer: int) -> Iterator[tuple[Array, Array]]:
    """Simulate every run at `finer` places of every period: states (N + 1, states) and their derivatives by
    the parameters (N + 1, states, p).
    """
    for run in trajectory.each:
        inputs = np.repeat(run.inputs, finer, axis=0)
        simulation = simulate(system, inputs, run.starts[0], run.period / finer)
        yield simulation.states, simulation.sensitivities


def _courses(problem: Problem, moments: Sequence[Array], places: Array, finer: int = 1) -> Iterator[Course]:
    sensors = problem.sensors
    for sensor, label in zip(sensors, sensor_labels(sensors), strict=True):
        if sensor.when != "between samples":
            yield from _courses_of(problem, sensor, label, moments, places, finer)


def _courses_of(
    problem: Problem, sensor: Sensor, label: str, moments: Sequence[Array], places: Array, finer: int
) -> Iterator[Course]:
    system, parameters = problem.system, _estimated(problem)
    function, count = moment_reading(sensor, system), len(places)
    states, slopes, held = moments
    size = len(system.parameters)
    carried = np.zeros((count, len(system.states), size + len(system.states)))
    carried[:, :, :size] = slopes
    nominal = [nuisance.nominal for nuisance in sensor.nuisances]
    readings, by_all = function.map(count)(
        states.T, np.hstack(list(carried)) if count else ca.DM(), held.T, system.nominal, nominal, 0.0
    )[:2]
    values, derivatives = np.array(readings), np.array(by_all).reshape(by_all.shape[0], count, -1)
    deviations, units = sensor.deviations, sensor.units_of(system)
    read = tuple(
        finer * column for column in sensor.columns(problem.design.samples) if finer * column < count
    )
    for entry, value in enumerate(values):
        name = _name(sensor, entry)
        unit = units[entry] if units else ""
        noise = deviations[entry] if deviations else None
        yield Course(name, unit, places, value, derivatives[parameters, :, entry].T, noise, read, label)


def _name(sensor: Sensor, entry: int) -> str:
    return sensor.entries[entry].strip(".") or sensor.kind if sensor.entries else sensor.kind
