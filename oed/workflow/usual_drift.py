"""Standard deviations of a drive if the robot drifted as robots usually do, in studies without drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

from oed.kernel.evaluation import evaluate
from oed.kernel.measurement.measurement import Measurement, measurement_of
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution
from oed.robots.sensors.drift import DriftingSensor


def usual_drift_deviations(problem: Problem, solution: Solution) -> dict[str, float]:
    """Return the standard deviations of a solution's drive under the same problem with `drift: usual`.

    They are {} where the problem has drift, where it has no sensor of a robot that may drift, and where the
    readings do not go with drift: chosen ones, and those with one covariance of all.
    """
    drifting = None if solution.evaluation is None else _with_usual_drift(problem)
    if drifting is None or solution.trajectory is None:
        return {}
    return evaluate(drifting, solution.trajectory).standard_deviations


@lru_cache(maxsize=16)
def _with_usual_drift(problem: Problem) -> Problem | None:
    # The same object for all drives of a study, for what scores them is compiled once for each problem.
    measurement = _drifting(problem.sensors)
    if measurement is None or problem.selection is not None:
        return None
    if problem.process_noise is not None:
        return None
    if measurement.issues(problem.system, problem.design.samples):
        return None
    return replace(problem, measurement=measurement)


def _drifting(sensors: Sequence[Sensor]) -> Measurement | None:
    if not any(isinstance(sensor, DriftingSensor) for sensor in sensors):
        return None
    return measurement_of(
        [
            sensor.model_copy(update={"drift": "usual"}) if isinstance(sensor, DriftingSensor) else sensor
            for sensor in sensors
        ]
    )
