"""Points of systems without states: settings of the inputs in a box, over which F adds up."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import casadi as ca
import numpy as np
import scipy

from oed.bounds.boxes import Landscape
from oed.foundation.arrays import Array
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.readings import moment_reading
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.problem import Problem

GRID = {1: 201, 2: 17, 3: 6, 4: 4, 5: 3}
"""Number of grid values of each input, by the number of inputs."""
DRAWN = 256
"""Number of first points of systems with more inputs."""


@dataclass(frozen=True)
class Points:
    """Space of designs that consist of points.

    Attributes:
        landscapes: sensitivity function of each kind of point: of each combination of readings.
        totals: number of points of each kind.
        prior: prior information, (q, q).
        judged: number of the q parameters that the criterion judges.
        low: smallest inputs, (n,).
        high: largest inputs, (n,).
    """

    landscapes: tuple[Landscape, ...]
    totals: Array
    prior: Array
    judged: int
    low: Array
    high: Array

    @cached_property
    def first(self) -> Array:
        """Points from which the search begins, (k, n)."""
        count = len(self.low)
        if count in GRID:
            axes = [np.linspace(*ends, GRID[count]) for ends in zip(self.low, self.high, strict=True)]
            return np.array(list(product(*axes)))
        unit_points = scipy.stats.qmc.Sobol(count, scramble=False).random(DRAWN)
        return np.asarray(self.low + (self.high - self.low) * unit_points)


def points_of(problem: Problem) -> Points | None:
    """Return the points of a problem; None if it has none, or an operation without interval bounds."""
    sensors, low, high = problem.sensors, *problem.input_bounds.T
    alone = all(sensor.when != "between samples" and sensor.joint_whitening is None for sensor in sensors)
    plain = not any(sensor.nuisances for sensor in sensors) and len(problem.any_estimations) == 1
    if problem.system.states or not sensors or not alone or not plain:
        return None
    if not np.isfinite(problem.input_bounds).all():
        return None
    (estimation,) = problem.any_estimations
    judged, count = len(estimation.judged), len(estimation.parameters)
    scales = np.concatenate([estimation.scales, np.ones(count - judged)])
    columns = [estimation.block.parameters.index(name) for name in estimation.parameters]
    inputs, period = ca.SX.sym("inputs", len(low)), ca.SX.sym("period")
    rows = [_rows(problem, sensor, inputs, period)[:, columns] @ ca.diag(ca.DM(scales)) for sensor in sensors]
    kinds = _kinds(problem, sensors)
    try:
        landscapes = [
            Landscape(inputs, ca.vertcat(*(times**0.5 * row for times, row in zip(kind, rows, strict=True))))
            for kind in kinds
        ]
    except RuntimeError:
        # CasADi refuses readings that depend on the period as well.
        return None
    if not all(landscape.is_bounded for landscape in landscapes):
        return None
    prior = np.zeros((count, count)) if estimation.prior is None else estimation.prior
    totals = np.array([float(number) for number in kinds.values()])
    return Points(tuple(landscapes), totals, prior * np.outer(scales, scales), judged, low, high)


def _rows(problem: Problem, sensor: Sensor, inputs: Expression, period: Expression) -> Expression:
    # Derivatives of a sensor's reading at a point by the parameters, in units of the noise.
    system, size = problem.system, len(problem.system.parameters)
    arguments = ca.SX(0, 1), ca.SX(0, size), inputs, ca.DM(system.nominal), ca.SX(0, 1), period
    return moment_reading(sensor, system)(*arguments)[4].T


def _kinds(problem: Problem, sensors: tuple[Sensor, ...]) -> dict[tuple[int, ...], int]:
    # Number of settings with each combination of readings per sensor.
    samples, runs = problem.design.samples, problem.design.runs
    read = np.zeros((samples, len(sensors)), dtype=int)
    for place, sensor in enumerate(sensors):
        # The inputs at the last sample are those of the last period.
        np.add.at(read[:, place], np.minimum(sensor.columns(samples), samples - 1), 1)
    kinds = Counter(tuple(row) for row in read.tolist() if any(row))
    # In descending order of readings.
    return {kind: runs * kinds[kind] for kind in sorted(kinds, key=sum, reverse=True)}
