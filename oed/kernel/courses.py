"""States and readings of a design over time, and their derivatives by what is estimated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.presenting import Brief
from oed.kernel.dynamics.simulate import Simulation, simulate
from oed.kernel.dynamics.system import System
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.readings import moment_reading, sensor_labels
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
    """Return the states over time, run by run; the starts taken as known.

    Args:
        problem: problem with the system.
        trajectory: design to follow.
        finer: places of every period.
    """
    system, columns, courses = problem.system, _estimated(problem), []
    for run in trajectory.each:
        simulation = _simulate_run(system, run, finer)
        times = np.linspace(0.0, run.duration, len(simulation.states))
        quantities = zip(system.states, system.state_units, simulation.states.T, strict=True)
        courses.append(
            [
                Course(name, unit, times, values, simulation.sensitivities[:, place, columns])
                for place, (name, unit, values) in enumerate(quantities)
            ]
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
    system, courses = problem.system, []
    finer = finer if system.states else 1
    for run in trajectory.each:
        simulation = _simulate_run(system, run, finer)
        times = np.linspace(0.0, run.duration, len(simulation.states))
        held = np.vstack([np.repeat(run.inputs, finer, axis=0), run.inputs[-1:]])
        # Settings are read one by one, and none at the end of the last.
        count = len(times) if system.states else len(times) - 1
        moments = simulation.states[:count], simulation.sensitivities[:count], held[:count]
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


def _simulate_run(system: System, run: Trajectory, finer: int) -> Simulation:
    # Simulated at `finer` places of every period.
    return simulate(system, np.repeat(run.inputs, finer, axis=0), run.starts[0], run.period / finer)


def _courses(problem: Problem, moments: Sequence[Array], places: Array, finer: int = 1) -> Iterator[Course]:
    # Of all sensors; moments are states, their derivatives by the parameters, and inputs held.
    states, slopes, held = moments
    system, columns, count = problem.system, _estimated(problem), len(places)
    by_start = np.zeros((count, len(system.states), len(system.states)))
    carried = np.hstack(list(np.concatenate([slopes, by_start], axis=2)))
    for sensor, label in zip(problem.sensors, sensor_labels(problem.sensors), strict=True):
        if sensor.when == "between samples":
            continue
        nominal = [nuisance.nominal for nuisance in sensor.nuisances]
        readings, by_all, *_ = moment_reading(sensor, system).map(count)(
            states.T, carried, held.T, system.nominal, nominal, 0.0
        )
        derivatives = np.array(by_all).reshape(by_all.shape[0], count, -1)
        deviations, units = sensor.deviations, sensor.units_of(system)
        read = finer * np.array(sensor.columns(problem.design.samples))
        for entry, values in enumerate(np.array(readings)):
            yield Course(
                name=(sensor.entries[entry].strip(".") if sensor.entries else "") or sensor.kind,
                unit=units[entry] if units else "",
                places=places,
                values=values,
                slopes=derivatives[columns, :, entry].T,
                deviation=deviations[entry] if deviations else None,
                read=tuple(read[read < count].tolist()),
                sensor=label,
            )
