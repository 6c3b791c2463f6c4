"""Upper bounds for sensors that are fused in one estimation, from two poorly identifiable directions.

Growing all lengths of the robot by one factor moves every position away from the start in proportion, so the
information grows with the spread of the positions. Changing the forward speed in proportion to the yaw rate
moves every position along a circle of the track's size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from oed.bounds.certificate import Bound
from oed.bounds.closed_form import SPEEDS, direction_bound
from oed.bounds.reach import coefficient_rows, scales_lengths, top_speeds, workspace_bounds
from oed.bounds.sensitivity import SensorPrecision, precisions_of, unknown_start
from oed.bounds.spread import is_too_fine, largest_spread
from oed.foundation.arrays import Array
from oed.kernel.measurement.information import Estimation
from oed.kernel.problem import Problem
from oed.robots.models.model import robot_of
from oed.robots.sensors.biased import YawRate
from oed.robots.sensors.poses import Poses


def joint_bounds(problem: Problem) -> Iterator[Bound]:
    """Yield bounds for fused sensors whose noise is known."""
    precisions = precisions_of(problem.sensors)
    if not precisions:
        return
    # Information of all readings per squared displacement.
    samples = problem.design.samples
    total = sum(entry.position * len(entry.sensor.columns(samples)) for entry in precisions)
    (estimation,) = problem.any_estimations
    if robot_of(problem.system).physical is not problem.system:
        yield from _circle_bound(problem, estimation, total)
    else:
        yield from _size_bounds(problem, estimation, precisions, total)


def _circle_bound(problem: Problem, estimation: Estimation, total: float) -> Iterator[Bound]:
    rows = coefficient_rows(problem)
    names = robot_of(problem.model).coefficient_names[1]
    if (
        rows is None
        or robot_of(problem.system).integration != "arc"
        or not set(names) <= set(estimation.judged)
    ):
        return
    # A change of c21, c22 along the yaw rate's row displaces positions on a unit circle.
    change = np.zeros(len(estimation.judged))
    change[[estimation.judged.index(name) for name in names]] = rows[0]
    sensors = problem.sensors
    centred = unknown_start(sensors) and all(isinstance(sensor, Poses | YawRate) for sensor in sensors)
    value = total if centred else 4.0 * total
    yield direction_bound(
        problem,
        estimation,
        change,
        value,
        "forward speed wrong in proportion to the yaw rate: a circle of the track's size",
        ("exact arcs", "neither speeds nor the room matter"),
    )


def _size_bounds(
    problem: Problem, estimation: Estimation, precisions: Sequence[SensorPrecision], total: float
) -> Iterator[Bound]:
    bounds, change = workspace_bounds(problem), _growth(problem, estimation)
    if bounds is None or change is None or not unknown_start(problem.sensors):
        return
    x_min, x_max, y_min, y_max = bounds
    half_squares = ((x_max - x_min) ** 2 + (y_max - y_min) ** 2) / 4
    yield direction_bound(
        problem,
        estimation,
        change,
        total * half_squares,
        "all lengths wrong alike: every position in a corner of the room",
        ("every position within the room", "initial pose unknown", "speeds are left out"),
    )
    # Sensors share the shift of the path, so spreads separate only if a single sensor reads positions.
    positions = [entry for entry in precisions if entry.position]
    speeds = top_speeds(problem)
    if len(positions) != 1 or speeds is None:
        return
    step, axes = problem.design.period * speeds, np.reshape(bounds, (2, 2))
    if any(is_too_fine(low, high, step) for low, high in axes):
        return
    read = np.zeros(problem.design.samples + 1, dtype=bool)
    read[positions[0].sensor.columns(problem.design.samples)] = True
    starts = (None, None) if problem.fixed_starts is None else problem.fixed_starts[0, :2]
    # A path moved to its nominal start may leave the workspace by the tolerance of the start.
    widened = axes + problem.start_spare * np.array([-1, 1])
    spreads = [
        largest_spread(low, high, start, step, read)
        for (low, high), start in zip(widened, starts, strict=True)
    ]
    yield direction_bound(
        problem,
        estimation,
        change,
        positions[0].position * sum(spreads),
        "all lengths wrong alike: dynamic programming over positions within top speed, axis by axis",
        ("every position within the room", "initial pose unknown", SPEEDS),
    )


def _growth(problem: Problem, estimation: Estimation) -> Array | None:
    # Growth of all lengths, in m or m per another unit, by one factor; None if some are not judged.
    lengths = [entry.name for entry in problem.system.parameters if entry.unit.startswith("m")]
    if not set(lengths) <= set(estimation.judged) or not scales_lengths(problem, tuple(lengths)):
        return None
    values = dict(zip(estimation.parameters, estimation.nominal, strict=True))
    return np.array([values[name] if name in lengths else 0.0 for name in estimation.judged])
